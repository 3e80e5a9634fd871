"""Moving vector files: format, properties, order, names, CRS and heights stay, positions move."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io import geojson
from treereg_core.io.complete import complete_file
from treereg_core.io.crs import crs_name
from treereg_core.io.feature_pieces import check_pieces, in_pieces
from treereg_core.io.files import collector_paused, reading
from treereg_core.io.geojson_writing import feature_lines, write_lines
from treereg_core.io.geopackage import move_geopackage
from treereg_core.io.grid import Motion, moved
from treereg_core.io.json_pieces import NotInPieces, items_of, read_whole
from treereg_core.io.jsontext import json_line
from treereg_core.io.shapefile import move_shapefile, shapefile_parts
from treereg_core.io.shapes import move_shapes, shapes, to_wkb
from treereg_core.io.tables import parquet_crs
from treereg_core.io.untrusted import check_parquet
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

VECTOR_SUFFIXES = (".geojson", ".json", ".gpkg", ".parquet", ".geoparquet", ".shp")
Move = Callable[[FloatArray], FloatArray]


def is_vector(path: Path) -> bool:
    """Whether a file of this name is taken as a vector file."""
    return path.suffix.lower() in VECTOR_SUFFIXES


def holds_geojson(path: Path) -> bool:
    """Whether a JSON file calls itself GeoJSON. `InputError` for one that is not JSON."""
    document: Any = {}
    try:
        deque(items_of(path, "features", document), 0)
    except NotInPieces:
        document = read_whole(path)
    kind = document.get("type") if isinstance(document, dict) else None
    return kind in ("FeatureCollection", "Feature", *geojson.GEOMETRY_TYPES)


def vector_names(path: Path) -> tuple[str, ...]:
    """The names of the files that moving a vector file writes."""
    if path.suffix.lower() == ".shp":
        return tuple(part.name for part in shapefile_parts(path))
    return (path.name,)


def move_vector(path: Path, motion: Motion, folder: Path) -> None:
    """Write a vector file, moved, into a folder under its own name; complete or not at all.

    GeoJSON has 9 decimals. Raises `InputError` for a file that cannot be read, has no CRS, or lies where the CRS of the
    motion does not reach.
    """

    def mover(crs: CRS) -> Move:
        return partial(_moved, crs_name(crs.to_2d()), motion, path)

    match path.suffix.lower():
        case ".gpkg":
            move_geopackage(path, mover, folder)
        case ".shp":
            move_shapefile(path, mover, folder)
        case ".parquet" | ".geoparquet":
            _move_geoparquet(path, mover, folder)
        case _:
            _move_geojson(path, mover, folder)


def _moved(crs: str, motion: Motion, path: Path, xy: FloatArray) -> FloatArray:
    there = moved(xy, crs, motion, crs)
    if not np.isfinite(there).all():
        raise InputError(f"{path} lies where the transform's CRS does not reach; correct the CRS of one of them.")
    return there


def _move_geojson(path: Path, mover: Callable[[CRS], Move], folder: Path) -> None:
    target = folder / path.name
    with collector_paused():
        document = check_pieces(path)
        move = mover(geojson.crs_of(document, path))
        if document["type"] != "FeatureCollection":
            geojson.move(geojson.features_of(document, path), move, path)
            with complete_file(target) as file:
                file.write(json_line({key: item for key, item in document.items() if key != "bbox"}) + b"\n")
            return

        def written(features: list[dict[str, Any]], first: int) -> bytes:
            geojson.move(features, move, path)
            return feature_lines(features, target)

        rest = {key: item for key, item in document.items() if key not in ("type", "features", "bbox")}
        write_lines(in_pieces(path, written)[1], target, rest)


def _move_geoparquet(path: Path, mover: Callable[[CRS], Move], folder: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with reading(path, "GeoParquet"):
        check_parquet(path)
        table = pq.read_table(path)
        known = dict(table.schema.metadata or {})
        if b"geo" not in known:
            raise InputError(f"{path} is Parquet without geometry; export it as GeoParquet.")
        meta = json.loads(known[b"geo"])
        for name, column in meta["columns"].items():
            if column["encoding"] != "WKB":
                raise InputError(f"{path} has geometry in {column['encoding']:.40}; export it with geometry as WKB.")
            crs = parquet_crs(column, path)
            if crs is None:
                raise InputError(f"{path} has no CRS; assign it.")
            there = move_shapes(shapes(table.column(name).to_pylist(), path), mover(crs), path)
            at, field = table.schema.get_field_index(name), table.schema.field(name)
            table = table.set_column(at, field, pa.array(to_wkb(there), field.type))
            _bound(column, there)
            table = _with_boxes(table, column, there)
        schema = table.schema.with_metadata(known | {b"geo": json.dumps(meta).encode()})
    with complete_file(folder / path.name) as file:
        pq.write_table(table.replace_schema_metadata(schema.metadata), file)


def _bound(column: dict[str, Any], geometry: NDArray[np.object_]) -> None:
    """Write the new bounds where there were some."""
    import shapely

    if "bbox" in column:
        low_high = shapely.total_bounds(geometry).tolist()
        old = column["bbox"]
        heights = [old[2], old[5]] if len(old) == 6 else []
        column["bbox"] = [*low_high[:2], *heights[:1], *low_high[2:], *heights[1:]]


def _with_boxes(table: Any, column: dict[str, Any], geometry: NDArray[np.object_]) -> Any:
    """The table with new boxes of each row, where a column holds them."""
    import pyarrow as pa
    import shapely

    boxes = column.get("covering", {}).get("bbox")
    if not boxes:
        return table
    name = boxes["xmin"][0]
    at, field = table.schema.get_field_index(name), table.schema.field(name)
    old = table.column(name).combine_chunks()
    fresh = dict(zip(("xmin", "ymin", "xmax", "ymax"), shapely.bounds(geometry).T, strict=True))
    inner = {boxes[side][1]: values for side, values in fresh.items()}
    parts = [
        pa.array(np.where(np.isfinite(inner[part.name]), inner[part.name], None), part.type)
        if part.name in inner
        else old.field(part.name)
        for part in field.type
    ]
    return table.set_column(at, field, pa.StructArray.from_arrays(parts, fields=list(field.type)))
