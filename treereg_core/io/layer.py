"""Layer: what one vector file holds, its geometry still in the file's own CRS."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io import geojson
from treereg_core.io.crs import WGS84, converter, crs_name, parse_crs
from treereg_core.io.feature_pieces import in_pieces
from treereg_core.io.files import collector_paused
from treereg_core.io.tables import read_table, table_of
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from pyproj import CRS

MOST_POINTS = 5_000
"""An invalid outline of more points is refused: repairing it could take minutes."""
MARGIN_DEG = 6.0
"""How far beyond a CRS's area of use coordinates may lie before its tag is taken to be wrong."""


@dataclass(frozen=True, eq=False)
class Layer:
    """The features of one vector file, in the file's order.

    - `geometry` (n,): shapely geometries or None, coordinates in `crs`, finite and in range.
    - `values`: one property of each feature; None where it has none.
    - `lonlat` (n, 2): one point of each feature, WGS 84 degrees; NaN where it has no geometry.
    """

    path: Path
    geometry: NDArray[np.object_]
    crs: str
    values: list[Any]
    lonlat: FloatArray
    geographic: bool
    warnings: tuple[str, ...]


def read_layer(path: Path, name: str | None = None) -> Layer:
    """Read a vector file with the values of one property. `InputError` for anything that cannot be used."""
    return _checked(path, *(_read_geojson(path, name) if path.suffix == ".geojson" else _read_table(path, name)))


def layer_of(frame: GeoDataFrame, path: Path, name: str) -> Layer:
    """The same of a GeoDataFrame; `path` is its name in errors."""
    table = table_of(frame, path, [name])
    return _checked(path, table.geometry, table.values(name), table.crs)


def _checked(path: Path, geometry: NDArray[np.object_], values: list[Any], crs: CRS | None) -> Layer:
    """The layer, whose coordinates are finite and lie where its CRS says."""
    import shapely

    xy, owner = shapely.get_coordinates(geometry, return_index=True)
    warnings: tuple[str, ...] = ()
    if crs is None:
        crs = _guess_crs(xy, owner, path)
        warnings = (f"{path} has no CRS; its coordinates look like longitude and latitude and are taken as WGS 84.",)
    bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(bad):
        raise InputError(
            f"{path}: feature {owner[bad[0]]} (counted from 0) has coordinates that are not finite numbers; "
            "mend or remove it."
        )
    many = np.flatnonzero(shapely.get_num_coordinates(geometry) > MOST_POINTS)
    tangled = many[~shapely.is_valid(geometry[many])]
    if len(tangled):
        raise InputError(
            f"{path}: feature {tangled[0]} (counted from 0) has an invalid outline of more than {MOST_POINTS} points, "
            "too many to repair; simplify or remove it."
        )
    name_of_crs = crs_name(crs)
    if crs.is_geographic:
        _check_degrees(xy, owner, path)
    else:
        _check_projected(xy, owner, crs, path)
    lonlat = np.full((len(geometry), 2), np.nan)
    owners, first = np.unique(owner, return_index=True)
    lonlat[owners] = converter(name_of_crs, WGS84)(xy[first])
    return Layer(path, geometry, name_of_crs, values, lonlat, crs.is_geographic, warnings)


def _read_geojson(path: Path, name: str | None) -> tuple[NDArray[np.object_], list[Any], CRS | None]:
    def used(features: list[dict[str, Any]], first: int) -> tuple[NDArray[np.object_], list[Any]]:
        properties = [feature.get("properties") for feature in features]
        values = [item.get(name) if isinstance(item, dict) else None for item in properties]
        return geojson.geometries(features, first, path), values

    with collector_paused():
        document, found = in_pieces(path, used)
    geometry, values = zip(*found, strict=True)
    return np.concatenate(geometry), list(chain.from_iterable(values)), geojson.crs_of(document, path)


def _read_table(path: Path, name: str | None) -> tuple[NDArray[np.object_], list[Any], CRS | None]:
    table = read_table(path, [name] if name else [])
    return table.geometry, table.values(name), table.crs


