"""Laws on row detectors and row matchers."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import RowDetector, RowMatcher
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import (
    copies,
    heading,
    moved,
    off,
    ordinary,
    row_of_trees,
    small_motion,
    swapped,
    true_rows,
)
from treereg_core.testing.using import (
    CONTEXT,
    NO_MATCHES,
    placed,
    require_near,
    require_rows,
    seen,
    suited,
    use,
)
from treereg_core.transform import Rigid

WITHIN_ROWS = 0.9
"""Least share of consecutive trees that truly stand in one row, in an ordinary orchard; a wrong direction gives none,
and the published detectors reach 0.87 to 0.99 in their authors' orchards."""


@law
def a_tree_stands_in_one_row(method: RowDetector) -> None:
    """Rows are of two trees or more, hold no tree twice, and none that is not there."""
    for survey in (ordinary().reference, ordinary().source):
        require_rows(method.detect(survey, CONTEXT), survey.ids.tolist(), "an ordinary orchard")


@law
def rows_are_the_planted_ones(method: RowDetector) -> None:
    """In an ordinary orchard consecutive trees of a row stand in one planted row, and most trees are in a row."""
    simulation = ordinary()
    rows = method.detect(simulation.reference, CONTEXT)
    share = share_within(rows, row_of_trees(simulation, simulation.reference))
    require(share >= WITHIN_ROWS, f"only {share:.0%} of consecutive trees stand in one planted row")
    trees = sum(len(row) for row in rows.trees)
    require(trees >= 0.8 * len(simulation.reference), f"only {trees} of {len(simulation.reference)} trees are in rows")


@law
def trees_of_a_row_follow_each_other(method: RowDetector) -> None:
    """Along a row the trees stand in order: the way through them is hardly longer than the row."""
    features = ordinary().reference
    rows = method.detect(features, CONTEXT)
    way = sum(length(features, row) for row in rows.trees)
    straight = sum(extent(features, row) for row in rows.trees)
    require(way <= 1.3 * straight, f"the way along the rows is {way / max(straight, 1e-9):.1f} times their length")


@law
def rows_turn_with_the_orchard(method: RowDetector) -> None:
    """An orchard turned by any angle has as good rows."""
    simulation = ordinary()
    for angle in (30.0, 90.0, 171.0):
        turned = moved(simulation.reference, Rigid.turn(angle))
        share = share_within(method.detect(turned, CONTEXT), row_of_trees(simulation, simulation.reference))
        require(share >= WITHIN_ROWS, f"turned by {angle:g} degrees: only {share:.0%} of steps stay in a planted row")


@law
def a_row_is_matched_once(method: RowMatcher) -> None:
    """No row of either survey stands in two matches, and every match is of rows that are there."""
    pair, given = suited(method, ordinary()), true_rows(ordinary())
    for matched in use(method, pair):
        require(matched.rows is not None and len(matched.rows.matches), "no rows are matched")
        for column, rows in zip(matched.rows.matches.T, (given.reference, given.source), strict=True):
            require(len(np.unique(column)) == len(column), "a row is matched twice")
            require(((column >= 0) & (column < len(rows))).all(), "a match is of a row that is not there")


@law
def rows_and_trees_stay(method: RowMatcher) -> None:
    """A row matcher changes matches and the placement, nothing else."""
    pair = suited(method, ordinary())
    for matched in use(method, pair):
        same = matched.reference is pair.reference and matched.source is pair.source
        require(same and seen(matched).rows == seen(pair).rows, "trees or rows were changed")


@law
def true_rows_are_matched_right(method: RowMatcher) -> None:
    """Given the true rows and a start near the truth, most rows find their own and their trees lie right."""
    simulation = ordinary()
    pair = suited(method, simulation)
    result = use(method, pair)
    require(not isinstance(result, NoRegistration), f"it refused: {result}")
    ours, theirs = (row_of_trees(simulation, survey) for survey in (simulation.reference, simulation.source))
    matches = [(ours[min(a)], theirs[min(b)]) for a, b in seen(result).matches]
    right = sum(a == b for a, b in matches)
    require(right >= 0.95 * len(matches), f"{len(matches) - right} of {len(matches)} matches are wrong")
    rows = min(len(true_rows(simulation).reference), len(true_rows(simulation).source))
    require(right >= 0.8 * rows, f"only {right} of {rows} rows are matched")
    error = simulation.error(placed(result))
    require(error <= pair.reference.spacing / 4, f"the placement by rows is {error:.2f} m off")


