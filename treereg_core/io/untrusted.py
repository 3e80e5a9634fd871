"""What is asked of a vector file before it is read: that it is of a size that can be, and runs nothing of its own."""

from __future__ import annotations

import re
import sqlite3
import struct
from collections.abc import Iterable
from contextlib import closing
from glob import escape
from pathlib import Path

from treereg_core.errors import InputError

LARGEST_FILE = 4 * 2**30
"""A vector file of more bytes is refused; a million trees take about half a gigabyte."""
LARGEST_TABLE = 16 * 2**30
"""A Parquet file that says it becomes more bytes when it is unpacked is refused."""
MOST_ROWS = 50_000_000
"""So is one of more rows, which can be packed into nearly nothing."""
BLANK = r"(?>\s|\ufeff|/\*.*?\*/|--[^\n]*\n)*+"
"""What SQLite allows between two words. Here and below nothing is tried twice, which could take for ever."""
VIEW = re.compile(rf"CREATE{BLANK}(?:TEMP(?:ORARY)?{BLANK})?VIEW\b", re.IGNORECASE | re.DOTALL)
VIRTUAL = re.compile(rf"CREATE{BLANK}VIRTUAL\b", re.IGNORECASE | re.DOTALL)
NAME = r"""("(?:[^"]|"")*"|'(?:[^']|\'\')*'|`(?:[^`]|``)*`|\[[^\]]*\]|\w+)"""
INDEXES = re.compile(rf"CREATE\s+VIRTUAL\s+TABLE\s+{NAME}\s+USING\s+(rtree|rtree_i32|fts[345])\b", re.IGNORECASE)
RECURSIVE = re.compile(r"(?>.*?\bWITH\b)(?>.*?\bAS\b).*?\bSELECT\b", re.IGNORECASE | re.DOTALL)
"""How a definition begins that computes without an end; SQLite does not ask for the word RECURSIVE."""
STEPS, STEPS_PER_BYTE = 100_000_000, 4
"""So many steps of SQLite's may looking over a database take; an honest one takes less than a hundredth."""

DEEPEST = 32
"""Geometry nested in geometry more deeply is refused: reading it takes the stack of the process."""


def check_beside(path: Path) -> None:
    """Refuse pipes and devices by the name of a file that belongs to this one: who opens a pipe waits for ever."""
    for side in path.parent.glob(f"{escape(path.stem)}*"):
        if side.is_fifo() or side.is_char_device():
            raise InputError(f"{side} is no file; remove it.")


def check_file_size(path: Path) -> None:
    """Refuse a file that is too large to be held. Raises `OSError` where there is none."""
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(f"{path} has {size / 1e9:,.0f} GB, too much to be true of an orchard; cut it to size.")


def open_database(path: Path) -> sqlite3.Connection:
    """A database, opened to be read; also where nothing can be made beside it, as its log of changes asks for.

    Raises `InputError` for one that is held, or whose log cannot be read, and `sqlite3.Error` for a wrong one.
    """
    address = path.absolute().as_uri()
    database = sqlite3.connect(f"{address}?mode=ro", uri=True)
    try:
        database.execute("SELECT 1 FROM sqlite_master")
    except sqlite3.Error as error:
        database.close()
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise InputError(f"{path} is in use by another program; close it there.") from error
        if error.sqlite_errorcode not in (sqlite3.SQLITE_READONLY_DIRECTORY, sqlite3.SQLITE_CANTOPEN):
            raise
        log = Path(f"{path}-wal")
        if log.exists() and log.stat().st_size:
            raise InputError(
                f"{log} cannot be read; copy it and {path.name} into a folder that can be written."
            ) from error
        database = sqlite3.connect(f"{address}?immutable=1", uri=True)
    return database


def check_geopackage(path: Path, views: bool = False) -> None:
    """Refuse a database whose content is computed, by views or other modules of SQLite, or whose pages are not sound.

    Indexes are virtual tables too, and stay; so do `views` where nothing reads them. Pages that several others refer to
    make a small file endless. Raises `sqlite3.Error` for one that cannot be read.
    """
    check_beside(path)
    check_file_size(path)
    with closing(open_database(path)) as database:
        database.set_progress_handler(lambda: 1, STEPS + STEPS_PER_BYTE * path.stat().st_size)
        # a definition may be stored as bytes, which SQLite reads as text
        for name, sql in database.execute("SELECT name, CAST(sql AS TEXT) FROM sqlite_master WHERE sql IS NOT NULL"):
            if VIRTUAL.match(sql) and not INDEXES.match(sql):
                raise InputError(f"{path} has a virtual table ({name!a:.40}); export its layer to a new GeoPackage.")
            if RECURSIVE.match(sql) or (VIEW.match(sql) and not views):
                raise InputError(f"{path} computes {name!a:.40} when it is read; export its layer to a new GeoPackage.")
        computed = database.execute(
            "SELECT name FROM gpkg_geometry_columns, pragma_table_xinfo(table_name) WHERE hidden > 1"
        ).fetchone()
        if computed:
            raise InputError(
                f"{path} computes {computed[0]!a:.40} when it is read; export its layer to a new GeoPackage."
            )
        sound = database.execute("PRAGMA quick_check(1)").fetchone()[0]
    if sound != "ok":
        raise InputError(f"{path} is damaged; export it again.")


def check_parquet(path: Path) -> None:
    """Refuse what would become too large when it is unpacked, by what its footer says."""
    import pyarrow.parquet as pq

    check_file_size(path)
    meta = pq.read_metadata(path)
    size = sum(meta.row_group(k).total_byte_size for k in range(meta.num_row_groups))
    if size > LARGEST_TABLE or meta.num_rows > MOST_ROWS:
        raise InputError(
            f"{path} holds {meta.num_rows:,} rows of {size / 1e9:,.0f} GB when it is unpacked, too many to be true of "
            "an orchard; cut it to size."
        )


def check_nesting(binary: Iterable[bytes | None], path: Path) -> None:
    """Refuse well-known binary whose geometries are nested too deeply; short ones cannot be."""
    for index, blob in enumerate(binary):
        if isinstance(blob, bytes) and len(blob) > 9 * 1_000 and _depth(blob) > DEEPEST:
            raise InputError(f"{path}: feature {index} (counted from 0) is nested too deeply; mend or remove it.")


def _depth(blob: bytes) -> int:
    """How deeply geometries are nested, as far as the binary can be followed; no further than is allowed."""
    at, left = 0, [1]  # how many geometries are still to come, at each level
    try:
        while left and len(left) <= DEEPEST:
            if not left[-1]:
                left.pop()
                continue
            left[-1] -= 1
            order = "<" if blob[at] == 1 else ">"
            (code,) = struct.unpack_from(f"{order}I", blob, at + 1)
            at += 9 if code & 0x20000000 else 5
            kind, measures = (code & 0xFFFF) % 1000, (code & 0xFFFF) // 1000
            numbers = 2 + bool(code & 0x80000000 or measures in (1, 3)) + bool(code & 0x40000000 or measures in (2, 3))
            if kind == 1:
                at += 8 * numbers
                continue
            (count,) = struct.unpack_from(f"{order}I", blob, at)
            at += 4
            if kind in (2, 8):
                at += 8 * numbers * count
            elif kind in (3, 17):
                for _ in range(count):
                    (points,) = struct.unpack_from(f"{order}I", blob, at)
                    at += 4 + 8 * numbers * points
            else:
                left.append(count)
    except (struct.error, IndexError):
        pass  # cut off, which its reader says
    return len(left)