def _sizes(xy: FloatArray, owner: NDArray[np.int64]) -> float:
    """The median width of the features, in units of their coordinates."""
    starts = np.flatnonzero(np.r_[True, np.diff(owner) > 0])
    return float(np.median(np.maximum.reduceat(xy[:, 0], starts) - np.minimum.reduceat(xy[:, 0], starts)))


def _looks_like_degrees(xy: FloatArray, owner: NDArray[np.int64]) -> bool:
    """Whether coordinates are in the range of degrees and the features far too small to be canopies in metres."""
    if len(xy) == 0 or not (np.abs(xy) <= (180, 90)).all():
        return False
    return _sizes(xy, owner) < 0.01


def _guess_crs(xy: FloatArray, owner: NDArray[np.int64], path: Path) -> CRS:
    if not _looks_like_degrees(xy, owner):
        raise InputError(f"{path} has no CRS, and its coordinates are not longitude and latitude; assign its CRS.")
    return parse_crs(WGS84, path)


def _check_degrees(xy: FloatArray, owner: NDArray[np.int64], path: Path) -> None:
    """Latitudes within 90 and longitudes within 180 degrees (a field may run on a little beyond the antimeridian)."""
    out = np.flatnonzero((np.abs(xy[:, 0]) > 181) | (np.abs(xy[:, 1]) > 90))
    if not len(out):
        return
    x, y = xy[out[0]]
    where = f"{path}: feature {owner[out[0]]} (counted from 0) has longitude {x:.6g} and latitude {y:.6g}"
    if (np.abs(xy[:, 0]) <= 90).all() and (np.abs(xy[:, 1]) <= 181).all():
        raise InputError(
            f"{where}, which is out of range: longitude and latitude are probably swapped; write longitude first."
        )
    if np.median(np.abs(xy), axis=0).max() > 360:
        raise InputError(
            f"{where}, which are not degrees: the coordinates are probably projected; name their CRS in the file, "
            "or export it in WGS 84."
        )
    raise InputError(f"{where}, which is out of range; correct its coordinates or remove it.")


def _check_projected(xy: FloatArray, owner: NDArray[np.int64], crs: CRS, path: Path) -> None:
    """Coordinates must lie where their CRS is of use, a margin allowed."""
    if len(xy) == 0:
        return
    name = crs_name(crs) if crs.to_authority() else f"its CRS ({crs.name})"
    if _looks_like_degrees(xy, owner):
        raise InputError(
            f"{path} says {name}, but its coordinates are degrees; name the CRS they are in (WGS 84 is EPSG:4326)."
        )
    lonlat = converter(crs_name(crs), WGS84)(xy)
    out = np.flatnonzero(~_in_area(lonlat, crs))
    if not len(out):
        return
    hint = ""
    if _in_area(converter(crs_name(crs), WGS84)(xy[:, ::-1]), crs).all():
        hint = ": easting and northing are probably swapped"
    raise InputError(
        f"{path}: feature {owner[out[0]]} (counted from 0) at {xy[out[0], 0]:.10g}, {xy[out[0], 1]:.10g} lies far "
        f"outside the area where {name} is used{hint}; correct the CRS or the coordinates."
    )


def _in_area(lonlat: FloatArray, crs: CRS) -> NDArray[np.bool_]:
    finite = np.isfinite(lonlat[:, 0]) & np.isfinite(lonlat[:, 1])
    area = crs.area_of_use
    if area is None:
        return finite
    width = (area.east - area.west) % 360 or 360
    with np.errstate(invalid="ignore"):
        east_of_west = (lonlat[:, 0] - (area.west - MARGIN_DEG)) % 360
        beyond = np.stack(
            [
                east_of_west > width + 2 * MARGIN_DEG,
                lonlat[:, 1] < area.south - MARGIN_DEG,
                lonlat[:, 1] > area.north + MARGIN_DEG,
            ]
        )
    return finite & ~beyond.any(axis=0)
