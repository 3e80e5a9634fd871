"""Which trees go on: the most probable, with their partners, and spread over the ground that both surveys show."""

from __future__ import annotations

import numpy as np

from treereg_bn_landmarks.evidence import Side
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

CELLS = 6
"""The orchard is divided into about so many cells each way, along and across the planting."""
SPREAD = 0.75
"""This share of the trees is chosen cell by cell, the rest by probability alone."""


def choose(sides: tuple[Side, Side], probability: tuple[FloatArray, FloatArray], share: float) -> tuple[BoolArray, ...]:
    """Which trees of both surveys are chosen, as masks: this share of each survey, one tree at least.

    Trees and their mutual partners are chosen together, since a tree without its partner fixes nothing: for each cell
    a quota in proportion to its trees, best first, then the best that are left. What is left of a survey's share, when
    there are not so many pairs, goes to its most probable other trees.
    """
    reference, source = sides
    wanted = [int(np.ceil(share * len(p))) for p in probability]
    i = np.flatnonzero(reference.mutual)
    j = reference.partner[i]
    pairs = probability[0][i] * probability[1][j]
    sure = reference.features.confidence[i] + source.features.confidence[j]
    order = np.lexsort((source.features.ids[j], reference.features.ids[i], -sure, -pairs))
    i, j = i[order], j[order]
    cells = _cells(sides, (reference.xy[i] + source.xy[j]) / 2)
    taken = _spread(cells, min(*wanted, len(i)))
    chosen = []
    for side, p, count, mine in zip(sides, probability, wanted, (i[taken], j[taken]), strict=True):
        mask = np.zeros(len(p), dtype=bool)
        mask[mine] = True
        best = np.lexsort((side.features.ids, -side.features.confidence, -p))
        best = best[~mask[best]]
        mask[best[: max(count - len(mine), 0)]] = True
        chosen.append(mask)
    return tuple(chosen)


def passing(probability: FloatArray, threshold: float, least: float) -> BoolArray:
    """Which trees (n,) are at least so probable, and at least so large a share of them, the most probable; ties all."""
    count = int(np.ceil(least * len(probability)))
    return np.asarray(probability >= min(threshold, np.sort(probability)[-count]))


def _cells(sides: tuple[Side, Side], points: FloatArray) -> IntArray:
    """The cell (n,) of each point, in a grid that turns with the planting and has the orchard's middle in the centre.

    So it makes no difference in which frame the surveys come.
    """
    every = np.concatenate([side.xy for side in sides])
    axis = sides[0].planting.axis.conjugate()
    middle = np.median((every[:, 0] + 1j * every[:, 1]).real), np.median(every[:, 1])
    turned = ((points - middle) @ (1, 1j)) * axis
    extent = np.quantile(np.abs(((every - middle) @ (1, 1j)) * axis), 0.9)
    size = max(2 * float(extent) / CELLS, 1e-9)
    column, row = np.floor(turned.real / size), np.floor(turned.imag / size)
    _, cell = np.unique(np.column_stack([column, row]), axis=0, return_inverse=True)
    return np.asarray(cell.reshape(-1), dtype=np.int64)


def _spread(cells: IntArray, count: int) -> BoolArray:
    """So many of the pairs, given best first: each cell's quota of the best in it, then the best of the rest."""
    quota = np.floor(SPREAD * count * np.bincount(cells) / max(len(cells), 1))
    # The place of each pair within its cell, best first.
    by_cell = np.argsort(cells, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(cells))])
    place = np.empty(len(cells), dtype=np.int64)
    place[by_cell] = np.arange(len(cells)) - begin[cells[by_cell]]
    taken = place < quota[cells]
    rest = np.flatnonzero(~taken)[: count - int(taken.sum())]
    taken[rest] = True
    return np.asarray(taken)
