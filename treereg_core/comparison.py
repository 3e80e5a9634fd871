"""Comparison: one placement against a rival, tree by tree, and whether all of the field says the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.evidence import Evidence, Match, Statistics
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

TREES_PER_BLOCK = 50
FEWEST_BLOCKS, MOST_BLOCKS = 4, 36


@dataclass(frozen=True)
class Comparison:
    """`log_odds` of the placement against its rival, and `consistency`: their sum over blocks of the field in units of
    its own standard error, a t statistic. Evidence that comes from one corner only is no evidence."""

    log_odds: float
    consistency: float
    prior: float = 0.0

    @property
    def margin(self) -> float:
        """The smaller of the log-odds and of twice the consistency squared (signed), with what was known beforehand."""
        square = 2 * self.consistency * abs(self.consistency)
        return min(self.log_odds, square + self.prior)

    def plus(self, prior: float) -> Comparison:
        """The same with log-odds that were known beforehand."""
        return Comparison(self.log_odds + prior, self.consistency, self.prior + prior)


def compare(
    evidence: Evidence,
    match: Match,
    rival: Match,
    right: Statistics,
    decoy: Statistics,
) -> Comparison:
    """Weigh a placement against a rival.

    Only trees that lie in the footprints of both placements count, so that the outlines of two differently cropped
    surveys are no evidence. A rival that covers less than half of these trees is compared over all of them: what it
    leaves uncovered is evidence for the placement in so far as it is better there than a decoy.
    """
    mine, its = evidence.scores(match, right, decoy), evidence.scores(rival, right, decoy)
    places = evidence.reference.features.xy, match.transform(evidence.source.features.xy)
    covered = match.covered_reference, match.covered_source
    common = [a & b for a, b in zip(covered, (rival.covered_reference, rival.covered_source), strict=True)]
    if sum(c.sum() for c in common) < 0.5 * sum(c.sum() for c in covered):
        common = [a | b for a, b in zip(covered, (rival.covered_reference, rival.covered_source), strict=True)]
    gain = np.concatenate([(a - b)[c] for a, b, c in zip(mine, its, common, strict=True)])
    where = np.concatenate([p[c] for p, c in zip(places, common, strict=True)])
    return Comparison(float(gain.sum()), _consistency(gain, where))


def _consistency(gain: FloatArray, where: FloatArray) -> float:
    if len(gain) < 2 * FEWEST_BLOCKS:
        return 0.0
    sums = np.bincount(_blocks(where, int(np.clip(len(gain) / TREES_PER_BLOCK, FEWEST_BLOCKS, MOST_BLOCKS))), gain)
    return float(sums.sum() / max(np.sqrt(len(sums)) * sums.std(ddof=1), 1e-3))


def _blocks(where: FloatArray, count: int) -> IntArray:
    """Which of about `count` blocks of as many points each point (n, 2) lies in: strips along x, each cut along y."""
    n, strips = len(where), max(round(np.sqrt(count)), 1)
    strip = np.empty(n, dtype=np.int64)
    strip[np.argsort(where[:, 0], kind="stable")] = np.arange(n) * strips // n
    rank = np.empty(n, dtype=np.int64)
    rank[np.lexsort((where[:, 1], strip))] = np.arange(n)
    return np.asarray(rank * strips**2 // n)
