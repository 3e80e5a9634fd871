"""Writing the trees of a series: a table as GeoParquet, and the same as GeoJSON. Every file is complete or absent."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.io.complete import complete_file
from treereg_core.io.crs import from_frame
from treereg_core.io.geojson_writing import write_columns
from treereg_core.survey import Frame

Columns = Mapping[str, np.ndarray[Any, Any]]
"""Columns (n,) by name; whole numbers that are not known are masked, other numbers NaN."""


def write_tree_table(columns: Columns, crs: str, path: Path) -> None:
    """Write columns as GeoParquet, a point at `x` and `y` in `crs` to each line; what is not known is null.

    Raises `InputError` when `path` cannot be written.
    """
    import geopandas
    import pandas as pd

    values: dict[str, Any] = {}
    for name, column in columns.items():
        masked = isinstance(column, np.ma.MaskedArray)
        values[name] = pd.arrays.IntegerArray(np.ma.getdata(column), np.ma.getmaskarray(column)) if masked else column
    points = geopandas.points_from_xy(columns["x"], columns["y"])
    with complete_file(path) as file:
        geopandas.GeoDataFrame(values, geometry=points, crs=crs).to_parquet(file, index=False)


def write_tree_points(columns: Columns, crs: str, path: Path) -> None:
    """Write the same as GeoJSON in WGS 84 with 9 decimals. Raises `InputError` when `path` cannot be written."""
    full = Frame(crs, (0.0, 0.0))
    lonlat = np.round(from_frame(np.column_stack([columns["x"], columns["y"]]), full), 9)
    write_columns({name: _plain(column) for name, column in columns.items()}, "Point", lonlat, path)


def _plain(column: np.ndarray[Any, Any]) -> list[Any]:
    """The values as JSON has them."""
    if column.dtype.kind == "f":
        column = np.ma.masked_invalid(column)
    return list(column.tolist())
