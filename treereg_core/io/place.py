"""A survey in the working frame: unusable features dropped, areas and centroids measured."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.heights import HEIGHT, Heights
from treereg_core.io.capture import FEWEST_TREES, Capture, too_few
from treereg_core.io.crs import to_frame
from treereg_core.io.heights import read_heights
from treereg_core.io.layer import Layer
from treereg_core.io.polygons import polygonal
from treereg_core.outlines import Outlines
from treereg_core.parts import parts
from treereg_core.survey import Frame, Survey
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from shapely import Geometry

LEAST_AREA_M2 = 1e-4
AREA_STEP = 0.001
FARTHEST_BOUNDARY_M = 2_000.0
MANY_UNKNOWN = 0.1
"""Share of the trees without a height that is worth a warning."""


def place(capture: Capture, frame: Frame) -> Survey:
    """The survey in the working frame, its unusable features dropped."""
    import shapely

    layer = capture.layer
    path = layer.path
    polygons = np.concatenate([_in_frame(part, layer.crs, frame) for part in _parts(layer.geometry)])
    if not all(np.isfinite(shapely.get_coordinates(part)).all() for part in _parts(polygons)):
        raise InputError(f"{path} lies where {frame.crs:.40} cannot reach; give two surveys of one orchard.")
    polygons, usable, warnings = _usable(polygons, path)
    ids = np.flatnonzero(usable)
    if len(ids) < FEWEST_TREES:
        raise too_few(path, len(ids), len(polygons))
    features = FeatureSet(
        ids=ids,
        xy=shapely.get_coordinates(shapely.centroid(polygons[ids])),
        confidence=capture.confidence[ids],
        area=_areas(polygons[ids]),
        weight=np.ones(len(ids)),
    )
    boundary, boundary_warnings = _boundary(capture, features, frame)
    heights, height_warnings = _heights(capture.files.dem, polygons[ids], frame)
    tall = heights.attribute(features) if heights else None
    return Survey(
        path=capture.files.folder,
        detections=path,
        table=capture.table,
        features=features if tall is None else features.replace(attributes={HEIGHT: tall}),
        frame=frame,
        count=len(polygons),
        digest=_digest(capture),
        boundary=boundary,
        heights=heights,
        warnings=capture.warnings + warnings + boundary_warnings + height_warnings,
        visible=capture.files.visible,
        dem=capture.files.dem,
        outlines=Outlines.of(polygons[ids]),
        stamps=capture.stamps,
    )


def _in_frame(geometry: NDArray[np.object_], crs: str, frame: Frame) -> NDArray[np.object_]:
    import shapely

    return np.asarray(shapely.transform(shapely.force_2d(geometry), lambda xy: to_frame(xy, crs, frame)))


def _parts(geometry: NDArray[np.object_]) -> Iterator[NDArray[np.object_]]:
    """Geometries some at a time, at least once."""
    return (geometry[part] for part in parts(len(geometry)))


def _digest(capture: Capture) -> str:
    """Of the outlines in the file's own CRS and the confidences: what a survey is known by."""
    import shapely

    digest = hashlib.blake2b(capture.layer.crs.encode(), digest_size=16)
    for part in _parts(capture.layer.geometry):
        for outline in shapely.to_wkb(shapely.force_2d(part)):
            digest.update(outline or b"none")
    digest.update(capture.confidence.tobytes())
    return digest.hexdigest()


def _areas(polygons: NDArray[np.object_]) -> FloatArray:
    """Areas in steps of a thousandth around their median, square metres.

    What is finer is the rounding of coordinates in the file. Of crowns that are all alike it would make a pattern that
    tells every tree from the next, and a lattice against itself would look certain.
    """
    import shapely

    area = shapely.area(polygons)
    median = np.median(area)
    return np.asarray(median * np.exp(np.round(np.log(area / median) / AREA_STEP) * AREA_STEP))


def _usable(
    polygons: NDArray[np.object_], path: Path
) -> tuple[NDArray[np.object_], NDArray[np.bool_], tuple[str, ...]]:
    """The polygons repaired, which of them are usable, and a warning that counts what was done."""
    import shapely

    polygons = polygons.copy()
    absent = shapely.is_missing(polygons) | shapely.is_empty(polygons)
    unsound = ~absent & ~(shapely.is_valid(polygons) & np.isin(shapely.get_type_id(polygons), (3, 6)))
    for i in np.flatnonzero(unsound):
        polygons[i] = polygonal(polygons[i])
    flat = ~absent & ~(shapely.area(polygons) >= LEAST_AREA_M2)
    sound = np.flatnonzero(~absent & ~flat)
    known_by = [shapely.to_wkb(shapely.normalize(part)) for part in _parts(polygons[sound])]
    _, first = np.unique(np.concatenate(known_by), return_index=True)
    duplicate = np.zeros(len(polygons), dtype=bool)
    duplicate[sound] = True
    duplicate[sound[first]] = False
    usable = ~(absent | flat | duplicate)
    counts = {
        "without geometry": absent.sum(),
        "without area": flat.sum(),
        "a duplicate of another": duplicate.sum(),
    }
    told = []
    if (unsound & usable).any():
        told.append(f"{(unsound & usable).sum()} with invalid outlines repaired")
    if not usable.all():
        reasons = ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)
        told.append(f"{(~usable).sum()} dropped ({reasons})")
    return polygons, usable, (f"{path}: of {len(polygons)} features, {' and '.join(told)}.",) if told else ()


def _heights(path: Path | None, polygons: NDArray[np.object_], frame: Frame) -> tuple[Heights | None, tuple[str, ...]]:
    """The heights of canopies, with a warning when many have none; None without an elevation raster, or any height."""
    if path is None:
        return None, ()
    heights, warnings = read_heights(path, polygons, frame)
    if not heights.known:
        return None, warnings
    missing = len(polygons) - heights.known
    if missing > MANY_UNKNOWN * len(polygons):
        warnings += (f"{path} does not tell the height of {missing} of {len(polygons)} trees.",)
    return heights, warnings


def _boundary(capture: Capture, features: FeatureSet, frame: Frame) -> tuple[Geometry | None, tuple[str, ...]]:
    """The outline in the working frame; None, with a warning, when it lies elsewhere than the trees."""
    import shapely

    layer = capture.boundary
    if layer is None:
        return None, ()
    outline = _outline(layer, frame)
    trees = shapely.multipoints(features.xy)
    if outline is not None and shapely.distance(outline, trees) <= FARTHEST_BOUNDARY_M:
        return outline, ()
    swapped = _outline(layer, frame, swapped=True) if layer.geographic else None
    if swapped is not None and shapely.distance(swapped, trees) <= FARTHEST_BOUNDARY_M:
        raise InputError(
            f"{capture.layer.path} and {layer.path} agree only when longitude and latitude are swapped in one of them; "
            "write longitude first in both."
        )
    return None, (f"{layer.path} lies more than 2 km from the trees and is not used; correct it or remove it.",)


def _outline(layer: Layer, frame: Frame, swapped: bool = False) -> Geometry | None:
    """The polygons of a layer as one, in the working frame; None where that does not reach."""
    import shapely

    step = -1 if swapped else 1
    moved = shapely.transform(shapely.force_2d(layer.geometry), lambda xy: to_frame(xy[:, ::step], layer.crs, frame))
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        return None
    outline = shapely.union_all([polygonal(geometry) for geometry in moved if geometry is not None])
    if outline.is_empty:
        raise InputError(f"{layer.path} holds no polygon; draw the orchard's outline as one, or remove the file.")
    return outline
