"""Lessons: the pairs of rows of a registered pair of surveys, the same or not, and what they showed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from treereg_bn_rows.ranking import Ranked
from treereg_bn_rows.structure import STATES
from treereg_core.features import BoolArray, IntArray
from treereg_core.pair import MatchedRows

MOST, FEWEST = 0.5, 2
"""Two rows are the same when this share of the matched trees of either, and so many, match trees of the other."""


@dataclass(frozen=True, eq=False)
class Lessons:
    """Pairs of rows (k): the states of all signs, and whether the rows are the `same`."""

    states: dict[str, IntArray]
    same: BoolArray


def lessons(shown: Sequence[Ranked], rows: MatchedRows, matches: IntArray) -> Lessons:
    """What these placements showed of their pairs of rows, when these trees (k, 2), by id, are the same.

    The start that they were found from must lie in the right sense: under a half turn of it no two rows are the same,
    not even the middle one and itself.
    """
    same = same_rows(rows, matches)
    states = {name: np.concatenate([found.states[name] for found in shown]) for name in STATES}
    labels = [found.look.placed.sense == 0 and (i, j) in same for found in shown for i, j in found.look.rows.tolist()]
    return Lessons(states, np.array(labels, dtype=bool))


def same_rows(rows: MatchedRows, matches: IntArray) -> set[tuple[int, int]]:
    """The pairs of rows of which most trees match each other, of those that match any; two at least.

    A piece is the same as the whole row that it is of.
    """
    sides = []
    for side, ids in zip((rows.reference, rows.source), matches.T, strict=True):
        row_of = {tree: k for k, row in enumerate(side.trees) for tree in row.tolist()}
        sides.append([row_of.get(tree, -1) for tree in ids.tolist()])
    both = Counter((i, j) for i, j in zip(*sides, strict=True) if i >= 0 and j >= 0)
    of_reference, of_source = (Counter(side) for side in sides)
    return {
        (i, j)
        for (i, j), trees in both.items()
        if trees >= FEWEST and trees >= MOST * min(of_reference[i], of_source[j])
    }
