"""Edges of rows against the truth: which consecutive trees a detector joined, and which it should have."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.pair import Rows
from treereg_core.simulate import Simulation, Trees

Edge = tuple[int, int]


class Kind(Enum):
    """What an edge is worth."""

    RIGHT = "right"
    WRONG = "wrong"
    MISSED = "missed"
    NEITHER = "neither"


@dataclass(frozen=True)
class Edges:
    """Edges by kind, each a pair of feature ids."""

    right: frozenset[Edge]
    wrong: frozenset[Edge]
    missed: frozenset[Edge]
    neither: frozenset[Edge]

    @property
    def iou(self) -> float:
        """Intersection over union: right / (right + wrong + missed); 0 when there are none."""
        return len(self.right) / max(len(self.right) + len(self.wrong) + len(self.missed), 1)

    @property
    def precision(self) -> float:
        """Right among the detected that count."""
        return len(self.right) / max(len(self.right) + len(self.wrong), 1)

    @property
    def recall(self) -> float:
        """Right among the true."""
        return len(self.right) / max(len(self.right) + len(self.missed), 1)


def compare(rows: Rows, simulation: Simulation, survey: FeatureSet) -> Edges:
    """The edges of rows that were detected in one of the two surveys of a simulation.

    True edges join consecutive trees of a row that the survey shows, one missing tree bridged. An edge along the row
    over a longer gap, or one that touches a false, split or merged detection, counts neither way.
    """
    shown = simulation.reference_trees if survey is simulation.reference else simulation.source_trees
    whole = whole_trees(shown)
    true, loose = true_edges(simulation, shown, whole)
    ids = survey.ids
    position = {int(k): i for i, k in enumerate(ids)}
    detected = {edge(a, b) for row in rows.trees for a, b in pairwise(position[int(k)] for k in row)}
    neither = {e for e in detected if e in loose or whole[e[0]] < 0 or whole[e[1]] < 0}

    def named(edges: Iterable[Edge]) -> frozenset[Edge]:
        return frozenset((int(ids[a]), int(ids[b])) for a, b in edges)

    return Edges(named(detected & true), named(detected - true - neither), named(true - detected), named(neither))


def truths(simulation: Simulation) -> list[Simulation]:
    """The simulation, and in a square lattice, where nothing tells them apart, also that with rows for columns."""
    if simulation.scene.row_spacing != simulation.scene.spacing:
        return [simulation]
    trees = simulation.trees
    return [simulation, replace(simulation, trees=Trees(trees.xy, trees.area, row=trees.column, column=trees.row))]


def whole_trees(shown: IntArray) -> IntArray:
    """The tree that each feature shows alone and whole, (n,); -1 for a false, split or merged one."""
    tree = np.where(shown[:, 1] < 0, shown[:, 0], -1)
    count = np.bincount(shown[shown >= 0], minlength=1)
    split = (tree >= 0) & (count[np.maximum(tree, 0)] > 1)
    return np.asarray(np.where(split, -1, tree), dtype=np.int64)


def true_edges(simulation: Simulation, shown: IntArray, whole: IntArray) -> tuple[set[Edge], set[Edge]]:
    """True edges as positions of features, and those between consecutive trees of a row that count neither way."""
    row, column = simulation.trees.row, simulation.trees.column
    seen = np.unique(shown[shown >= 0])
    place = set(zip(row[seen].tolist(), column[seen].tolist(), strict=True))
    at = np.flatnonzero(whole >= 0)
    at = at[np.lexsort((column[whole[at]], row[whole[at]]))]
    true: set[Edge] = set()
    loose: set[Edge] = set()
    for a, b in pairwise(at.tolist()):
        i, j = whole[a], whole[b]
        if row[i] != row[j]:
            continue
        step = int(column[j] - column[i])
        bridged = step == 2 and (int(row[i]), int(column[i]) + 1) not in place
        (true if step == 1 or bridged else loose).add(edge(a, b))
    return true, loose


def edge(a: int, b: int) -> Edge:
    """An edge in one sense."""
    return (a, b) if a < b else (b, a)
