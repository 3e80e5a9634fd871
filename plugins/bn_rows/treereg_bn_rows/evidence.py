"""What the network sees of a pair of rows: each sign in a few states."""

from __future__ import annotations

import numpy as np

from treereg_bn_rows.profile import Candidates
from treereg_bn_rows.structure import STATES
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

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
