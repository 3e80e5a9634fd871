"""GeoPackage, GeoParquet and GeoDataFrames: geometry, one property, or every row as a GeoJSON feature."""

from __future__ import annotations

import json
import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io.crs import WGS84, parse_crs
from treereg_core.io.feature_pieces import T, Use
from treereg_core.io.files import first_line, reading
from treereg_core.io.jsontext import plain
from treereg_core.io.shapes import shapes
from treereg_core.io.untrusted import check_geopackage, check_parquet, open_database
from treereg_core.parts import parts

if TYPE_CHECKING:
    import pyarrow as pa
    from geopandas import GeoDataFrame
    from pyproj import CRS


@dataclass(frozen=True, eq=False)
class Table:
    """A table with a geometry: `geometry` (n,) shapely or None in `crs`, `properties` without it, `ids` of the rows."""

    geometry: NDArray[np.object_]
    properties: pa.Table
    crs: CRS | None
    ids: list[int] | None = None

    def values(self, name: str | None) -> list[Any]:
        """The values of one property, None for each row if there is no such column."""
        known = name in self.properties.column_names
        return self.properties.column(name).to_pylist() if known else [None] * len(self.geometry)

    def in_pieces(self, use: Use[T]) -> list[T]:
        """What `use` makes of the rows as GeoJSON features, some at a time, in order, coordinates in `crs`."""
        return [use(self._features(part), part.start) for part in parts(len(self.geometry))]

    def _features(self, part: slice) -> list[dict[str, Any]]:
        import shapely

        geometry = self.geometry[part]
        ids = [{}] * len(geometry) if self.ids is None else [{"id": i} for i in self.ids[part]]
        properties = self.properties.slice(part.start, len(geometry))
        rows = properties.to_pylist() if properties.num_columns else [{}] * len(geometry)
        return [
            {
                "type": "Feature",
                **identity,
                "properties": {key: plain(value) for key, value in row.items()},
                "geometry": shape and json.loads(shape),
            }
            for identity, row, shape in zip(ids, rows, shapely.to_geojson(geometry), strict=True)
        ]


def read_table(path: Path, columns: list[str] | None = None) -> Table:
    """Read a GeoPackage or GeoParquet file, with these properties only (None: all). `InputError` if it cannot be."""
    start = _magic(path)
    if path.suffix == ".gpkg":
        if start != b"SQLite format 3\0":
            raise InputError(f"{path} is not a GeoPackage, or is damaged; export it again.")
        with reading(path, "GeoPackage"), _quiet():
            check_geopackage(path)
            with _left_alone(path) as file:
                return _geopackage(file, columns, path)
    if start[:4] != b"PAR1":
        raise InputError(f"{path} is not a Parquet file, or is damaged; export it again.")
    with reading(path, "GeoParquet"), _quiet():
        check_parquet(path)
        return _geoparquet(path, columns)


def table_of(frame: GeoDataFrame, path: Path, columns: list[str] | None = None) -> Table:
    """A GeoDataFrame as a table, with these properties only (None: all); `path` is its name in errors."""
    import pandas as pd
    import pyarrow as pa

    geometry = frame.active_geometry_name
    if geometry is None:
        raise InputError(f"{path} is a GeoDataFrame without a geometry column; name one with set_geometry.")
    # shapes beside the active geometry are no properties
    others = [name for name in frame.columns if str(frame[name].dtype) == "geometry"]
    named = [name for name in frame.columns if name not in others and (columns is None or name in columns)]
    try:
        properties = pa.Table.from_pandas(pd.DataFrame(frame[named]), preserve_index=False)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise InputError(f"{path} has a column of mixed types ({first_line(error)}); make it of one type.") from error
    return Table(
        geometry=np.asarray(frame.geometry.array, dtype=object),
        properties=properties,
        crs=frame.crs.to_2d() if frame.crs else None,
    )


def _magic(path: Path) -> bytes:
    with reading(path, "a file"), path.open("rb") as file:
        return file.read(16)


@contextmanager
def _quiet() -> Iterator[None]:
    """What third-party readers warn of is either checked here or of no concern to users."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@contextmanager
def _left_alone(path: Path) -> Iterator[Path]:
    """A GeoPackage for GDAL to read: a copy of one whose log holds changes, which GDAL would write into it."""
    log = Path(f"{path}-wal")
    if not log.exists() or not log.stat().st_size:
        yield path
        return
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        with closing(open_database(path)) as database, closing(sqlite3.connect(copy)) as other:
            database.backup(other)
        yield copy


def _geopackage(file: Path, columns: list[str] | None, path: Path) -> Table:
    import pyogrio

    layers = [str(name) for name, kind in pyogrio.list_layers(file) if kind is not None]
    if len(layers) != 1:
        found = f"the layers {', '.join(layers)}" if layers else "no layer with geometry"
        raise InputError(f"{path} holds {found}; keep exactly one layer of polygons.")
    meta, table = pyogrio.raw.read_arrow(file, layer=layers[0], columns=columns, return_fids=True)
    fid, geometry = meta["fid_column"] or "OGC_FID", meta["geometry_name"] or "wkb_geometry"
    return Table(
        geometry=shapes(table.column(geometry).to_pylist(), path),
        properties=table.drop_columns([geometry, fid]),
        crs=parse_crs(meta["crs"], path) if meta["crs"] else None,
        ids=table.column(fid).to_pylist(),
    )


def _geoparquet(path: Path, columns: list[str] | None) -> Table:
    import geopandas
    import pyarrow.parquet as pq

    schema = pq.read_schema(path)
    if b"geo" not in (schema.metadata or {}):
        raise InputError(f"{path} is Parquet without geometry; export it as GeoParquet.")
    meta = json.loads(schema.metadata[b"geo"])
    primary = meta["primary_column"]
    crs = parquet_crs(meta["columns"][primary], path)
    if meta["columns"][primary]["encoding"] == "WKB":
        geometry = shapes(pq.read_table(path, columns=[primary]).column(0).to_pylist(), path)
    else:
        geometry = np.asarray(geopandas.read_parquet(path, columns=[primary]).geometry.array, dtype=object)
    wanted = [
        name
        for name in schema.names
        if name not in meta["columns"]
        and not name.startswith("__index_level_")
        and (columns is None or name in columns)
    ]
    return Table(geometry=geometry, properties=pq.read_table(path, columns=wanted), crs=crs)


def parquet_crs(column: dict[str, Any], path: Path) -> CRS | None:
    """The CRS that the metadata of a geometry column name: WGS 84 where it names none, None where it is not known."""
    crs = column.get("crs", WGS84)
    return None if crs is None else parse_crs(crs if isinstance(crs, str) else json.dumps(crs), path)
