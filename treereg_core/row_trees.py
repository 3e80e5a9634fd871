"""The trees that stand opposite each other along matched rows, and the model fitted to them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.method import Context, Registration
from treereg_core.pair import Pair, Rows
from treereg_core.row_lines import step_along, trees_of

# Trees farther apart than this share of the in-row spacing are not a pair.
REACH = 0.4
# Residuals beyond so many standard deviations count little.
STRAY = 2.5
# At most so many times trees are paired anew after a fit.
ROUNDS = 4


def along_rows(pair: Pair, context: Context) -> Registration:
    """The model fitted to trees of matched rows that are each other's nearest within their rows, strays counting less.

    It starts from the pair's transform, and pairs anew after each fit until nothing changes. Raises `NoRegistration`
    when the trees are fewer than three or do not determine the model.
    """
    ids = trees_along_rows(pair)
    registration = _fitted(pair, ids, context)
    for _ in range(ROUNDS):
        pair, before = pair.at(registration.transform), ids
        ids = trees_along_rows(pair)
        registration = _fitted(pair, ids, context)
        if np.array_equal(ids, before):
            break
    return registration


def _fitted(pair: Pair, ids: IntArray, context: Context) -> Registration:
    if len(ids) < 3:
        raise NoRegistration(f"the {len(ids)} trees that meet along the matched rows are too few to fix a placement")
    i, j = pair.reference.positions(ids[:, 0]), pair.source.positions(ids[:, 1])
    square = ((pair.reference.xy[i] - pair.source_in_reference[j]) ** 2).sum(axis=1)
    # The median square of two normal residuals is 1.386 variances.
    variance = max(float(np.median(square)) / 1.386, 1e-12)
    weight = pair.reference.weight[i] * pair.source.weight[j] / (1 + square / (2 * STRAY**2 * variance)) ** 2
    try:
        transform = context.model.fit(pair.source.xy[j], pair.reference.xy[i], weight)
    except ValueError as error:
        raise NoRegistration(f"the {len(ids)} trees along the matched rows fix no placement: {error}") from None
    return Registration(transform, ids, weight)


def trees_along_rows(pair: Pair) -> IntArray:
    """Ids (n, 2), reference and source, of the trees of matched rows that are each other's nearest in their rows.

    Trees farther apart than two fifths of the in-row spacing are no pair.
    """
    if pair.rows is None or not len(pair.rows.matches):
        return np.empty((0, 2), dtype=np.int64)
    reference, ours = _of_matches(pair.rows.reference, pair.rows.matches[:, 0], pair.reference)
    source, theirs = _of_matches(pair.rows.source, pair.rows.matches[:, 1], pair.source)
    reach = REACH * step_along(pair.reference.xy[reference], ours)
    if not len(source) or reach == 0:
        return np.empty((0, 2), dtype=np.int64)
    # Rows lie apart in the third coordinate, so that trees of different matches never meet.
    fixed = np.column_stack([pair.reference.xy[reference], 4 * reach * ours])
    moved = np.column_stack([pair.source_in_reference[source], 4 * reach * theirs])
    _, partner = nearest(cKDTree(moved), fixed, reach)
    _, back = nearest(cKDTree(fixed), moved, reach)
    mutual = np.append(back, -1)[partner] == np.arange(len(fixed))
    return np.column_stack([pair.reference.ids[reference[mutual]], pair.source.ids[source[partner[mutual]]]])


def _of_matches(rows: Rows, chosen: IntArray, features: FeatureSet) -> tuple[IntArray, IntArray]:
    """Positions (n,) of the trees of the chosen rows, and the match (n,) that each is in."""
    return trees_of(Rows(tuple(rows.trees[row] for row in chosen)), features)
