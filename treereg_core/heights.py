"""Heights: how high each tree of a survey stands, and on what ground, as its elevation raster says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import FeatureSet, IntArray, frozen_array, nearest
from treereg_core.transform import FloatArray

HEIGHT = "height"
"""The attribute of trees that holds it, metres."""
ENOUGH = 0.8
"""Trees have the attribute when at least this share of them has a height."""
NEIGHBOURS = 9
FEWEST_PAIRS = 5


@dataclass(frozen=True, eq=False)
class Heights:
    """Of the trees of one survey (n,): `height` above the ground and the `ground`'s elevation, metres.

    Elevations are of the survey's own datum. NaN where the raster does not tell.
    """

    height: FloatArray
    ground: FloatArray

    def __post_init__(self) -> None:
        for name in ("height", "ground"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    @property
    def known(self) -> int:
        """How many trees have a height."""
        return int(np.isfinite(self.height).sum())

    def attribute(self, features: FeatureSet) -> FloatArray | None:
        """Heights (n,) of all of these trees, metres; None when too few are known.

        A tree without one gets the median of the nearest trees that have one, which says nothing of that tree alone.
        """
        known = np.flatnonzero(np.isfinite(self.height))
        if len(known) < max(ENOUGH * len(features), 1):
            return None
        values = self.height.copy()
        unknown = np.flatnonzero(np.isnan(values))
        if len(unknown):
            there = features.take(known)
            count = min(NEIGHBOURS, len(known))
            _, near = nearest(there.tree, features.xy[unknown], np.inf, count)
            values[unknown] = np.median(self.height[known][near.reshape(-1, count)], axis=1)
        return values


@dataclass(frozen=True)
class VerticalOffset:
    """What the source's elevations lack against the reference's, metres.

    `median` over `trees` matched trees, of the ground that they stand on; `spread` is the standard deviation that
    their middle half is worth. It is reported, never applied.
    """

    median: float
    spread: float
    trees: int


def vertical_offset(reference: Heights, source: Heights, pairs: IntArray) -> VerticalOffset | None:
    """The offset between the elevations of two surveys, from pairs (k, 2) of positions of the same tree.

    None when hardly any of them has ground in both.
    """
    apart = reference.ground[pairs[:, 0]] - source.ground[pairs[:, 1]]
    apart = apart[np.isfinite(apart)]
    if len(apart) < FEWEST_PAIRS:
        return None
    low, median, high = np.quantile(apart, [0.25, 0.5, 0.75])
    return VerticalOffset(float(median), float(high - low) / 1.349, len(apart))
