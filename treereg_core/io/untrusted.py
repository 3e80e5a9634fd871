"""What is asked of a vector file before it is read: that it is of a size that can be, and runs nothing of its own."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path

from treereg_core.errors import InputError

LARGEST_FILE = 4 * 2**30
"""A vector file of more bytes is refused; a million trees take about half a gigabyte."""
LARGEST_TABLE = 16 * 2**30
"""A Parquet file that says it becomes more bytes when it is unpacked is refused."""
MOST_ROWS = 50_000_000
"""So is one of more rows, which can be packed into nearly nothing."""
INDEXES = re.compile(r"\s*CREATE\s+VIRTUAL\s+TABLE\s.*\sUSING\s+(rtree|fts[345])\b", re.IGNORECASE | re.DOTALL)
VIRTUAL = re.compile(r"\s*CREATE\s+VIRTUAL\b", re.IGNORECASE)


def check_file_size(path: Path) -> None:
    """Refuse a file that is too large to be held. Raises `OSError` where there is none."""
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(f"{path} has {size / 1e9:,.0f} GB, too much to be true of an orchard; cut it to size.")


def check_geopackage(path: Path) -> None:
    """Refuse a database whose content is computed, by other modules of SQLite or without an end.

    Indexes are virtual tables too, and stay. Raises `sqlite3.Error` for one that cannot be read.
    """
    check_file_size(path)
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        stored = database.execute("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall()
    for name, sql in stored:
        if VIRTUAL.match(str(sql)) and not INDEXES.match(str(sql)):
            raise InputError(f"{path} has a virtual table ({name!a:.40}); export its layer to a new GeoPackage.")
        if re.search(r"\bRECURSIVE\b", str(sql), re.IGNORECASE):
            raise InputError(f"{path} computes {name!a:.40} when it is read; export its layer to a new GeoPackage.")


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
