"""What is kept of earlier surveys: counts for the network's tables, and single trees in the home frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np
from scipy.spatial import cKDTree

from treereg_bn_landmarks.network import Counts, none
from treereg_bn_landmarks.structure import STATES, shape
from treereg_core.errors import InputError
from treereg_core.features import BoolArray, IntArray, frozen_array, nearest
from treereg_core.footprint import Footprint
from treereg_core.transform import Affine, FloatArray

VERSION = 1
NAME = "bn_landmarks"
# No count, and no coordinate in metres, is larger.
LARGEST = 1e9

DECAY = 0.8
"""What an outcome counts for after each later one."""
FORGOTTEN = 0.15
"""Trees that were seen less than this, in surveys of today's worth, are forgotten."""
# A tree is one that is remembered when it stands within this share of the in-row step.
SAME = 0.35
# Shares of the surveys that had a tree: from the first on sometimes, from the second on yes.
SOMETIMES, YES = 0.3, 0.7
# The ground that remembered trees cover is closed over so many steps.
COVERED = 2.5

LEARNED = ("confidence", "size", "row", "earlier")
"""What is the detector's and the orchard's own. How landmarks are recognised, by what stands there in the other survey
and by their place, is left as simulation knows it: it anchors the hidden nodes, which else drift from one outcome to
the next (measured: more learned nodes made the probabilities worse)."""


@dataclass(frozen=True, eq=False)
class Memory:
    """`counts` for the tables of the network, and `trees` (n, 4): x, y in metres in the home frame, and in how many
    surveys each was seen and missed, older ones counting less."""

    counts: Counts = field(default_factory=none)
    trees: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))

    @classmethod
    def of(cls, state: Mapping[str, Any]) -> Memory:
        """From the state as it is kept; empty from an empty one. Raises `InputError` for one that is damaged."""
        if not isinstance(state, Mapping):
            _refuse("it is no table of names and values")
        if not state:
            return cls()
        wrong = set(state) ^ {"version", "counts", "trees"}
        if wrong:
            _refuse(f"{min(wrong, key=str)!r} is missing, or should not be there")
        if isinstance(state["version"], bool) or state["version"] != VERSION:
            _refuse(f"it is of version {state['version']!r:.20}, not {VERSION}")
        counts = state["counts"]
        if not isinstance(counts, Mapping) or set(counts) != set(LEARNED):
            _refuse(f"the counts are not those of the nodes {', '.join(LEARNED)}")
        tables = {**none(), **{node: _numbers(counts[node], shape(node), f"counts of {node}") for node in LEARNED}}
        rows = state["trees"]
        trees = _numbers(rows, (len(rows) if isinstance(rows, list) else 0, 4), "trees")
        if any((table < 0).any() for table in (*tables.values(), trees[:, 2:])):
            _refuse("a count is below 0")
        return cls(tables, trees)

    def state(self) -> dict[str, Any]:
        """As plain lists and numbers, to be kept as JSON."""
        order = np.lexsort(self.trees.T[::-1])
        return {
            "version": VERSION,
            "counts": {node: np.round(self.counts[node], 3).tolist() for node in LEARNED},
            "trees": np.round(self.trees[order], 3).tolist(),
        }

    def earlier(self, xy: FloatArray, home_from_reference: Affine | None, step: float) -> IntArray:
        """The class of `earlier` for trees (n, 2) in the reference's frame, metres, whose in-row step this is."""
        unknown = len(STATES["earlier"])
        trees = self.trees[self.trees[:, 2:].sum(axis=1) > 0]
        if home_from_reference is None or len(trees) < 3:
            return np.full(len(xy), unknown)
        at_home = home_from_reference(xy)
        ground = Footprint.of(trees[:, :2], COVERED * step)
        _, record = nearest(cKDTree(trees[:, :2]), at_home, SAME * step)
        share = np.append(trees[:, 2] / trees[:, 2:].sum(axis=1), 0.0)[record]
        names = STATES["earlier"]
        there = np.searchsorted((SOMETIMES, YES), share, side="right") + names.index("no")
        return np.where((record == len(trees)) & ~ground.covers(at_home), unknown, there)

    def with_counts(self, more: Counts) -> Memory:
        """With one outcome's counts added to what is left of the earlier ones."""
        counts = {node: frozen_array(DECAY * self.counts[node] + more[node]) for node in LEARNED}
        return Memory({**none(), **counts}, self.trees)

    def with_trees(self, xy: FloatArray, step: float, ground: Callable[[FloatArray], BoolArray]) -> Memory:
        """With one survey's trees (n, 2), home frame, metres, and its ground: what it shows is seen, the rest missed.

        `ground` tells which points the survey covers; trees on other ground are neither.
        """
        old = self.trees * (1, 1, DECAY, DECAY)
        new = np.column_stack([xy, np.ones(len(xy)), np.zeros(len(xy))])
        if len(old) == 0 or len(xy) == 0:
            return Memory(self.counts, frozen_array(np.concatenate([old, new])))
        _, record = nearest(cKDTree(old[:, :2]), xy, SAME * step)
        _, back = nearest(cKDTree(xy), old[:, :2], SAME * step)
        same = np.flatnonzero(record < len(old))
        same = same[back[record[same]] == same]
        at = record[same]
        weight = (1 / (1 + old[at, 2]))[:, None]
        old[at, :2] += weight * (xy[same] - old[at, :2])
        old[at, 2] += 1
        absent = ground(old[:, :2])
        absent[at] = False
        old[absent, 3] += 1
        fresh = np.ones(len(xy), dtype=bool)
        fresh[same] = False
        kept = old[old[:, 2] >= FORGOTTEN]
        return Memory(self.counts, frozen_array(np.concatenate([kept, new[fresh]])))


def _numbers(values: Any, wanted: tuple[int, ...], what: str) -> FloatArray:
    """An array of this shape from nested lists of finite numbers."""
    if not _is_plain(values, len(wanted)):
        _refuse(f"the {what} are not lists of numbers")
    try:
        array = np.asarray(values, dtype=np.float64).reshape(wanted if values == [] else np.shape(values))
    except (ValueError, OverflowError):
        _refuse(f"the {what} are not {_by(wanted)} numbers")
    if array.shape != wanted or not np.isfinite(array).all() or (np.abs(array) > LARGEST).any():
        _refuse(f"the {what} are not {_by(wanted)} finite numbers of sensible size")
    return frozen_array(array)


def _is_plain(values: Any, depth: int) -> bool:
    if depth == 0:
        return isinstance(values, int | float) and not isinstance(values, bool)
    return isinstance(values, list) and all(_is_plain(value, depth - 1) for value in values)


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _refuse(why: str) -> NoReturn:
    raise InputError(f"what the memory holds for {NAME} is damaged: {why}; remove it from the memory and learn anew")
