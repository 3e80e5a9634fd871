"""Lessons: the pairs of rows of a registered pair of surveys, the same or not, and what they showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from treereg_bn_rows.evidence import STATES
from treereg_bn_rows.ranking import Ranked
from treereg_core.features import BoolArray, IntArray
from treereg_core.pair import MatchedRows

MOST = 0.5
"""Two rows are the same when at least this share of the trees of the one with fewer match trees of the other."""


@dataclass(frozen=True, eq=False)
class Lessons:
    """Pairs of rows (k): the states of all signs, and whether the rows are the `same`."""

    states: dict[str, IntArray]
    same: BoolArray


def lessons(shown: Sequence[Ranked], rows: MatchedRows, matches: IntArray) -> Lessons:
    """What these placements showed of their pairs of rows, when these trees (k, 2), by id, are the same."""
    same = same_rows(rows, matches)
    states = {name: np.concatenate([found.states[name] for found in shown]) for name in STATES}
    pairs = np.concatenate([found.look.rows for found in shown])
    return Lessons(states, np.array([(i, j) in same for i, j in pairs.tolist()], dtype=bool))


def same_rows(rows: MatchedRows, matches: IntArray) -> set[tuple[int, int]]:
    """The pairs of rows of which most trees are the same."""
    row_of = [
        {tree: k for k, row in enumerate(side.trees) for tree in row.tolist()} for side in (rows.reference, rows.source)
    ]
    count: dict[tuple[int, int], int] = {}
    for a, b in matches.tolist():
        if a in row_of[0] and b in row_of[1]:
            pair = row_of[0][a], row_of[1][b]
            count[pair] = count.get(pair, 0) + 1
    return {
        (i, j)
        for (i, j), trees in count.items()
        if trees >= MOST * min(len(rows.reference.trees[i]), len(rows.source.trees[j]))
    }
