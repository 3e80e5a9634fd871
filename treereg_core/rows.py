"""The default row matcher, nearest summed distances, and the trees that stand opposite each other along rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray
from treereg_core.method import Context, Registration, RowMatcher
from treereg_core.pair import Pair, Rows
from treereg_core.transform import FloatArray


class NearestRows(RowMatcher):
    """Matches rows by the summed distances of their first, middle and last trees (the proposal's figure 5).

    It stands in for a row matcher where an expression has none. Good when the start is right to within half the
    distance of the rows; beyond that it matches neighbouring rows. Two rows are matched when each is the other's
    nearest, so that each is used once and a row without a partner stays alone; a row may run either way.
    """

    name = "nearest_rows"

    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """The one matching, with the model fitted to the trees along the matched rows."""
        rows = pair.rows
        if rows is None:
            raise NoRegistration("no rows were detected, so none can be matched")
        distance = summed_distances(
            three_trees(rows.reference, pair.reference, pair.reference.xy),
            three_trees(rows.source, pair.source, pair.source_in_reference),
        )
        matched = replace(pair, rows=replace(rows, matches=mutual_nearest(distance)))
        return (matched.at(along_rows(matched, context).transform),)


def three_trees(rows: Rows, features: FeatureSet, xy: FloatArray) -> FloatArray:
    """Positions (rows, 3, 2) of the first, middle and last tree of each row; infinite for an empty row."""
    ends = [[row[0], row[len(row) // 2], row[-1]] if len(row) else [-1, -1, -1] for row in rows.trees]
    place = features.positions(np.array(ends, dtype=np.int64).reshape(-1, 3))
    found = place >= 0
    return np.where(found[..., None], xy[np.where(found, place, 0)] if len(xy) else np.inf, np.inf)


def summed_distances(reference: FloatArray, source: FloatArray) -> FloatArray:
    """Summed distances (rows, rows), metres, of three trees each, by the better sense; infinite for empty rows."""
    present = np.logical_and.outer(np.isfinite(reference[:, 0, 0]), np.isfinite(source[:, 0, 0]))
    a, b = np.nan_to_num(reference, posinf=0)[:, None], np.nan_to_num(source, posinf=0)[None, :]
    forward = np.linalg.norm(a - b, axis=-1).sum(axis=-1)
    backward = np.linalg.norm(a - b[:, :, ::-1], axis=-1).sum(axis=-1)
    return np.where(present, np.minimum(forward, backward), np.inf)


def mutual_nearest(distance: FloatArray) -> IntArray:
    """Pairs (k, 2) of a row and a column each of which is the other's nearest, at a finite distance."""
    if distance.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    column = distance.argmin(axis=1)
    row = np.arange(len(distance))
    keep = (distance.argmin(axis=0)[column] == row) & np.isfinite(distance[row, column])
    return np.column_stack([row[keep], column[keep]]).astype(np.int64)


def along_rows(pair: Pair, context: Context) -> Registration:
    """The model fitted to trees of matched rows that are each other's nearest within their rows.

    Raises `NoRegistration` when no rows are matched, or their trees are fewer than three or do not determine the model.
    """
    ids = trees_along_rows(pair)
    if len(ids) < 3:
        raise NoRegistration(f"the {len(ids)} trees of the matched rows are too few to fix a placement")
    reference = pair.reference.xy[pair.reference.positions(ids[:, 0])]
    source = pair.source.xy[pair.source.positions(ids[:, 1])]
    try:
        transform = context.model.fit(source, reference)
    except ValueError as error:
        raise NoRegistration(f"the {len(ids)} trees of the matched rows fix no placement: {error}") from None
    return Registration(transform, ids, np.ones(len(ids)))


def trees_along_rows(pair: Pair) -> IntArray:
    """Ids (n, 2), reference and source, of the trees of matched rows that are each other's nearest in their rows."""
    if pair.rows is None or not len(pair.rows.matches):
        return np.empty((0, 2), dtype=np.int64)
    reference_ids, reference = lifted(pair.rows.reference, pair.rows.matches[:, 0], pair.reference, pair.reference.xy)
    source_ids, source = lifted(pair.rows.source, pair.rows.matches[:, 1], pair.source, pair.source_in_reference)
    height = 4 * float(max(np.ptp(np.vstack([reference, source])[:, :2], axis=0).max(), 1.0))
    reference[:, 2] *= height
    source[:, 2] *= height
    partner = np.asarray(cKDTree(source).query(reference)[1])
    back = np.asarray(cKDTree(reference).query(source)[1])
    mutual = (back[partner] == np.arange(len(reference))) & (reference[:, 2] == source[partner, 2])
    return np.column_stack([reference_ids[mutual], source_ids[partner[mutual]]])


def lifted(rows: Rows, chosen: IntArray, features: FeatureSet, xy: FloatArray) -> tuple[IntArray, FloatArray]:
    """Ids (n,) and points (n, 3) of the trees of the chosen rows; the third coordinate tells the matches apart."""
    ids = np.concatenate([rows.trees[row] for row in chosen])
    match = np.repeat(np.arange(len(chosen)), [len(rows.trees[row]) for row in chosen])
    return ids, np.column_stack([xy[features.positions(ids)], match.astype(np.float64)])
