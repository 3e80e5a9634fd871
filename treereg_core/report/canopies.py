"""The trees of one survey as the page reads them: whole centimetres, outlines with few corners."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.method import Described
from treereg_core.outlines import Outlines
from treereg_core.result import Result, trees
from treereg_core.survey import Survey
from treereg_core.transform import FloatArray

FINE, COARSE = 0.05, 0.12
"""Outlines keep within this share of the usual crown's radius; the coarser of a survey of many trees."""
MANY = 50_000
MOST = 200_000
"""Of more trees no outlines are kept; the page draws circles of their area."""


def canopies(result: Result) -> tuple[dict[str, Any], dict[str, Any]]:
    """The trees of reference and source, each in its own place in the working frame.

    `x`, `y`, the centroids, are centimetres. `outline` is null, or `ring` with the number of corners of each ring,
    `tree` with its tree, and `xy`: the corners, each as steps east and north from the one before in centimetres, the
    first of a ring from its tree's centroid.
    """
    described: Described = result.described
    first, second = (
        _canopies(survey, known) for survey, known in zip((result.reference, result.source), described, strict=True)
    )
    return first, second


def _canopies(survey: Survey | FeatureSet, described: Mapping[str, FloatArray]) -> dict[str, Any]:
    features = trees(survey)
    xy = _centimetres(features.xy)
    outlines = survey.outlines if isinstance(survey, Survey) else None
    attributes = {**features.attributes, **described}
    return {
        "id": features.ids.tolist(),
        "x": xy[:, 0].tolist(),
        "y": xy[:, 1].tolist(),
        "confidence": _rounded(features.confidence, 3),
        "area_m2": _rounded(features.area, 2),
        "attributes": {name: _rounded(values, 3) for name, values in sorted(attributes.items())},
        "outline": _outline(outlines, features, xy) if outlines and len(features) <= MOST else None,
    }


def _outline(outlines: Outlines, features: FeatureSet, centre: IntArray) -> dict[str, Any]:
    import shapely

    share = FINE if len(features) <= MANY else COARSE
    tolerance = share * float(np.sqrt(np.median(features.area) / np.pi))
    rings = shapely.linearrings(outlines.xy.astype(np.float64), indices=outlines.ring)
    xy, ring = shapely.get_coordinates(shapely.simplify(rings, tolerance), return_index=True)
    last = np.append(np.diff(ring) > 0, True)
    xy, ring = _centimetres(xy)[~last], ring[~last]
    first = np.append(True, np.diff(ring) > 0)
    before = np.where(first[:, None], centre[outlines.tree[ring]], np.roll(xy, 1, axis=0))
    return {
        "ring": np.bincount(ring, minlength=len(rings)).tolist(),
        "tree": outlines.tree.tolist(),
        "xy": (xy - before).ravel().tolist(),
    }


def _centimetres(xy: FloatArray) -> IntArray:
    return np.asarray(np.round(xy * 100), dtype=np.int64)


def _rounded(values: FloatArray, digits: int) -> list[float]:
    return [float(value) for value in np.round(values, digits).tolist()]
