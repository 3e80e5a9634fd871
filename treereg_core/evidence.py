"""Evidence: how well a placement explains the trees, tree by tree, by one likelihood for all methods.

Three things tell a right placement from one that is a tree or a row off: trees that stand where the other survey has
none, the size of crowns (and any other attribute that both surveys have, but for heights), and the small errors of
planting. Each tree gets the log of p(what is seen | the placement is right) over p(the same | it is a decoy), the
decoys being other placements of the same two surveys on each other's lattice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from treereg_core.features import WORTH_THREADS, BoolArray, FeatureSet, IntArray, nearest
from treereg_core.heights import HEIGHT
from treereg_core.side import CLASSES, Side
from treereg_core.threads import concurrently
from treereg_core.transform import Affine, FloatArray, Model

# So many pairs of a placement count as much as what is known of decoys.
CHANCE_PAIRS = 20
# Metres: no detector places a tree better, and what is finer in a file is its rounding.
RESOLUTION = 0.02
# The largest correlation that is believed.
SURE = 0.9
# Normal scores have variance 1; less than this share of it is what ties leave.
LEAST_VARIANCE = 0.5
# Trees that are found twice stand next to each other, and a search in steps of that distance would never end: the
# spacing is at least this share of the distance to a tree's eighth neighbour.
CLOSEST, NEIGHBOURS = 0.1, 8
# So many trees tell how far their neighbours are.
MEASURED = 20_000


def spacing_of(features: FeatureSet) -> float:
    """The spacing of a survey, metres, as evidence and searches take it: positive, and not that of doubles."""
    if len(features) <= NEIGHBOURS:
        return max(features.spacing, 1e-6)
    some = features.xy[:: 1 + len(features) // MEASURED]
    distance, _ = features.tree.query(some, k=[NEIGHBOURS + 1])
    return max(features.spacing, CLOSEST * float(np.median(distance)), 1e-6)


def second_moments(xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroid (2,) and covariance (2, 2) of points."""
    centre = xy.mean(axis=0)
    return centre, (xy - centre).T @ (xy - centre) / len(xy)


@dataclass(frozen=True, eq=False)
class Match:
    """The one-to-one pairs of one placement and which trees it can say something about.

    `reference`, `source` (k,) are positions, `distance` (k,) metres; `covered_reference` (n,) and `covered_source`
    (m,) tell which trees lie in the other survey's footprint.
    """

    transform: Affine
    reference: IntArray
    source: IntArray
    distance: FloatArray
    covered_reference: BoolArray
    covered_source: BoolArray

    @property
    def rate(self) -> float:
        """Share of covered trees, both ways, that have a partner."""
        covered = int(self.covered_reference.sum()) + int(self.covered_source.sum())
        mine = self.covered_reference[self.reference].sum() + self.covered_source[self.source].sum()
        return float(mine / covered) if covered else 0.0


@dataclass(frozen=True, eq=False)
class Statistics:
    """What pairs look like: match rate by confidence class and side, residual variance, correlation by attribute."""

    rate_reference: FloatArray
    rate_source: FloatArray
    variance: float
    correlation: dict[str, float]
    pairs: int

    def better_than(self, decoy: Statistics) -> Statistics:
        """The same, but nowhere worse than a decoy's, and less what chance gives to few pairs.

        Without the first two different orchards score high: their pairs differ from the decoys', only not for the
        better. Without the second a small overlap does.
        """
        trust = self.pairs / (self.pairs + CHANCE_PAIRS)
        chance = 1 / math.sqrt(max(self.pairs, 1))

        def better(mine: FloatArray, its: FloatArray) -> FloatArray:
            return np.maximum(trust * mine + (1 - trust) * its, its)

        return Statistics(
            better(self.rate_reference, decoy.rate_reference),
            better(self.rate_source, decoy.rate_source),
            min(trust * self.variance + (1 - trust) * decoy.variance, decoy.variance),
            {k: max(r - chance, decoy.correlation[k]) for k, r in self.correlation.items()},
            self.pairs,
        )


def mean_statistics(statistics: Sequence[Statistics]) -> Statistics:
    """What the pairs of several placements look like on the whole, by their number of pairs."""
    weight = np.array([s.pairs for s in statistics], dtype=np.float64) + 1
    weight /= weight.sum()

    def mean(values: Sequence[FloatArray]) -> FloatArray:
        return np.asarray(weight @ np.array(values))

    return Statistics(
        mean([s.rate_reference for s in statistics]),
        mean([s.rate_source for s in statistics]),
        float(weight @ [s.variance for s in statistics]),
        {k: float(weight @ [s.correlation[k] for s in statistics]) for k in statistics[0].correlation},
        round(float(weight @ [s.pairs for s in statistics])),
    )


