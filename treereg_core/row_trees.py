"""The trees that stand opposite each other along matched rows, and the model fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.method import Context, Registration
from treereg_core.pair import Pair, Rows
from treereg_core.row_lines import step_along, trees_of
from treereg_core.transform import FloatArray

# Trees farther apart than this share of the in-row spacing are not a pair.
REACH = 0.4
# Residuals beyond so many standard deviations count little.
STRAY = 2.5
# Fits follow each other, so many at most, until no tree moves by this share of the reach.
ROUNDS, SETTLED = 6, 1e-3


def along_rows(pair: Pair, context: Context) -> Registration:
    """The model fitted to trees of matched rows that are each other's nearest within their rows, strays counting less.

    It starts from the pair's transform, and pairs anew after each fit until nothing changes. Raises `NoRegistration`
    when the trees are fewer than three or do not determine the model.
    """
    facing = _Facing.of(pair)
    transform = pair.reference_from_source
    for _ in range(ROUNDS):
        moved = transform(pair.source.xy)
        i, j = facing.pairs(moved)
        weight = _weights(pair, moved, i, j)
        try:
            transform = context.model.fit(pair.source.xy[j], pair.reference.xy[i], weight)
        except ValueError as error:
            raise NoRegistration(f"the {len(i)} trees along the matched rows fix no placement: {error}") from None
        if np.abs(transform(pair.source.xy[j]) - moved[j]).max() < SETTLED * facing.reach:
            break
    return Registration(transform, np.column_stack([pair.reference.ids[i], pair.source.ids[j]]), weight)


def trees_along_rows(pair: Pair) -> IntArray:
    """Ids (n, 2), reference and source, of the trees of matched rows that are each other's nearest in their rows.

    Trees farther apart than two fifths of the in-row spacing are no pair.
    """
    i, j = _Facing.of(pair).pairs(pair.source_in_reference)
    return np.column_stack([pair.reference.ids[i], pair.source.ids[j]])


@dataclass(frozen=True, eq=False)
class _Facing:
    """The trees of matched rows, by position in both surveys, and how far those of a pair may be apart, metres."""

    reference: IntArray
    source: IntArray
    source_match: IntArray
    fixed: FloatArray
    reach: float

    @classmethod
    def of(cls, pair: Pair) -> _Facing:
        none = np.empty(0, dtype=np.int64)
        if pair.rows is None or not len(pair.rows.matches):
            return cls(none, none, none, np.empty((0, 3)), 0.0)
        reference, match = _of_matches(pair.rows.reference, pair.rows.matches[:, 0], pair.reference)
        source, source_match = _of_matches(pair.rows.source, pair.rows.matches[:, 1], pair.source)
        reach = REACH * step_along(pair.reference.xy[reference], match)
        return cls(reference, source, source_match, _lifted(pair.reference.xy[reference], match, reach), reach)

    @cached_property
    def tree(self) -> cKDTree:
        """A k-d tree of the reference's trees, built once."""
        return cKDTree(self.fixed)

    def pairs(self, moved: FloatArray) -> tuple[IntArray, IntArray]:
        """Positions in reference and source of mutually nearest trees when the source's stand at `moved` (n, 2)."""
        if not len(self.source) or self.reach == 0:
            return self.source[:0], self.source[:0]
        places = _lifted(moved[self.source], self.source_match, self.reach)
        _, partner = nearest(self.tree, places, self.reach)
        near = np.flatnonzero(partner < len(self.fixed))
        _, back = nearest(cKDTree(places), self.fixed[partner[near]], self.reach)
        mutual = near[back == near]
        return self.reference[partner[mutual]], self.source[mutual]


def _of_matches(rows: Rows, chosen: IntArray, features: FeatureSet) -> tuple[IntArray, IntArray]:
    """Positions (n,) of the trees of the chosen rows, and the match (n,) that each is in."""
    return trees_of(Rows(tuple(rows.trees[row] for row in chosen)), features)


def _lifted(xy: FloatArray, match: IntArray, reach: float) -> FloatArray:
    """Points (n, 3): matches lie apart in the third coordinate, so that trees of different ones never meet."""
    return np.column_stack([xy, 4 * reach * match])


def _weights(pair: Pair, moved: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
    """What each pair counts in a fit; those that lie unusually far apart count less."""
    if len(i) < 3:
        raise NoRegistration(f"the {len(i)} trees that meet along the matched rows are too few to fix a placement")
    square = ((pair.reference.xy[i] - moved[j]) ** 2).sum(axis=1)
    # The median square of two normal residuals is 1.386 variances.
    variance = max(float(np.median(square)) / 1.386, 1e-12)
    return np.asarray(pair.reference.weight[i] * pair.source.weight[j] / (1 + square / (2 * STRAY**2 * variance)) ** 2)
