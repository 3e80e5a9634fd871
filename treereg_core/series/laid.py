"""Laid: one survey of a series, laid on the first one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.features import FeatureSet, IntArray, frozen_array
from treereg_core.footprint import Footprint
from treereg_core.transform import Affine, FloatArray

CLASSES = 5
"""Classes of confidence, and of crown, by rank within the survey."""
AROUND = 20
"""So many trees are around a tree."""
REACH = 2.5
"""A survey's ground is closed over so many spacings."""


@dataclass(frozen=True, eq=False)
class Laid:
    """One survey laid on the first one; arrays have an entry for each tree, in the survey's order.

    `xy` (n, 2): where they stand there, metres; `log_area` (n,): natural logarithm of the crown over the survey's
    median, or over what trees in common say (`sized`); `confidence` (n,); `ground`: what the survey covers there.
    """

    xy: FloatArray
    log_area: FloatArray
    confidence: FloatArray
    ground: Footprint

    @classmethod
    def of(cls, features: FeatureSet, first_from_survey: Affine, spacing: float) -> Laid:
        """A survey's trees under the transform that takes it to the first one, where trees are so many metres apart."""
        xy = frozen_array(first_from_survey(features.xy))
        log_area = np.log(features.area)
        ground = Footprint.of(xy, REACH * spacing)
        return cls(xy, frozen_array(log_area - np.median(log_area)), features.confidence, ground)

    def sized(self, growth: float) -> Laid:
        """The same survey with logarithms of crowns less this."""
        return replace(self, log_area=frozen_array(self.log_area - growth))

    @cached_property
    def classes(self) -> IntArray:
        """The classes of confidence and of crown of each tree, (2, n)."""
        return np.array([_classes(self.confidence), _classes(self.log_area)])

    @cached_property
    def around(self) -> IntArray:
        """The trees nearest to each tree (n, k), itself left aside."""
        count = min(AROUND + 1, len(self.xy))
        near = np.empty((len(self.xy), count), dtype=np.int64)
        # asked in the order of space, which is much faster
        order = self.tree.indices
        near[order] = self.tree.query(self.xy[order], k=count)[1].reshape(-1, count)
        return near[:, 1:]

    @cached_property
    def tree(self) -> cKDTree:
        """A k-d tree over `xy`, built once."""
        return cKDTree(self.xy)

    @property
    def ground_m2(self) -> float:
        """The area that it covers, square metres."""
        return float(np.count_nonzero(self.ground.mask)) * self.ground.cell**2

    def log_strangers(self, tree: FloatArray) -> FloatArray:
        """For each detection (n,) the logarithm of how dense strangers, which show no tree, are that look like it.

        To a square metre, over the share of trees that look like it: by its classes of confidence and of crown. `tree`
        (n,) is the probability that a detection shows a tree.
        """
        found = np.full(len(tree), np.log((1 + float(np.sum(1 - tree))) / self.ground_m2))
        for classes in self.classes:
            trees, strangers = (np.bincount(classes, weight, CLASSES) + 1 / CLASSES for weight in (tree, 1 - tree))
            found += np.log(strangers / strangers.sum() / (trees / trees.sum()))[classes]
        return found


def _classes(values: FloatArray) -> IntArray:
    """The class of each value by its rank, equally many in each; equal values are of one class."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    middle = np.cumsum(counts) - counts / 2
    return np.asarray(middle * CLASSES / max(len(values), 1), dtype=np.int64)[inverse]