class Evidence:
    """Two surveys, ready to be judged under many placements.

    `gate` is the distance in metres beyond which two trees are not a pair.
    """

    def __init__(self, reference: FeatureSet, source: FeatureSet, threads: int = 1) -> None:
        self.spacing = spacing_of(reference)
        self.gate = 0.45 * self.spacing
        # Heights are read off a raster where a survey says that its trees are. If both use one raster, detections on
        # the same spot have the same height, and the files' own georeference looks right whatever it is.
        shared = set(reference.attributes) & set(source.attributes) - {HEIGHT}
        self.names = ("area", "confidence", *sorted(shared))
        reach = 2.5 * self.spacing
        self._spread = second_moments(source.xy)
        self.threads = threads if max(len(reference), len(source)) > WORTH_THREADS else 1
        self.reference, self.source = concurrently(
            lambda features: Side.of(features, reach, self.names), (reference, source), self.threads
        )

    def apart(self, a: Affine, b: Affine) -> float:
        """How far two placements put the source's trees from each other, metres, RMS."""
        linear = a.linear - b.linear
        centre, covariance = self._spread
        shift = linear @ centre + a.shift - b.shift
        return math.sqrt(max(float(shift @ shift + np.trace(linear @ covariance @ linear.T)), 0.0))

    def match(self, transform: Affine) -> Match:
        """The one-to-one pairs under a placement: each reference tree takes the nearest source tree that claims it."""
        return self._match(transform, self.threads)

    def matches(self, transforms: Sequence[Affine]) -> list[Match]:
        """The same for several placements, side by side."""
        return concurrently(lambda transform: self._match(transform, 1), transforms, self.threads)

    def _match(self, transform: Affine, threads: int) -> Match:
        reference, source = self.reference.features, self.source.features
        moved = transform(source.xy)
        distance, target = nearest(reference.tree, moved, self.gate, threads=threads, order=source.tree.indices)
        claims = np.flatnonzero(target < len(reference))
        owner = np.full(len(reference), -1)
        owner[target[claims]] = claims
        contested = np.zeros(len(reference), dtype=bool)
        contested[target[claims[owner[target[claims]] != claims]]] = True
        rivals = claims[contested[target[claims]]]
        rivals = rivals[np.argsort(-distance[rivals], kind="stable")]
        owner[target[rivals]] = rivals  # the nearest comes last
        mine = np.flatnonzero(owner >= 0)
        return Match(
            transform,
            mine,
            owner[mine],
            distance[owner[mine]],
            self.source.footprint.covers(transform.inverse()(reference.xy)),
            self.reference.footprint.covers(moved),
        )

    def refine(self, transform: Affine, model: Model, rounds: int = 3) -> Affine:
        """The least-squares placement near a placement, from its own pairs; itself when they do not determine one."""
        for _ in range(rounds):
            match = self.match(transform)
            try:
                transform = model.fit(
                    self.source.features.xy[match.source], self.reference.features.xy[match.reference]
                )
            except ValueError:
                break
        return transform

    def statistics(self, match: Match) -> Statistics:
        """What the pairs of one placement look like."""

        def rate(side: Side, covered: BoolArray, mine: IntArray) -> FloatArray:
            matched = np.zeros(len(covered), dtype=bool)
            matched[mine] = True
            seen = np.bincount(side.confidence_class[covered], minlength=CLASSES)
            got = np.bincount(side.confidence_class[covered & matched], minlength=CLASSES)
            overall = (got.sum() + 1) / (seen.sum() + 2)
            return np.asarray((got + 4 * overall) / (seen + 4))

        correlation = {}
        for name in self.names:
            u = self.reference.scores[name][match.reference]
            v = self.source.scores[name][match.source]
            # Scores of crowns that are all alike hardly vary: two odd ones that meet must not speak for all pairs.
            power = max(float(np.sqrt((u @ u) * (v @ v))), LEAST_VARIANCE * len(u))
            correlation[name] = float(u @ v) / power if power > 0 else 0.0
        k = len(match.distance)
        return Statistics(
            rate(self.reference, match.covered_reference, match.reference),
            rate(self.source, match.covered_source, match.source),
            float((match.distance**2).sum() + 0.02 * self.gate**2) / (2 * k + 2) + RESOLUTION**2,
            correlation,
            k,
        )

    def scores(self, match: Match, right: Statistics, decoy: Statistics) -> tuple[FloatArray, FloatArray]:
        """Log-likelihood ratio of each reference tree (n,) and each source tree (m,); 0 for one that is not covered."""

        def found(side: Side, covered: BoolArray, mine: IntArray, p: FloatArray, q: FloatArray) -> FloatArray:
            matched = np.zeros(len(covered), dtype=bool)
            matched[mine] = True
            c = side.confidence_class
            value = np.where(matched, np.log(p / q)[c], np.log((1 - p) / (1 - q))[c])
            return np.where(covered, value, 0.0)

        of_reference = found(
            self.reference, match.covered_reference, match.reference, right.rate_reference, decoy.rate_reference
        )
        of_source = found(self.source, match.covered_source, match.source, right.rate_source, decoy.rate_source)
        square = match.distance**2
        pair = np.log(decoy.variance / right.variance) - square / 2 * (1 / right.variance - 1 / decoy.variance)
        pair = np.clip(pair, -3, 3)
        for name in self.names:
            u = self.reference.scores[name][match.reference]
            v = self.source.scores[name][match.source]
            pair = pair + _together(u, v, right.correlation[name]) - _together(u, v, decoy.correlation[name])
        both = match.covered_reference[match.reference] & match.covered_source[match.source]
        np.add.at(of_source, match.source[both], pair[both])
        return of_reference, of_source


def _together(u: FloatArray, v: FloatArray, r: float) -> FloatArray:
    """Log of the density of pairs of normal scores with correlation r over that of unrelated ones.

    r is held in 0 to 0.9.
    """
    r = min(max(r, 0.0), SURE)
    return np.asarray((2 * r * u * v - r * r * (u * u + v * v)) / (2 * (1 - r * r)) - math.log(1 - r * r) / 2)
