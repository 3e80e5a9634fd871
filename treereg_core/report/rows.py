"""The rows of both surveys as people number them, and the gaps within those of the reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.numbering import numbered
from treereg_core.pair import Rows
from treereg_core.result import Result, trees
from treereg_core.row_lines import step_along, trees_of
from treereg_core.transform import FloatArray

LONGEST_GAP = 5
"""A step over more missing trees is a path, not a gap."""
NEAR = 0.45
"""A tree this share of the in-row spacing from the middle of a gap fills it."""


def rows_json(result: Result) -> dict[str, Any] | None:
    """The rows that the method went through; None where it looked for none.

    `reference` and `source` hold for each row the positions of its trees, in order; the first row of the reference is
    row 1, at the north-west corner. `partner` has for each row of the source the position of the same row of the
    reference, or -1. `gaps` (k, 2) are places in centimetres where a row of the reference lacks a tree that the source
    does not show either.
    """
    if result.rows is None:
        return None
    reference, source = trees(result.reference), trees(result.source)
    given = result.rows.reference
    ordered = numbered(given, reference)
    place = {int(row.min()): number for number, row in enumerate(ordered.trees) if len(row)}
    partner = np.full(len(result.rows.source), -1, dtype=np.int64)
    for mine, its in result.rows.matches:
        if len(given.trees[mine]):
            partner[its] = place[int(given.trees[mine].min())]
    return {
        "reference": _positions(ordered, reference),
        "source": _positions(result.rows.source, source),
        "partner": partner.tolist(),
        "gaps": np.round(100 * _gaps(ordered, result)).astype(np.int64).tolist(),
    }


def _positions(rows: Rows, features: FeatureSet) -> list[list[int]]:
    return [[at for at in features.positions(row).tolist() if at >= 0] for row in rows.trees]


def _gaps(rows: Rows, result: Result) -> FloatArray:
    reference, source = trees(result.reference), trees(result.source)
    at, row = trees_of(rows, reference)
    spacing = step_along(reference.xy[at], row)
    if spacing <= 0:
        return np.empty((0, 2))
    inner = np.flatnonzero(np.diff(row) == 0)
    begin, end = reference.xy[at[inner]], reference.xy[at[inner + 1]]
    count: IntArray = np.round(np.hypot(*(end - begin).T) / spacing).astype(np.int64) - 1
    count[count > LONGEST_GAP] = 0
    step = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count)
    share = (within + 1) / (count[step] + 1)
    gaps = begin[step] + share[:, None] * (end - begin)[step]
    if result.transform is None or not len(gaps):
        return gaps
    _, filled = nearest(source.tree, result.transform.inverse()(gaps), NEAR * spacing)
    return np.asarray(gaps[filled == len(source)])
