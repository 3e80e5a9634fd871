"""Which trees may be the same, and how likely each pair is, at a given placement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.transform import Affine, FloatArray, Model
from treereg_icp.confined import Confined

# So many reference trees compete for a source tree.
NEAREST = 3
# A typical tree's odds of having no partner, against one within reach of it.
STRANGERS = 0.07
# Residuals never count as smaller than this share of the reach: copies of one survey fit exactly.
LEAST_SIGMA = 0.01
# Crowns that differ by more standard deviations (squared) than this tell no more.
LEAST_LIKE = 12.0
# By how much two crowns of the same size, being the same, beat two of any size.
TYPICAL = 1.4


@dataclass(frozen=True)
class Weights:
    """What counts in a pair: `reach` in metres, and the powers of confidence and of likeness of crowns.

    `elsewhere`: the odds of a pair outside matched rows against one in them; 0: never.
    """

    reach: float
    confidence: float
    crown: float
    elsewhere: float


@dataclass(frozen=True, eq=False)
class Pairs:
    """Possible pairs (k,): positions in reference and source, and their weights in a fit.

    `sigma` is the standard deviation of their residuals per axis, metres.
    """

    search: Search
    i: IntArray
    j: IntArray
    weight: FloatArray
    sigma: float

    def fit(self, model: Model) -> Affine:
        """The transform of the source that suits the pairs best. Raises `NoRegistration` when they do not say."""
        reference, source = self.search.reference.features, self.search.source.features
        try:
            return model.fit(source.xy[self.j], reference.xy[self.i], self.weight)
        except ValueError:
            raise NoRegistration("the trees within reach of each other do not determine a transform") from None


class Search:
    """Looks for the pairs of two surveys under changing placements."""

    def __init__(self, weights: Weights, reference: Confined, source: Confined, threads: int) -> None:
        self.weights, self.reference, self.source, self.threads = weights, reference, source, threads
        self.reach = weights.reach
        self.strange = self._strange(reference.features), self._strange(source.features)
        self.tree = cKDTree(self._places(reference, reference.features.xy))

    def pairs(self, moved: FloatArray, before: Pairs | None) -> Pairs:
        """All pairs within reach when the source's trees stand at `moved`, each with its probability as weight."""
        reference, source = self.reference.features, self.source.features
        sigma = before.sigma if before else self.reach / 2
        places = self._places(self.source, moved)
        distance, target = nearest(self.tree, places, self.reach, NEAREST, self.threads, source.tree.indices)
        j, column = np.nonzero(target < self.tree.n)
        i, square = target[j, column], distance[j, column] ** 2
        stranger = STRANGERS * 2 * sigma**2 / self.reach**2 * self.strange[0][i] * self.strange[1][j]
        odds = np.exp(-square / (2 * sigma**2))
        odds *= np.where(self.reference.row[i] == self.source.row[j], 1.0, self.weights.elsewhere)
        odds *= self._likeness(reference.area[i] / source.area[j], odds / (odds + stranger))
        rivals = np.bincount(i, odds, len(reference))[i] + np.bincount(j, odds, len(source))[j] - odds
        probability = odds / (rivals + stranger)
        if not probability.sum() > 0:
            raise NoRegistration("no trees of the two surveys are within reach of each other")
        sigma = max(float(np.sqrt(probability @ square / (2 * probability.sum()))), LEAST_SIGMA * self.reach)
        return Pairs(self, i, j, reference.weight[i] * source.weight[j] * probability, sigma)

    def _places(self, trees: Confined, xy: FloatArray) -> FloatArray:
        """Where trees are sought, rows apart when no tree has a partner outside its own."""
        return trees.points(xy) if self.weights.elsewhere == 0 else xy

    def _strange(self, features: FeatureSet) -> FloatArray:
        """How much likelier each tree is a stranger than the survey's typical one."""
        confidence = np.maximum(features.confidence, 1e-3)
        return np.asarray(np.clip(confidence / confidence.mean(), 0.1, 3) ** -self.weights.confidence)

    def _likeness(self, area_ratio: FloatArray, probability: FloatArray) -> FloatArray:
        """How well the crowns of each pair agree against the typical true pair; growth is what pairs have in common."""
        if self.weights.crown == 0 or len(area_ratio) == 0:
            return np.ones(len(area_ratio))
        difference = np.log(area_ratio)
        difference = difference - _median(difference, probability)
        spread = max(1.4826 * _median(np.abs(difference), probability), 1e-3)
        square = np.minimum((difference / spread) ** 2, LEAST_LIKE)
        return np.asarray(TYPICAL * np.exp(-self.weights.crown / 2 * square))


def _median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
