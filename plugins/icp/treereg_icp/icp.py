"""Iterative closest point over tree centroids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.method import Context, PointMatcher, Registration
from treereg_core.pair import Pair, Rows
from treereg_core.transform import Affine, FloatArray, Model
from treereg_icp.bend import local_bend

SETTLED = 1e-5
NEAREST = 3
STRANGERS = 0.07
LEAST_SIGMA = 0.01
LEAST_LIKE = 12.0
TYPICAL = 1.4
BENT = 4.0


class Icp(PointMatcher):
    """Iterative closest point (Besl & McKay 1992, doi:10.1109/34.121791), robust and with a shrinking reach.

    Each round finds the few reference trees nearest to every source tree and within reach, weighs each such pair by
    the probability that it is one, and fits the model to all of them by weighted least squares (expectation
    maximisation, after Granger & Pennec 2002, doi:10.1007/3-540-47979-1_28). A pair competes with every other pair of
    its two trees and with the possibility that either is a stranger, which is likelier where the detector was less
    sure; near trees with crowns of like size, growth aside, win. The spread of the residuals is fitted too, so that
    the reach shrinks by itself as the fit gets better. Maps are sometimes bent against each other: where neighbouring
    residuals agree more than chance allows, trees look for their partners where the bend puts them; what is fitted
    stays one transform over all of them. When rows are matched, a tree is sought in the partner row only.

    Good when the start is within half the tree spacing everywhere: it then ends within a few per cent of a fit to the
    true pairs. It is blind to the lattice: from a start further off it ends one tree or one row over with a perfect
    residual, which is why the start is a global search by default and a judge has the last word.
    """

    name = "icp"

    reach: float = Field(
        0.8,
        gt=0,
        le=10,
        description="distance beyond which two trees are never a pair",
        json_schema_extra={"unit": "tree spacings"},
    )
    confidence_weight: float = Field(
        0.5, ge=0, le=4, description="how much likelier a tree of low confidence is a stranger; 0: not at all"
    )
    crown_weight: float = Field(1.0, ge=0, le=4, description="how much crowns of like size count; 0: not at all")
    bends: int = Field(
        12, ge=0, le=100, description="most rounds with a bend; 0: partners stand where one transform says"
    )
    bend_width: float = Field(
        6.0,
        gt=0,
        le=100,
        description="width of the window whose mean residual is taken for a bend, as a standard deviation",
        json_schema_extra={"unit": "tree spacings"},
    )
    rounds: int = Field(60, ge=1, le=1000, description="most rounds before it stops")

    def register(self, pair: Pair, context: Context) -> Registration:
        """Pair trees near the current transform and fit the model to them, until nothing moves any more.

        Raises `NoRegistration` when the pairs do not determine the model.
        """
        reference, source = _confined(pair)
        if min(len(reference.features), len(source.features)) < 3 or pair.reference.spacing == 0:
            raise NoRegistration("there are too few trees to match")
        search = _Search(self, reference, source, context)
        transform, pairs = pair.reference_from_source, None
        for _ in range(self.rounds):
            moved = transform(source.features.xy)
            pairs = search.pairs(moved, pairs)
            transform = pairs.fit(context.model)
            if np.abs(transform(source.features.xy) - moved).max() < SETTLED:
                break
        assert pairs is not None
        for _ in range(self.bends):
            moved = transform(source.features.xy)
            residual = reference.features.xy[pairs.i] - moved[pairs.j]
            width = self.bend_width * pair.reference.spacing
            bend = local_bend(moved[pairs.j], residual, pairs.weight, moved, width)
            if bend.signal < BENT:
                break
            pairs = search.pairs(moved + bend.displacement, pairs)
            transform = pairs.fit(context.model)
        ids = np.column_stack([reference.features.ids[pairs.i], source.features.ids[pairs.j]])
        return Registration(transform, ids, pairs.weight)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Possible pairs (k,): positions in reference and source, their weights in the fit, and the residuals' spread."""

    search: _Search
    i: IntArray
    j: IntArray
    weight: FloatArray
    sigma: float

    def fit(self, model: Model) -> Affine:
        reference, source = self.search.reference.features, self.search.source.features
        try:
            return model.fit(source.xy[self.j], reference.xy[self.i], self.weight)
        except ValueError:
            raise NoRegistration("the trees within reach of each other do not determine a transform") from None


