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

VERSION = 2
NAME = "bn_landmarks"
# No count, and no coordinate in metres, is larger.
LARGEST = 1e9

DECAY = 0.8
"""What an outcome counts for after each later one."""
FORGOTTEN = 0.15
"""Trees that were seen less than this, in surveys of today's worth, are forgotten."""
# A tree is one that is remembered when it stands within this share of the in-row step.
SAME = 0.35
# How much a survey that had a tree speaks for it, and one that had none against it; and bounds of the classes.
SEEN, MISSED = 2.0, 1.0
BOUNDS = (-1.5, 0.0, 1.2)
# The ground that remembered trees cover is closed over so many steps.
COVERED = 2.5

LEARNED = ("confidence", "size", "row")
"""What is the detector's and the orchard's own. How landmarks are recognised, by what stands there in the other survey
and by their place, is left as simulation knows it: it anchors the hidden nodes, which else drift from one outcome to
the next (measured: more learned nodes made the probabilities worse). So is `earlier`, which means more from survey to
survey."""


@dataclass(frozen=True, eq=False)
class Memory:
    """`counts` for the tables of the network, and `trees` (n, 4): x, y in metres in the home frame, and in how many
    surveys each was seen and missed, older ones, and those that missed most trees, counting less."""

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
        version = state["version"]
        if isinstance(version, bool) or version not in (1, VERSION):
            _refuse(f"it is of version {version!r:.20}, not {VERSION}")
        counts = state["counts"]
        # Version 1 also counted `earlier`, in classes of its own.
        wanted = {*LEARNED, "earlier"} if version == 1 else {*LEARNED}
        if not isinstance(counts, Mapping) or set(counts) != wanted:
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
        distance, record = nearest(cKDTree(trees[:, :2]), at_home, np.inf)
        remembered = distance <= SAME * step
        # Where no tree is remembered, all surveys missed it that saw, or missed, the nearest one.
        seen = np.where(remembered, trees[record, 2], 0)
        missed = trees[record, 2:].sum(axis=1) - seen
        there = np.searchsorted(BOUNDS, SEEN * seen - MISSED * missed, side="right")
        return np.where(remembered | ground.covers(at_home), there, unknown)

    def with_counts(self, more: Counts) -> Memory:
        """With one outcome's counts added to what is left of the earlier ones."""
        counts = {node: frozen_array(DECAY * self.counts[node] + more[node]) for node in LEARNED}
        return Memory({**none(), **counts}, self.trees)

    def with_trees(self, xy: FloatArray, step: float, ground: Callable[[FloatArray], BoolArray]) -> Memory:
        """With one survey's trees (n, 2), home frame, metres, and its ground: what it shows is seen, the rest missed.

        `ground` tells which points the survey covers; trees on other ground are neither. A survey counts as the share
        of the known trees that it shows, so that one that is unlike all others changes little.
        """
        old = self.trees * (1, 1, DECAY, DECAY)
        new = np.column_stack([xy, np.ones(len(xy)), np.zeros(len(xy))])
        if len(old) == 0 or len(xy) == 0:
            return Memory(self.counts, frozen_array(np.concatenate([old, new])))
        distance, record = nearest(cKDTree(old[:, :2]), xy, COVERED * step)
        _, back = nearest(cKDTree(xy), old[:, :2], SAME * step)
        same = np.flatnonzero(distance <= SAME * step)
        same = same[back[record[same]] == same]
        at = record[same]
        absent = ground(old[:, :2])
        absent[at] = False
        shown, hidden = old[at, 2].sum(), old[absent, 2].sum()
        counts = shown / (shown + hidden) if shown + hidden > 0 else 1.0
        # A tree that is new was missed by all that saw, or missed, its neighbour.
        near = np.isfinite(distance)
        new[:, 2] = counts
        new[near, 3] = old[record[near], 2:].sum(axis=1)
        weight = counts / np.maximum(counts + old[at, 2], 1e-9)
        old[at, :2] += weight[:, None] * (xy[same] - old[at, :2])
        old[at, 2] += counts
        old[absent, 3] += counts
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
