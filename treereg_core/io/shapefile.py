"""Moving a shapefile: its positions and bounds are rewritten in place in a copy, everything else stays."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.complete import complete_file
from treereg_core.io.crs import parse_crs
from treereg_core.io.files import reading
from treereg_core.io.untrusted import check_beside, check_file_size
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

PARTS = (".shx", ".dbf", ".prj", ".cpg")
"""What belongs to a shapefile and stays true; spatial indexes do not."""
BOUNDS = slice(36, 68)
"""Where the bounds of all stand in the head of a .shp file, and in that of its .shx."""
POINTS, MULTIPOINTS, LINES, PATCHES = (1, 11, 21), (8, 18, 28), (3, 5, 13, 15, 23, 25), (31,)


def shapefile_parts(path: Path) -> tuple[Path, ...]:
    """The files of a shapefile that are there, itself first."""
    beside = sorted(entry for entry in path.parent.glob(f"{escape(path.stem)}.*") if entry.suffix.lower() in PARTS)
    return (path, *(entry for entry in beside if entry.stem == path.stem))


def move_shapefile(path: Path, mover: Callable[[CRS], Callable[[FloatArray], FloatArray]], folder: Path) -> None:
    """Write a shapefile, moved, into a folder under its own name. `InputError` if it cannot be read or has no CRS."""
    parts = shapefile_parts(path)
    with reading(path, "a shapefile"):
        check_beside(path)
        check_file_size(path)
        move = mover(_crs(path, parts))
        content = bytearray(path.read_bytes())
        _move(content, move, path)
    with complete_file(folder / path.name) as file:
        file.write(content)
    for part in parts[1:]:
        shutil.copyfile(part, folder / part.name)
        if part.suffix.lower() == ".shx":
            with (folder / part.name).open("r+b") as index:
                index.seek(BOUNDS.start)
                index.write(content[BOUNDS])


def _crs(path: Path, parts: tuple[Path, ...]) -> CRS:
    file = next((part for part in parts if part.suffix.lower() == ".prj"), None)
    if file is None:
        raise InputError(f"{path} has no CRS, since there is no {path.stem}.prj; assign it.")
    return parse_crs(file.read_text(encoding="utf-8"), path)


def _move(content: bytearray, move: Callable[[FloatArray], FloatArray], path: Path) -> None:
    """Move every position in the bytes of a .shp file, and set the bounds anew."""
    if len(content) < 100 or struct.unpack_from(">i", content)[0] != 9994:
        raise InputError(f"{path} is not a shapefile, or is damaged; export it again.")
    runs = _runs(content, path)
    if not runs:
        return
    counts = [count for _, count, _ in runs]
    old = np.concatenate([np.frombuffer(content, "<f8", 2 * count, at) for at, count, _ in runs]).reshape(-1, 2)
    if not np.isfinite(old).all():
        raise InputError(f"{path} has coordinates that are not finite numbers; mend or remove them.")
    new = move(old.astype(np.float64)).astype("<f8")
    for (at, count, box), xy in zip(runs, np.split(new, np.cumsum(counts)[:-1]), strict=True):
        content[at : at + 16 * count] = xy.tobytes()
        if box:
            struct.pack_into("<4d", content, box, *xy.min(axis=0), *xy.max(axis=0))
    struct.pack_into("<4d", content, BOUNDS.start, *new.min(axis=0), *new.max(axis=0))


def _runs(content: bytearray, path: Path) -> list[tuple[int, int, int]]:
    """For each shape: where its positions begin, how many there are, and where its bounds stand (0: nowhere)."""
    found = []
    at = 100
    while at + 12 <= len(content):
        length = 2 * struct.unpack_from(">i", content, at + 4)[0]
        begin, end = at + 8, at + 8 + length
        kind = struct.unpack_from("<i", content, begin)[0]
        if kind in POINTS:
            run = (begin + 4, 1, 0)
        elif kind in MULTIPOINTS:
            run = (begin + 40, struct.unpack_from("<i", content, begin + 36)[0], begin + 4)
        elif kind in (*LINES, *PATCHES):
            parts, count = struct.unpack_from("<2i", content, begin + 36)
            run = (begin + 44 + parts * (8 if kind in PATCHES else 4), count, begin + 4)
        elif kind == 0:
            run = (begin, 0, 0)
        else:
            raise InputError(f"{path} has shapes of the unknown kind {kind}; export it again.")
        if length < 4 or run[1] < 0 or run[0] + 16 * run[1] > end or end > len(content):
            raise InputError(f"{path} is cut off or damaged; export it again.")
        if run[1]:
            found.append(run)
        at = end
    return found
