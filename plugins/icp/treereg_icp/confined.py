"""Trees confined to matched rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.pair import Pair, Rows
from treereg_core.transform import FloatArray

# Rows stand so many metres apart in the third coordinate that no neighbour is found in another one.
APART = 1e7


@dataclass(frozen=True, eq=False)
class Confined:
    """Trees, and the number (n,) of the matched row that each stands in; negative for a tree in none."""

    features: FeatureSet
    row: FloatArray

    def points(self, xy: FloatArray) -> FloatArray:
        """Where the trees stand, (n, 3), when their places are `xy`: the third coordinate keeps rows apart."""
        return np.column_stack([xy, APART * self.row])


def confined(pair: Pair) -> tuple[Confined, Confined]:
    """Reference and source, labelled by the match of each tree's row; all alike when no rows are matched."""
    rows = pair.rows
    if rows is None or len(rows.matches) == 0:
        return _everywhere(pair.reference), _everywhere(pair.source)
    # Trees in no matched row differ from all others, those of the other survey included.
    return (
        _labelled(pair.reference, rows.reference, rows.matches[:, 0], -1.0),
        _labelled(pair.source, rows.source, rows.matches[:, 1], -2.0),
    )


def _everywhere(features: FeatureSet) -> Confined:
    return Confined(features, np.zeros(len(features)))


def _labelled(features: FeatureSet, rows: Rows, which: IntArray, none: float) -> Confined:
    trees = [rows.trees[k] for k in which]
    match = np.repeat(np.arange(len(which)), [len(row) for row in trees])
    at = features.positions(np.concatenate(trees))
    label = np.full(len(features), none)
    label[at[at >= 0]] = match[at >= 0]
    return Confined(features, label)
