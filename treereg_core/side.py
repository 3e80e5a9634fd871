"""Side: one survey as the evidence sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtri

from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.footprint import Footprint
from treereg_core.transform import FloatArray

# The neighbourhood that a tree's crown is compared with.
NEIGHBOURS = 24
# Classes of confidence, equally many trees in each.
CLASSES = 3


def neighbourhoods(xy: FloatArray, tree: cKDTree) -> IntArray:
    """The trees around each tree at `xy` (n, 2), itself among them, (n, k); `tree` holds the same trees."""
    _, near = nearest(tree, xy, np.inf, min(NEIGHBOURS + 1, max(len(xy) // 3, 2)), order=tree.indices)
    return near


def local_scores(values: FloatArray, near: IntArray) -> FloatArray:
    """Normal scores of `values` (n,) after the median of each tree's neighbourhood, `near` (n, k), is removed.

    What varies smoothly over a field (vigour, growth, light) is removed, what sets a tree apart from its neighbours
    stays. Clipped to two and a half; all zero when the values do not vary.
    """
    n = len(values)
    if n < 3 or np.ptp(values) < 1e-9 * max(1.0, float(np.abs(values).max())):
        return np.zeros(n)
    local = values - np.median(values[near], axis=1)
    # ranks, equal values at the middle of theirs
    _, inverse, counts = np.unique(local, return_inverse=True, return_counts=True)
    middle = np.cumsum(counts) - (counts + 1) / 2
    return np.clip(ndtri((middle + 0.5) / n), -2.5, 2.5)[inverse]


@dataclass(frozen=True, eq=False)
class Side:
    """One survey as the evidence sees it."""

    features: FeatureSet
    footprint: Footprint
    confidence_class: IntArray
    scores: dict[str, FloatArray]

    @classmethod
    def of(cls, features: FeatureSet, reach: float, names: tuple[str, ...]) -> Side:
        """Prepare a survey: its footprint, closed over `reach` metres, and the scores of the attributes `names`.

        The same survey is prepared once, however many searches and judgements look at it.
        """
        key = (cls, reach, names)
        if key not in features.derived:
            features.derived[key] = cls._prepared(features, reach, names)
        side: Side = features.derived[key]
        return side

    @classmethod
    def _prepared(cls, features: FeatureSet, reach: float, names: tuple[str, ...]) -> Side:
        # A crown is known to one per cent at best; what is finer in a file is its rounding.
        area = np.round(np.log(features.area / np.median(features.area)), 2).astype(np.float64)
        values = {"area": area, "confidence": features.confidence, **features.attributes}
        near = neighbourhoods(features.xy, features.tree)
        scores = {name: local_scores(values[name], near) for name in names}
        edges = np.quantile(features.confidence, np.arange(1, CLASSES) / CLASSES)
        return cls(features, Footprint.of(features.xy, reach), np.searchsorted(edges, features.confidence), scores)
