"""A survey folder copied, all of it moved but the boundary: settled and checked before any file is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from treereg_core import io
from treereg_core.application import Application, applications
from treereg_core.errors import InputError

RASTERS = (".tif", ".tiff")


@dataclass(frozen=True)
class SurveyCopy:
    """What becomes of the files of a survey folder.

    - `moved`: vector files and GeoTIFFs with what belongs to them, of the latter only the georeference.
    - `boundary`: copied as it is, since it is of the reference's frame; None where there is none.
    - `left_out`: what cannot be moved, and so has no place in the copy.
    """

    moved: tuple[Application, ...]
    boundary: Path | None
    left_out: tuple[Path, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all files of the copy."""
        return (*(name for one in self.moved for name in one.names), *([self.boundary.name] if self.boundary else []))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know before the work."""
        told = tuple(warning for one in self.moved for warning in one.warnings)
        if not self.left_out:
            return told
        more = f" and {len(self.left_out) - 1} more" if len(self.left_out) > 1 else ""
        verb = "are left out, being" if more else "is left out, being"
        return (*told, f"{self.left_out[0]}{more} {verb} neither vector file nor GeoTIFF; copy by hand what fits.")

    def write(self, folder: Path, progress: Callable[[str], None]) -> None:
        """Write all files into a folder. `InputError` for one that cannot be moved or written."""
        for one in self.moved:
            progress(f"move {one.path}")
            one.write(folder, lambda share: None)
        if self.boundary:
            progress(f"copy {self.boundary}")
            shutil.copyfile(self.boundary, folder / self.boundary.name)


def survey_copy(folder: Path, motion: io.Motion, target: Path) -> SurveyCopy:
    """What becomes of the files of a survey folder that moves, copied into `target` or a folder below it.

    Folders inside it and hidden files are not looked at. Raises `InputError` for a file that should move but cannot.
    """
    try:
        files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    except OSError as error:
        raise InputError(f"{folder} cannot be listed ({error.strerror}); check its permissions.") from error
    boundary = io.find_files(folder).boundary
    moving = [path for path in files if path != boundary and _movable(path)]
    moved = tuple(one for path in moving for one in applications([path], motion, None, _options(path), target))
    copied = {path.name for path in moving} | {name for one in moved for name in one.names}
    return SurveyCopy(moved, boundary, tuple(path for path in files if path != boundary and path.name not in copied))


def _movable(path: Path) -> bool:
    """Whether a file is to be moved by its name; `.json` only where it holds GeoJSON."""
    if path.suffix.lower() == ".json":
        return io.holds_geojson(path)
    return path.suffix.lower() in RASTERS or io.is_vector(path)


def _options(path: Path) -> io.RasterOptions:
    return io.RasterOptions(lossless=True, world_file=path.with_suffix(".tfw").is_file())