@law
def rows_are_found_from_two_trees_along(method: RowMatcher) -> None:
    """From two trees along the rows and a third of a row across off, most rows find their own and are laid on them.

    Where along them is for the trees to say, and may stay open: rows look the same one tree over.
    """
    simulation = ordinary()
    ours, theirs = (row_of_trees(simulation, survey) for survey in (simulation.reference, simulation.source))
    rows = min(len(true_rows(simulation).reference), len(true_rows(simulation).source))
    _, across = heading(simulation)
    truth = off(simulation, 0, 0).reference_from_source
    for spacings in (-2.0, 2.0):
        pair = off(simulation, spacings, 1 / 3)
        result = use(method, pair)
        require(not isinstance(result, NoRegistration), f"{spacings:g} trees along it refused: {result}")
        right = sum(ours[min(a)] == theirs[min(b)] for a, b in seen(result).matches)
        require(right >= 0.8 * rows, f"{spacings:g} trees along only {right} of {rows} rows find their own")
        away = (placed(result)(pair.source.xy) - truth(pair.source.xy)) @ across
        error = float(np.sqrt(np.mean(away**2)))
        most = simulation.scene.row_spacing / 8
        require(error <= most, f"{spacings:g} trees along the rows lie {error:.2f} m beside their own")


@law
def copied_rows_come_back(method: RowMatcher) -> None:
    """Rows and their exact copies in another frame: the transform comes back, to within one tree's detection error."""
    pair, truth = copied_rows()
    placement = placed(use(method, pair))
    require_near(placement, truth, pair.source.xy, ordinary().scene.jitter, "the transform between the copies")


@law
def the_order_and_sense_of_rows_are_irrelevant(method: RowMatcher) -> None:
    """Rows in another order, each run through from its other end, are matched the same."""
    pair, _ = copied_rows()
    rows = true_rows(ordinary()).reference
    turned = MatchedRows(rows, Rows(tuple(row[::-1] for row in reversed(rows.trees))), NO_MATCHES)
    before, after = (seen(use(method, p)) for p in (pair, replace(pair, rows=turned)))
    require(before.matches == after.matches, "other rows are matched")


@law
def swapped_rows_are_matched_the_same(method: RowMatcher) -> None:
    """Reference and source in each other's place: the same matches, the other way round."""
    pair, _ = copied_rows()
    before, after = seen(use(method, pair)).matches, seen(use(method, swapped(pair))).matches
    require({(b, a) for a, b in after} == before, "other rows are matched")


def copied_rows() -> tuple[Pair, Rigid]:
    """A survey with its true rows and an exact copy of both, a little off; and the transform between them."""
    simulation = ordinary()
    truth = Rigid.turn(25.0, shift=(12.0, -30.0))
    pair = copies(simulation.reference, truth)
    rows = true_rows(simulation).reference
    start = small_motion(simulation.reference.xy, simulation.reference.spacing) @ truth
    return replace(pair.at(start), rows=MatchedRows(rows, rows, NO_MATCHES)), truth


def share_within(rows: Rows, row_of: dict[int, int]) -> float:
    """Share of consecutive trees that stand in the same planted row; pairs with a false detection do not count."""
    steps = [(a, b) for row in rows.trees for a, b in pairwise(row.tolist()) if a in row_of and b in row_of]
    return sum(row_of[a] == row_of[b] for a, b in steps) / max(len(steps), 1)


def length(features: FeatureSet, row: np.ndarray) -> float:
    """The way through the trees of a row, metres."""
    return float(np.hypot(*np.diff(features.xy[features.positions(row)], axis=0).T).sum())


def extent(features: FeatureSet, row: np.ndarray) -> float:
    """The distance between the trees of a row that are farthest apart, metres, measured across their bounding box."""
    return float(np.hypot(*np.ptp(features.xy[features.positions(row)], axis=0)))
