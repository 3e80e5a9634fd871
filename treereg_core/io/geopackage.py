"""Moving a GeoPackage: a copy of the database in which nothing but geometry, its indexes and bounds are changed."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import parse_crs
from treereg_core.io.files import reading
from treereg_core.io.shapes import move_shapes, shapes, to_wkb
from treereg_core.io.untrusted import check_geopackage, open_database
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

ENVELOPES = (0, 32, 48, 48, 64)
"""Bytes of the bounds that stand before the geometry, by their code."""
ROWS = 20_000
"""How many geometries are in memory at once."""
PAGES = 10_000
"""How many pages of the database are copied at once."""
LONGEST_WAIT = 20
"""How often copying is tried again, every quarter of a second, while another program holds the database."""
SIDES = ("ST_MinX", "ST_MinY", "ST_MaxX", "ST_MaxY")


def move_geopackage(path: Path, mover: Callable[[CRS], Callable[[FloatArray], FloatArray]], folder: Path) -> None:
    """Write a GeoPackage, all its layers moved, into a folder under its own name. `InputError` if it cannot be."""
    target = folder / path.name
    with reading(path, "GeoPackage"), _room(target):
        with path.open("rb") as file:
            start = file.read(16)
        if start != b"SQLite format 3\0":
            raise InputError(f"{path} is not a GeoPackage, or is damaged; export it again.")
        check_geopackage(path, views=True)
        with closing(sqlite3.connect(target)) as database:
            with closing(open_database(path)) as source:
                source.backup(database, pages=PAGES, progress=_Waiting(path))
            _add_functions(database)
            layers = database.execute("SELECT table_name, column_name, srs_id FROM gpkg_geometry_columns").fetchall()
            if not layers:
                raise InputError(f"{path} holds no layer with geometry; give one that does.")
            for table, column, srs in layers:
                _move_layer(database, (table, column), mover(_crs(database, srs, table, path)), path)
            database.commit()


@contextmanager
def _room(target: Path) -> Iterator[None]:
    """A full disk is no fault of the file that is read."""
    try:
        yield
    except sqlite3.Error as error:
        if error.sqlite_errorcode & 0xFF not in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise
        raise InputError(f"{target} cannot be written ({error}); free space, or choose another place.") from error


class _Waiting:
    """Ends the copying of a database that comes no further, because it is locked or says so."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._left = -1
        self._waits = 0

    def __call__(self, status: int, left: int, total: int) -> None:
        self._waits = self._waits + 1 if left == self._left else 0
        self._left = left
        if self._waits > LONGEST_WAIT:
            raise InputError(f"{self._path} is in use by another program, or is damaged; close it there.")


def _crs(database: sqlite3.Connection, srs: int, table: str, path: Path) -> CRS:
    found = database.execute(
        "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys WHERE srs_id = ?", (srs,)
    ).fetchone()
    if srs in (0, -1) or not found:
        raise InputError(f"{path} has no CRS for the layer {table:.60}; assign it.")
    organisation, code, definition = found
    try:
        return parse_crs(f"{organisation}:{code}", path)
    except InputError:
        return parse_crs(definition, path)


def _move_layer(
    database: sqlite3.Connection, layer: tuple[str, str], move: Callable[[FloatArray], FloatArray], path: Path
) -> None:
    """Move one layer in place; the triggers that it brings keep its spatial index up to date."""
    table, column = map(_quoted, layer)
    rows = database.execute(f"SELECT rowid, {column} FROM {table} WHERE {column} IS NOT NULL ORDER BY rowid").fetchall()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for begin in range(0, len(rows), ROWS):
        ids, blobs = zip(*rows[begin : begin + ROWS], strict=True)
        heads = [_head(blob, path) for blob in blobs]
        geometry = shapes([blob[head:] for blob, head in zip(blobs, heads, strict=True)], path)
        there = move_shapes(geometry, move, path)
        bounds = _bounds(there)
        new = [
            (_header(blob, box) + body, number)
            for blob, box, body, number in zip(blobs, bounds, to_wkb(there), ids, strict=True)
        ]
        database.executemany(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", new)
        low, high = np.fmin(low, np.nanmin(bounds[:, :2], axis=0)), np.fmax(high, np.nanmax(bounds[:, 2:], axis=0))
    box = [*low.tolist(), *high.tolist()] if np.isfinite([low, high]).all() else [None] * 4
    database.execute(
        "UPDATE gpkg_contents SET min_x = ?, min_y = ?, max_x = ?, max_y = ? WHERE table_name = ?", (*box, layer[0])
    )


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _bounds(geometry: Any) -> FloatArray:
    import shapely

    return np.asarray(shapely.bounds(geometry))


def _head(blob: bytes, path: Path) -> int:
    """How many bytes stand before the geometry."""
    if not isinstance(blob, bytes) or blob[:2] != b"GP" or blob[3] & 0x20 or (blob[3] >> 1 & 7) >= len(ENVELOPES):
        raise InputError(f"{path} has geometry of an unknown kind; export it again.")
    return 8 + ENVELOPES[blob[3] >> 1 & 7]


def _header(blob: bytes, box: FloatArray) -> bytes:
    """The head of a geometry with these bounds, in the byte order of this one's head; without, where it had none."""
    order = "<" if blob[3] & 1 else ">"
    known = blob[3] >> 1 & 7 and bool(np.isfinite(box).all())
    flags = blob[3] & ~0x0E | (2 if known else 0)
    x0, y0, x1, y1 = box.tolist()
    return blob[:3] + bytes([flags]) + blob[4:8] + (struct.pack(f"{order}4d", x0, x1, y0, y1) if known else b"")


def _add_functions(database: sqlite3.Connection) -> None:
    """What the triggers of a GeoPackage call to keep its spatial index: whether a geometry is empty, and its bounds."""
    latest: dict[bytes, Any] = {}

    def bounds(blob: bytes) -> Any:
        if blob not in latest:
            latest.clear()
            latest[blob] = _bounds(shapes([blob[_head(blob, Path()) :]], Path()))[0].tolist()
        return latest[blob]

    database.create_function("ST_IsEmpty", 1, lambda blob: int(not np.isfinite(bounds(blob)).all()), deterministic=True)
    for side, name in enumerate(SIDES):
        database.create_function(name, 1, lambda blob, side=side: bounds(blob)[side], deterministic=True)
