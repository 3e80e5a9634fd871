"""Comparison: one placement against a rival, tree by tree, and whether all of the field says the same."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from treereg_core.evidence import Evidence, Match, Statistics
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

# The field is cut into about so many trees a block, within these numbers of blocks.
TREES_PER_BLOCK = 50
FEWEST_BLOCKS, MOST_BLOCKS = 4, 36
# What the spread of single trees tells of the error of their sum, in blocks.
TREES_KNOW = 10
# So many blocks know their own spread well enough to say that they differ.
MANY_BLOCKS = 16
# Larger blocks feel what their trees have in common more; by how much they differ is told as of blocks of so many.
TREES_COMPARED = 225


# A block hardly meets where less than this share of the usual rate does; so many such blocks are a part of the field.
HARDLY = 0.5
PART = 0.1
# Maps are bent where pairs lie off by so many tree spacings that vary over the field.
BENT = 0.05


@dataclass(frozen=True)
class Comparison:
    """The log-odds of a placement against its rival.

    `standard_error` is how far the sum over the field's trees would stray if they were drawn anew: evidence that comes
    from one corner only is no evidence. `prior` is the part of the log-odds that was known beforehand.
    """

    log_odds: float
    standard_error: float
    prior: float = 0.0

    @property
    def margin(self) -> float:
        """What the trees say: the smaller of their log-odds and of twice its squared ratio to the standard error."""
        seen = self.log_odds - self.prior
        ratio = seen / max(self.standard_error, 1e-6)
        return min(seen, 2 * ratio * abs(ratio))

    def plus(self, prior: float) -> Comparison:
        """The same with log-odds that were known beforehand."""
        return Comparison(self.log_odds + prior, self.standard_error, self.prior + prior)


def compare(evidence: Evidence, match: Match, rival: Match, right: Statistics, decoy: Statistics) -> Comparison:
    """Weigh a placement against a rival.

    Only trees that lie in the footprints of both placements count, so that the outlines of two differently cropped
    surveys are no evidence. A rival that covers less than half of these trees is compared over all of them: what it
    leaves uncovered is evidence for the placement in so far as it is better there than a decoy.
    """
    mine, its = evidence.scores(match, right, decoy), evidence.scores(rival, right, decoy)
    covered = match.covered_reference, match.covered_source
    also = rival.covered_reference, rival.covered_source
    counted = [a & b for a, b in zip(covered, also, strict=True)]
    if sum(c.sum() for c in counted) < 0.5 * sum(c.sum() for c in covered):
        counted = [a | b for a, b in zip(covered, also, strict=True)]
    return _sum(evidence, match, [a - b for a, b in zip(mine, its, strict=True)], counted)


def standing(evidence: Evidence, match: Match, right: Statistics, decoy: Statistics) -> Comparison:
    """Weigh a placement by itself: is it right, or one decoy among others?"""
    mine = evidence.scores(match, right, decoy)
    return _sum(evidence, match, list(mine), [match.covered_reference, match.covered_source])


def in_part_only(evidence: Evidence, match: Match) -> bool:
    """Whether a placement lays a part of the field only, because one of the maps is bent.

    Elsewhere hardly any trees meet, and those that do are off by what varies over the field more than chance explains.
    Which part it lays is up to the method, and what the others are off by shows in no residual.
    """
    reference, source = evidence.reference.features.xy, match.transform(evidence.source.features.xy)
    covered = match.covered_reference, match.covered_source
    where = np.concatenate([xy[c] for xy, c in zip((reference, source), covered, strict=True)])
    if len(where) < MANY_BLOCKS * TREES_PER_BLOCK:
        return False
    meets = [np.zeros(len(xy), dtype=bool) for xy in (reference, source)]
    meets[0][match.reference] = meets[1][match.source] = True
    block = _blocks(where)
    rate = np.bincount(block, np.concatenate([m[c] for m, c in zip(meets, covered, strict=True)])) / np.bincount(block)
    if (rate < HARDLY * np.median(rate)).mean() < PART:
        return False
    of_tree = np.full(len(reference), -1)
    of_tree[match.covered_reference] = block[: int(match.covered_reference.sum())]
    inside = match.covered_reference[match.reference]
    at, off = of_tree[match.reference][inside], (reference[match.reference] - source[match.source])[inside]
    count = np.bincount(at)
    mean = np.column_stack([np.bincount(at, column) for column in off.T]) / np.maximum(count, 1)[:, None]
    varying = float(count @ (mean**2).sum(axis=1)) - len(count) * float(off.var(axis=0).sum())
    return varying > len(off) * (BENT * evidence.spacing) ** 2


def _sum(evidence: Evidence, match: Match, gains: list[FloatArray], counted: list[BoolArray]) -> Comparison:
    places = evidence.reference.features.xy, match.transform(evidence.source.features.xy)
    gain = np.concatenate([g[c] for g, c in zip(gains, counted, strict=True)])
    where = np.concatenate([p[c] for p, c in zip(places, counted, strict=True)])
    return Comparison(float(gain.sum()), standard_error(gain, where))


def standard_error(gain: FloatArray, where: FloatArray) -> float:
    """Of the sum of gains (n,) at places (n, 2): from sums over blocks, which feel what neighbours have in common.

    A few blocks know their own spread badly, so the trees' own variance counts like `TREES_KNOW` blocks more. Many
    blocks that differ by more than their trees' noise may tell of maps that are bent against each other, where a part
    of the field speaks for another placement: the error then grows beyond that of the blocks, by as much however many
    trees a block has.
    """
    n = len(gain)
    if n < 2 * FEWEST_BLOCKS:
        return float("inf")
    sums = np.bincount(_blocks(where), gain)
    of_blocks, of_trees = len(sums) * sums.var(ddof=1), n * gain.var(ddof=1)
    known = len(sums) - 1
    variance = (known * of_blocks + TREES_KNOW * of_trees) / (known + TREES_KNOW)
    if len(sums) >= MANY_BLOCKS and of_blocks > of_trees > 0:
        beyond = (of_blocks / of_trees - 1) * min(1.0, TREES_COMPARED * len(sums) / n)
        variance = of_blocks * math.sqrt(1 + beyond)
    return math.sqrt(variance)


def _blocks(where: FloatArray) -> IntArray:
    """Which block of the field each point (n, 2) lies in, all of as many points: strips along x, each cut along y."""
    n = len(where)
    count = int(np.clip(n / TREES_PER_BLOCK, FEWEST_BLOCKS, MOST_BLOCKS))
    strips = max(round(np.sqrt(count)), 1)
    strip = np.empty(n, dtype=np.int64)
    strip[np.argsort(where[:, 0], kind="stable")] = np.arange(n) * strips // n
    rank = np.empty(n, dtype=np.int64)
    rank[np.lexsort((where[:, 1], strip))] = np.arange(n)
    return np.asarray(rank * strips**2 // n)
