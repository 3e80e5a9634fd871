"""Matching rows under a placement: which rows of the two surveys run on each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import IntArray
from treereg_core.row_lines import Feet, RowLines
from treereg_core.transform import Affine, FloatArray

# A row is the other survey's when its trees lie within this share of the row distance of it.
OWN = 0.4


@dataclass(frozen=True, eq=False)
class Alongside:
    """Pairs of rows (k, 2), reference and source, that run on each other for some way.

    `trees` (k,) counts both rows' trees on the stretch that both have; `distance` (k,), metres, is the mean distance of
    the stretch's first, middle and last tree of each row from the other row.
    """

    pairs: IntArray
    trees: IntArray
    distance: FloatArray


def match_rows(reference: RowLines, source: RowLines, reference_from_source: Affine) -> IntArray:
    """Pairs (k, 2) of rows, reference and source, by their summed distances under a placement, each row used once.

    After the proposal's figure 5, on lines: a row may be cut short or be one of several pieces, so two rows are
    compared on the stretch that both have, and the longest and closest stretches are taken first.
    """
    limit = OWN * min(reference.distance, source.distance)
    found = alongside(reference, source, reference_from_source, limit)
    gain = found.trees * (1 - found.distance / limit)
    taken: tuple[set[int], set[int]] = (set(), set())
    matches = []
    for k in np.argsort(-gain, kind="stable"):
        i, j = found.pairs[k].tolist()
        if i not in taken[0] and j not in taken[1]:
            taken[0].add(i)
            taken[1].add(j)
            matches.append((i, j))
    return np.array(sorted(matches), dtype=np.int64).reshape(-1, 2)


def alongside(reference: RowLines, source: RowLines, reference_from_source: Affine, limit: float) -> Alongside:
    """All pairs of rows of which some tree has the other's line nearest to it, within `limit` metres."""
    back = reference_from_source.inverse()
    reach = limit + reference.spacing
    onto = reference.feet(reference_from_source(source.smooth), source.tangent @ reference_from_source.linear.T, reach)
    from_source = _selected(onto, onto.row, source.row, limit)
    under = source.feet(back(reference.smooth), reference.tangent @ back.linear.T, reach)
    from_reference = _selected(under, reference.row, under.row, limit)
    both = (from_source, from_reference)
    pairs, which = np.unique(np.concatenate([s.pairs for s in both]), axis=0, return_inverse=True)
    which = which.reshape(-1)
    trees = np.concatenate([s.trees for s in both])
    distance = np.concatenate([s.distance for s in both])
    sides = np.bincount(which, minlength=len(pairs))
    return Alongside(
        pairs, np.bincount(which, trees, len(pairs)).astype(np.int64), np.bincount(which, distance) / sides
    )


def _selected(feet: Feet, reference: IntArray, source: IntArray, limit: float) -> Alongside:
    """What the trees of one survey say: each has a foot on the other's lines, and stands for a pair of rows."""
    near = np.flatnonzero(feet.found & (np.abs(feet.across) < limit))
    pairs, which, trees = np.unique(
        np.column_stack([reference[near], source[near]]), axis=0, return_inverse=True, return_counts=True
    )
    across = np.abs(feet.across[near[np.argsort(which.reshape(-1), kind="stable")]])
    first = np.cumsum(trees) - trees
    distance = (across[first] + across[first + trees // 2] + across[first + trees - 1]) / 3
    return Alongside(pairs, trees, distance)
