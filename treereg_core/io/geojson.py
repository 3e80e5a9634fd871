"""GeoJSON (RFC 7946): from JSON to polygons, and moving every position of a document.

The JSON itself is read, not through GDAL: that keeps order, nested properties, big integers and ids as they stand,
and is faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io.crs import parse_crs
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

GEOMETRY_TYPES = {
    "Point": 0,
    "MultiPoint": 1,
    "LineString": 1,
    "MultiLineString": 2,
    "Polygon": 2,
    "MultiPolygon": 3,
    "GeometryCollection": 0,
}
"""The depth at which each type of geometry holds its positions."""
LARGEST = 1e300
"""A coordinate that is not smaller is no number to reckon with."""


def kind_of(document: Any, path: Path) -> str:
    """The type of a GeoJSON document; `InputError` for what is none."""
    if not isinstance(document, dict) or not isinstance(document.get("type"), str):
        raise InputError(f"{path} is JSON but not GeoJSON; export the polygons as a GeoJSON FeatureCollection.")
    kind: str = document["type"]
    if kind not in GEOMETRY_TYPES and kind not in ("Feature", "FeatureCollection"):
        raise InputError(f"{path} has the type {kind!r:.60}, which is not GeoJSON; export a GeoJSON FeatureCollection.")
    return kind


def features_of(document: Any, path: Path) -> list[dict[str, Any]]:
    """The features of a GeoJSON document, each checked to be one; a lone feature or geometry counts as a collection."""
    kind = kind_of(document, path)
    if kind == "Feature":
        features: Any = [document]
    elif kind == "FeatureCollection":
        features = document.get("features")
    else:
        features = [{"type": "Feature", "properties": None, "geometry": document}]
    if not isinstance(features, list):
        raise InputError(f"{path} has no list of features; export the polygons as a GeoJSON FeatureCollection.")
    check_features(features, 0, path)
    return features


def check_features(features: list[Any], first: int, path: Path) -> None:
    """Refuse what is no feature with a geometry or null; `first` is the number of the first one."""
    for i, feature in enumerate(features, first):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise InputError(f"{path}: item {i} (counted from 0) is not a GeoJSON Feature; mend or remove it.")
        _check_geometry(feature.get("geometry"), i, path)


def _check_geometry(geometry: Any, index: int, path: Path) -> None:
    """Every geometry, nested ones included, must be null or have a known type and a list; no recursion."""
    todo = [geometry]
    while todo:
        item = todo.pop()
        if item is None:
            continue
        known = isinstance(item, dict) and isinstance(item.get("type"), str) and item["type"] in GEOMETRY_TYPES
        content = known and item.get("geometries" if item["type"] == "GeometryCollection" else "coordinates")
        if not isinstance(content, list):
            raise InputError(
                f"{path}: feature {index} (counted from 0) has a geometry that is not GeoJSON; mend or remove it."
            )
        if item["type"] == "GeometryCollection":
            todo.extend(content)


def crs_of(document: dict[str, Any], path: Path) -> CRS:
    """The CRS of a GeoJSON document: WGS 84, unless a legacy `crs` member names another."""
    member = document.get("crs")
    if member is None:
        return parse_crs("OGC:CRS84", path)
    properties = member.get("properties") if isinstance(member, dict) else None
    properties = properties if isinstance(properties, dict) else {}
    name = properties.get("name", properties.get("code"))
    if isinstance(name, int):
        name = f"EPSG:{name}"
    if not isinstance(name, str):
        raise InputError(f"{path} has a 'crs' member that names no CRS; name one, such as EPSG:32734, or remove it.")
    return parse_crs(name, path)


def geometries(features: list[dict[str, Any]], first: int, path: Path) -> NDArray[np.object_]:
    """The geometry of each feature as a shapely one, None where it has none. `InputError` names the first bad one.

    `first` is the number of the first feature. Rings are closed; rings of fewer than three positions are left out.
    """
    import shapely

    result = np.full(len(features), None, dtype=object)
    rings: list[list[Any]] = []
    polygon_of_ring: list[int] = []
    feature_of_polygon: list[int] = []
    feature_of_ring: list[int] = []
    for i, feature in enumerate(features):
        geometry = feature.get("geometry")
        if geometry is None:
            continue
        if geometry["type"] not in ("Polygon", "MultiPolygon"):
            result[i] = _other_geometry(geometry, first + i, path)
            continue
        coordinates = geometry["coordinates"]
        for polygon in [coordinates] if geometry["type"] == "Polygon" else coordinates:
            kept = _rings(polygon, first + i, path)
            if kept:
                rings += kept
                polygon_of_ring += [len(feature_of_polygon)] * len(kept)
                feature_of_ring += [i] * len(kept)
                feature_of_polygon.append(i)
    if not rings:
        return result
    lengths = np.fromiter(map(len, rings), dtype=np.int64)
    xy = _xy(list(chain.from_iterable(rings)), first + np.repeat(feature_of_ring, lengths), path)
    linear_rings = shapely.linearrings(xy, indices=np.repeat(np.arange(len(rings)), lengths))
    polygons = shapely.polygons(linear_rings, indices=np.array(polygon_of_ring))
    filled, part_of, counts = np.unique(feature_of_polygon, return_inverse=True, return_counts=True)
    single = counts == 1
    result[filled[single]] = polygons[single[part_of]]
    if not single.all():
        several = np.cumsum(~single) - 1
        many = ~single[part_of]
        result[filled[~single]] = shapely.multipolygons(polygons[many], indices=several[part_of[many]])
    return result


def _rings(polygon: Any, index: int, path: Path) -> list[list[Any]]:
    """The rings of one polygon that enclose something; none if its outline does not."""
    if not isinstance(polygon, list) or not all(isinstance(ring, list) for ring in polygon):
        raise _bad_position(index, path)
    sound = [len(ring) > 3 or (len(ring) == 3 and ring[0] != ring[2]) for ring in polygon]
    if all(sound):
        return polygon
    if not all(map(is_position, chain.from_iterable(polygon))):
        raise _bad_position(index, path)
    return [ring for ring, is_sound in zip(polygon, sound, strict=True) if is_sound] if sound[0] else []


def _xy(positions: list[Any], feature_of_position: NDArray[np.int64], path: Path) -> FloatArray:
    """Positions as an array (n, 2), without further dimensions. `InputError` names the feature of the first bad one."""
    xy = _numbers(positions)
    if xy is not None:
        return xy
    for position, index in zip(positions, feature_of_position, strict=True):
        if not is_position(position):
            raise _bad_position(int(index), path)
    raise _bad_position(int(feature_of_position[0]), path)


def _numbers(positions: list[Any]) -> FloatArray | None:
    """Positions as an array (n, 2), all checked at once; None when one of them is none, or too large."""
    if set(map(type, positions)) != {list}:
        return None
    lengths = set(map(len, positions))
    if min(lengths) < 2:
        return None
    flat = list(chain.from_iterable(positions if lengths == {2} else [p[:2] for p in positions]))
    if not set(map(type, flat)) <= {int, float}:
        return None
    try:
        xy = np.array(flat, dtype=np.float64).reshape(-1, 2)
    except OverflowError:
        return None
    return xy if bool((np.abs(xy) < LARGEST).all()) else None


def is_position(value: Any) -> bool:
    """Whether a JSON value is a position: a list of at least two finite numbers."""
    return (
        isinstance(value, list)
        and len(value) >= 2
        and all(type(v) in (int, float) and abs(v) < LARGEST for v in value[:2])
    )


def _bad_position(index: int, path: Path) -> InputError:
    return InputError(
        f"{path}: feature {index} (counted from 0) has coordinates that are not finite numbers; mend or remove it."
    )


def _other_geometry(geometry: dict[str, Any], index: int, path: Path) -> Any:
    from shapely.geometry import shape

    for position in positions_of([geometry]):
        if not is_position(position):
            raise _bad_position(index, path)
    try:
        return shape(geometry)
    except Exception as error:
        raise InputError(
            f"{path}: feature {index} (counted from 0) has a broken {geometry['type']}; mend or remove it."
        ) from error


def positions_of(shapes: Iterable[dict[str, Any] | None]) -> list[Any]:
    """Every position in GeoJSON geometries, in order, as the very lists that stand in them."""
    found: list[Any] = []
    todo = list(shapes)[::-1]
    while todo:
        geometry = todo.pop()
        if geometry is None:
            continue
        if geometry["type"] == "GeometryCollection":
            todo.extend(geometry["geometries"][::-1])
            continue
        level = [geometry["coordinates"]]
        if not level[0]:
            continue
        for _ in range(GEOMETRY_TYPES[geometry["type"]]):
            level = list(chain.from_iterable(part for part in level if isinstance(part, list)))
        found += level
    return found


def move(features: list[dict[str, Any]], moved: Callable[[FloatArray], FloatArray], path: Path) -> None:
    """Move every position of the features in place; a third dimension stays, and boxes (`bbox`) go, being outdated."""
    shapes = [feature.get("geometry") for feature in features]
    positions = positions_of(shapes)
    if positions:
        xy = _numbers(positions)
        if xy is None:
            raise InputError(f"{path} has coordinates that are not finite numbers; mend or remove them.")
        for position, new in zip(positions, np.round(moved(xy), 9).tolist(), strict=True):
            position[:2] = new
    for item in chain(features, (shape for shape in shapes if shape)):
        item.pop("bbox", None)
