"""Results as GeoDataFrames, and GeoDataFrames moved as the source is."""

from __future__ import annotations

import sys
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import InputError, UsageError
from treereg_core.features import FeatureSet
from treereg_core.io import geojson
from treereg_core.io.crs import WGS84, crs_name, parse_crs
from treereg_core.io.grid import Motion, moved
from treereg_core.io.shapes import Shapes, move_shapes
from treereg_core.io.writing import matched, source_features
from treereg_core.judgement import Matches
from treereg_core.method import Described
from treereg_core.survey import Survey
from treereg_core.transform import Affine, FloatArray

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

ASKED = Path("the argument crs")
"""The name in errors of a CRS that is asked for."""
GIVEN = Path("the GeoDataFrame")
"""The name in errors of what is to be moved."""


def is_geoframe(value: object) -> bool:
    """Whether a value is a GeoDataFrame; whoever holds one has imported geopandas."""
    geopandas = sys.modules.get("geopandas")
    return geopandas is not None and isinstance(value, geopandas.GeoDataFrame)


def registered_geoframe(
    source: Survey | FeatureSet, motion: Motion | Affine, described: Described, crs: str | None = None
) -> GeoDataFrame:
    """The source, moved, in `crs` (None: the motion's): all features with all their properties, in their order.

    The index is that of the GeoDataFrame, or counts the features of the file. What is known of the usable trees becomes
    columns, NaN for the others. Trees that were given as arrays become points; their motion is a transform, and there
    is no CRS. Raises `InputError` for a CRS that is unknown or does not reach here.
    """
    import geopandas

    if isinstance(source, FeatureSet) or isinstance(motion, Affine):
        return _points(source, motion, described, crs)
    target = _asked(crs) or motion.crs
    if source.table is None:
        _, own, each = source_features(source)
        properties, geometry = zip(*each(partial(_rows, source.detections)), strict=True)
        frame = geopandas.GeoDataFrame(list(chain.from_iterable(properties)), geometry=np.concatenate(geometry))
    else:
        frame, own = source.table.copy(), _crs_of(source.table) or WGS84
    move = partial(_moved, crs=own, motion=motion, target=target)
    shapes = move_shapes(np.asarray(frame.geometry.array, dtype=object), move, source.detections)
    frame = frame.set_geometry(shapes, crs=target)
    for name, values in described[1].items():
        column = np.full(len(frame), np.nan)
        column[source.features.ids] = values
        frame[name] = column
    return frame


def _rows(path: Path, features: list[dict[str, Any]], first: int) -> tuple[list[dict[str, Any]], Shapes]:
    """The properties and the geometry of features."""
    properties = [feature.get("properties") for feature in features]
    return [item if isinstance(item, dict) else {} for item in properties], geojson.geometries(features, first, path)


def _points(source: Any, transform: Any, described: Described, crs: str | None) -> GeoDataFrame:
    """Trees of arrays at the places where a transform takes them."""
    import geopandas

    if crs is not None:
        raise UsageError("trees that are given as arrays have no CRS, so the result cannot be had in another one")
    columns = {"confidence": source.confidence, "area": source.area, **source.attributes, **described[1]}
    points = geopandas.points_from_xy(*transform(source.xy).T)
    return geopandas.GeoDataFrame(columns, geometry=points, index=source.ids)


def matches_geoframe(
    surveys: tuple[Survey, Survey] | tuple[FeatureSet, FeatureSet],
    transform: Affine,
    matches: Matches,
    described: Described,
    crs: str | None = None,
) -> GeoDataFrame:
    """The matched pairs as lines in `crs` (None: the working CRS), with the properties of tree_matches.geojson.

    `reference` and `source` are labels of the index of what was given as a GeoDataFrame. `transform` is
    `reference_from_source` in the working frame. Raises `InputError` for a CRS that is unknown or does not reach here.
    """
    import geopandas
    import shapely

    columns: dict[str, Any] = {}
    trees = [survey.features if isinstance(survey, Survey) else survey for survey in surveys]
    known, lines = matched((trees[0], trees[1]), transform, matches, described)
    for name, survey in zip(("reference", "source"), surveys, strict=True):
        table = survey.table if isinstance(survey, Survey) else None
        columns[name] = known[name] if table is None else table.index.take(known[name])
    frame = surveys[0].frame if isinstance(surveys[0], Survey) else None
    if frame is None and crs is not None:
        raise UsageError("trees that are given as arrays have no CRS, so the result cannot be had in another one")
    target = _asked(crs) or (frame and frame.crs)
    if frame and target:
        still = Motion(frame.crs, Affine.identity())
        full = lines.reshape(-1, 2) + np.asarray(frame.origin)
        lines = _moved(full, crs=frame.crs, motion=still, target=target).reshape(lines.shape)
    return geopandas.GeoDataFrame({**known, **columns}, geometry=shapely.linestrings(lines), crs=target)


def move_geoframe(frame: GeoDataFrame, motion: Motion | Affine) -> GeoDataFrame:
    """Any features of the source survey, moved, in the CRS they have; a transform moves coordinates as they stand.

    Raises `InputError` where the motion has a CRS and the features have none.
    """
    move: Any = motion
    if isinstance(motion, Motion):
        own = _crs_of(frame)
        if own is None:
            raise InputError(f"{GIVEN} has no CRS; say with set_crs which it is in.")
        move = partial(_moved, crs=own, motion=motion, target=own)
    shapes = move_shapes(np.asarray(frame.geometry.array, dtype=object), move, GIVEN)
    return frame.set_geometry(shapes, crs=frame.crs)


def _asked(crs: str | None) -> str | None:
    return None if crs is None else crs_name(parse_crs(crs, ASKED))


def _crs_of(frame: GeoDataFrame) -> str | None:
    return crs_name(frame.crs.to_2d()) if frame.crs else None


def _moved(xy: FloatArray, *, crs: str, motion: Motion, target: str) -> FloatArray:
    there = moved(xy, crs, motion, target)
    if not np.isfinite(there).all():
        raise InputError(f"the result lies where {target:.40} does not reach; ask for another CRS.")
    return there
