"""What the network sees of a pair of rows: each sign in a few states."""

from __future__ import annotations

import numpy as np

from treereg_bn_rows.profile import Candidates
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

STATES: dict[str, tuple[str, ...]] = {
    "offset": ("under_0.1", "under_0.2", "under_0.35", "more"),
    "direction": ("under_1", "under_3", "under_8", "more"),
    "begin": ("under_0.7", "under_1.7", "under_4", "more"),
    "end": ("under_0.7", "under_1.7", "under_4", "more"),
    "length": ("under_1", "under_2.5", "under_6", "more"),
    "trees": ("under_0.3", "under_0.8", "under_1.6", "more"),
    "gaps": ("under_-2", "under_-1", "under_0", "under_1", "more"),
    "context": ("under_0.2", "under_0.5", "under_0.8", "more", "none"),
    "field": ("under_-20", "under_0", "under_20", "more"),
}
"""The states of each sign; a value below the bound that a state names, and not below the one before, is in it.

- offset: distance between the rows across, in distances from row to row.
- direction: angle between them, degrees.
- begin, end: how far apart along they begin and end, in distances from tree to tree, once the source is shifted.
- length: difference of their lengths, in distances from tree to tree.
- trees: difference of their numbers of trees, over the root of their sum.
- gaps: trees that stand opposite a gap of the other row, where both rows run: how many more than usual under other
  placements, in standard deviations.
- context: mean probability, by the signs above, that the rows to both sides are the same; none where there are none.
- field: how much more all rows and trees together say for this placement than for any at another offset: log-odds.
"""
BOUNDS = {
    name: np.array([float(state.partition("_")[2]) for state in states if state.startswith("under")])
    for name, states in STATES.items()
}
BESIDE = 0.5
"""Rows farther apart than this, in distances from row to row, are not looked at."""
AROUND = 2
"""So many rows to each side are the context."""


def signs(pairs: Candidates, distance: float, spacing: float, surprise: FloatArray) -> dict[str, IntArray]:
    """The states of a pair of rows by itself, of all signs but context and field, (k,); distance, spacing in metres.

    `surprise` (k,) is the value of `gaps`.
    """
    length = np.abs(pairs.begin - pairs.end)
    mine, its = pairs.reference.trees[pairs.i], pairs.source.trees[pairs.j]
    values = {
        "offset": np.abs(pairs.across) / distance,
        "direction": np.degrees(np.arctan2(np.abs(pairs.askew), pairs.shared)),
        "begin": np.abs(pairs.begin) / spacing,
        "end": np.abs(pairs.end) / spacing,
        "length": length / spacing,
        "trees": np.abs(mine - its) / np.sqrt(mine + its),
        "gaps": surprise,
    }
    return {name: np.searchsorted(BOUNDS[name], value, side="right") for name, value in values.items()}


def context(pairs: Candidates, probability: FloatArray) -> IntArray:
    """The state of the context for each pair (k,): what the likeliest pairs of the rows to both sides say."""
    if not len(probability):
        return np.zeros(0, dtype=np.int64)
    row, place = np.unique(pairs.i, return_inverse=True)
    best = np.zeros(len(row))
    np.maximum.at(best, place, probability)
    total, count = np.zeros(len(row)), np.zeros(len(row))
    for step in range(1, min(AROUND, len(row) - 1) + 1):
        total[step:] += best[:-step]
        total[:-step] += best[step:]
        count[step:] += 1
        count[:-step] += 1
    mean = total / np.maximum(count, 1)
    state = np.searchsorted(BOUNDS["context"], mean, side="right")
    return np.asarray(np.where(count > 0, state, STATES["context"].index("none"))[place])


def field(advantage: float, count: int) -> IntArray:
    """The state of the field for each of so many pairs of rows."""
    return np.full(count, np.searchsorted(BOUNDS["field"], advantage, side="right"))


def surprises(seen: IntArray, alone: IntArray, usual: float) -> FloatArray:
    """How many standard deviations more trees (k,) than usual, a share, stand alone among those seen."""
    spread = np.sqrt(np.maximum(seen * usual * (1 - usual), 1e-9))
    return np.asarray(np.where(seen > 0, (alone - usual * seen) / np.maximum(spread, 1e-4), 0.0))