class _Search:
    """Looks for the pairs of two surveys under changing placements."""

    def __init__(self, icp: Icp, reference: _Confined, source: _Confined, context: Context) -> None:
        self.icp, self.reference, self.source, self.threads = icp, reference, source, context.threads
        self.reach = icp.reach * reference.features.spacing
        self.strange = self._strange(reference.features), self._strange(source.features)
        self.tree = cKDTree(reference.points(reference.features.xy))

    def pairs(self, moved: FloatArray, before: _Pairs | None) -> _Pairs:
        """All pairs within reach when the source's trees stand at `moved`, each with its probability as weight."""
        reference, source = self.reference.features, self.source.features
        sigma = before.sigma if before else self.reach / 2
        distance, target = nearest(self.tree, self.source.points(moved), self.reach, NEAREST, self.threads)
        j, column = np.nonzero(target < self.tree.n)
        i, square = target[j, column], distance[j, column] ** 2
        stranger = STRANGERS * 2 * sigma**2 / self.reach**2 * self.strange[0][i] * self.strange[1][j]
        odds = np.exp(-square / (2 * sigma**2))
        odds *= self._likeness(reference.area[i] / source.area[j], odds / (odds + stranger))
        rivals = np.bincount(i, odds, len(reference))[i] + np.bincount(j, odds, len(source))[j] - odds
        probability = odds / (rivals + stranger)
        if not probability.sum() > 0:
            raise NoRegistration("no trees of the two surveys are within reach of each other")
        sigma = max(float(np.sqrt(probability @ square / (2 * probability.sum()))), LEAST_SIGMA * self.reach)
        return _Pairs(self, i, j, reference.weight[i] * source.weight[j] * probability, sigma)

    def _strange(self, features: FeatureSet) -> FloatArray:
        """How much likelier each tree is a stranger than the survey's typical one."""
        confidence = np.maximum(features.confidence, 1e-3)
        return np.asarray(np.clip(confidence / confidence.mean(), 0.1, 3) ** -self.icp.confidence_weight)

    def _likeness(self, area_ratio: FloatArray, probability: FloatArray) -> FloatArray:
        """How well the crowns of each pair agree against the typical true pair; growth is what pairs have in common."""
        if self.icp.crown_weight == 0 or len(area_ratio) == 0:
            return np.ones(len(area_ratio))
        difference = np.log(area_ratio)
        difference = difference - _median(difference, probability)
        spread = max(1.4826 * _median(np.abs(difference), probability), 1e-3)
        square = np.minimum((difference / spread) ** 2, LEAST_LIKE)
        return np.asarray(TYPICAL * np.exp(-self.icp.crown_weight / 2 * square))


def _median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


@dataclass(frozen=True, eq=False)
class _Confined:
    """Trees as points in (x, y, row): rows stand so far apart that no neighbour is found in another one."""

    features: FeatureSet
    row: FloatArray

    def points(self, xy: FloatArray) -> FloatArray:
        return np.column_stack([xy, 1e7 * self.row])


def _confined(pair: Pair) -> tuple[_Confined, _Confined]:
    """All trees of both surveys, or those of matched rows, labelled by their match."""
    rows = pair.rows
    if rows is None or len(rows.matches) == 0:
        return _Confined(pair.reference, np.zeros(len(pair.reference))), _Confined(
            pair.source, np.zeros(len(pair.source))
        )
    return (
        _labelled(pair.reference, rows.reference, rows.matches[:, 0]),
        _labelled(pair.source, rows.source, rows.matches[:, 1]),
    )


def _labelled(features: FeatureSet, rows: Rows, which: IntArray) -> _Confined:
    trees = [rows.trees[k] for k in which]
    label = np.repeat(np.arange(len(which)), [len(row) for row in trees])
    at = features.positions(np.concatenate(trees))
    return _Confined(features.take(at[at >= 0]), label[at >= 0].astype(np.float64))
