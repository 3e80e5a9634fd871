"""The default row matcher: rows matched, laid on each other and slid along, whatever a detector made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.core.orchards import grid
from treereg_core.features import FeatureSet, IntArray
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.pipeline import Pipeline
from treereg_core.row_lines import RowLines
from treereg_core.row_matching import match_rows
from treereg_core.row_trees import along_rows, trees_along_rows
from treereg_core.rows import NearestRows
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.testing.scenes import heading, moved, off, ordinary, row_of_trees, scene, shuffled, true_rows
from treereg_core.testing.using import plain, seen
from treereg_core.transform import Affine, Model, Rigid, Similarity

CONTEXT = Context()
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
RIGHT_M = 0.2
"""Far above what a fit to some hundred trees is off by (0.02 m), far below any wrong placement (a tree spacing)."""


def rows_of(pair: Pair) -> MatchedRows:
    assert pair.rows is not None
    return pair.rows


def require_right(simulation: Simulation, pair: Pair, least: float = 0.9) -> Pair:
    """The first result lies right, its matches are right, and most rows are matched."""
    first = NearestRows().match(pair, CONTEXT)[0]
    assert simulation.error(first.reference_from_source) < RIGHT_M
    rows = rows_of(first)
    ours, theirs = (row_of_trees(simulation, survey) for survey in (simulation.reference, simulation.source))
    for i, j in rows.matches:
        mine = {ours[tree] for tree in rows.reference.trees[i].tolist() if tree in ours}
        assert mine & {theirs[tree] for tree in rows.source.trees[j].tolist() if tree in theirs}
    assert len(rows.matches) >= least * min(len(set(ours.values())), len(set(theirs.values())))
    return first


@pytest.mark.parametrize("spacings", [-2.0, -1.3, 0.0, 0.5, 2.0])
@pytest.mark.parametrize("rows", [-0.4, 0.0, 0.4])
def test_a_start_two_trees_along_and_two_fifths_of_a_row_across_is_mended(spacings: float, rows: float) -> None:
    require_right(ordinary(), off(ordinary(), spacings, rows))


@pytest.mark.parametrize("turn_deg", [-1.2, 1.2])
def test_a_start_that_is_turned_is_mended(turn_deg: float) -> None:
    # Rows end up to 55 m from the middle, which is 1.2 m across, a fifth of the row spacing.
    pair = off(ordinary(), 1.5, 0.15)
    turn = Rigid.turn(turn_deg, about=pair.reference.xy.mean(axis=0))
    require_right(ordinary(), pair.at(turn @ pair.reference_from_source))


@pytest.mark.parametrize("name", ["noisy", "half overlap", "few trees"])
def test_noise_crops_and_few_trees(name: str) -> None:
    simulation = scene(name, 1)
    require_right(simulation, off(simulation, 1.0, 0.3), least=0.7)


@pytest.mark.parametrize(
    "settings",
    [
        {"curve": 20.0},
        {"outline": "rectangle", "gaps": 0.03},
        {"row_spacing": 6.0, "spacing": 6.0},
        {"row_spacing": 3.5, "spacing": 1.5, "jitter": 0.15, "planting_jitter": 0.1, "split": 0.03, "merged": 0.03},
    ],
    ids=["curved", "a rectangle", "a square lattice", "dense"],
)
def test_kinds_of_orchards(settings: dict[str, float]) -> None:
    simulation = simulate(Scene(trees=900, rotation="any", shift_sd=15.0, **settings), 5)  # type: ignore[arg-type]
    require_right(simulation, off(simulation, -1.5, 0.25), least=0.85)


def changed(pair: Pair, change: object) -> Pair:
    """The same pair with each source row cut into the pieces that `change` gives."""
    assert callable(change)
    rows = rows_of(pair)
    pieces = [piece for k, row in enumerate(rows.source.trees) for piece in change(k, row) if len(piece) > 1]
    return replace(pair, rows=MatchedRows(rows.reference, Rows(tuple(pieces)), NO_MATCHES))


def test_rows_that_run_the_other_way() -> None:
    pair = off(ordinary(), 2.0, 0.3)
    require_right(ordinary(), changed(pair, lambda k, row: [row[::-1] if k % 2 else row]))


def test_rows_that_are_cut_short_anywhere() -> None:
    rng = np.random.default_rng(3)

    def cut(k: int, row: IntArray) -> list[IntArray]:
        first, last = sorted(rng.choice(len(row) + 1, 2, replace=False).tolist())
        return [row[first:last] if last - first > 5 else row]

    require_right(ordinary(), changed(off(ordinary(), 2.0, -0.3), cut))


def test_rows_that_are_split_in_one_survey_only() -> None:
    def split(k: int, row: IntArray) -> list[IntArray]:
        middle = len(row) // 3 + k % 3
        return [row[:middle], row[middle:]]

    first = require_right(ordinary(), changed(off(ordinary(), 2.0, 0.3), split))
    rows = rows_of(first)
    lengths = [len(rows.source.trees[j]) / len(rows.reference.trees[i]) for i, j in rows.matches]
    assert np.median(lengths) > 0.55  # the longer of both pieces


def test_a_gap_does_not_matter() -> None:
    def without_middle(k: int, row: IntArray) -> list[IntArray]:
        return [np.concatenate([row[: len(row) // 3], row[len(row) // 3 + 4 :]])] if len(row) > 12 else [row]

    require_right(ordinary(), changed(off(ordinary(), 2.0, 0.3), without_middle))


def test_neighbouring_rows_joined_by_mistake_spoil_little() -> None:
    pair = off(ordinary(), 1.0, 0.3)
    trees = list(rows_of(pair).source.trees)
    trees[4:6] = [np.concatenate([trees[4], trees[5][::-1]])]
    trees[9:11] = [np.concatenate([trees[9][::-1], trees[10]])]
    rows = MatchedRows(rows_of(pair).reference, Rows(tuple(trees)), NO_MATCHES)
    require_right(ordinary(), replace(pair, rows=rows), least=0.85)


def test_trees_missing_from_rows_and_false_ones_among_them() -> None:
    simulation = scene("noisy", 2)
    rng = np.random.default_rng(0)
    pair = off(simulation, 1.5, 0.2)
    rows = rows_of(pair)
    false = simulation.source.ids[simulation.source_trees[:, 0] < 0]

    def spoiled(row: IntArray) -> IntArray:
        kept = row[rng.random(len(row)) > 0.1]
        places = simulation.source.xy[simulation.source.positions(kept)]
        for tree in false:
            away = np.hypot(*(places - simulation.source.xy[simulation.source.positions(tree)]).T)
            if len(kept) and away.min() < 2.5 and tree not in kept:
                kept = np.insert(kept, int(away.argmin()), tree)
                places = simulation.source.xy[simulation.source.positions(kept)]
        return kept

    source = Rows(tuple(row for row in map(spoiled, rows.source.trees) if len(row) > 1))
    require_right(simulation, replace(pair, rows=replace(rows, source=source)), least=0.8)


@pytest.mark.parametrize(
    ("model", "truth"),
    [
        (Model.RIGID, Rigid.turn(3.0)),
        (Model.SIMILARITY, Similarity(1.01 * Rigid.turn(3.0).linear, (1.0, 2.0))),
        (Model.AFFINE, Affine(Rigid.turn(3.0).linear @ [[1.006, 0.004], [0.002, 0.995]], (1.0, 2.0))),
    ],
)
def test_the_model_is_the_contexts(model: Model, truth: Affine) -> None:
    features, rows = ordinary().reference, true_rows(ordinary()).reference
    along, _ = heading(ordinary())
    source = moved(features, truth.inverse())
    start = Rigid(np.eye(2), 1.6 * ordinary().scene.spacing * along) @ Rigid.turn(3.0)
    (found, *_) = NearestRows().match(
        Pair(features, source, start, MatchedRows(rows, rows, NO_MATCHES)), Context(model)
    )
    assert type(found.reference_from_source) is model.kind
    np.testing.assert_allclose(found.reference_from_source(source.xy), features.xy, atol=1e-6)


def test_a_start_of_a_wider_kind_than_the_model_is_taken() -> None:
    pair = off(ordinary(), 1.0, 0.2)
    wide = Affine(pair.reference_from_source.linear * 1.001, pair.reference_from_source.shift)
    found = require_right(ordinary(), pair.at(wide))
    assert type(found.reference_from_source) is Rigid


def test_from_the_truth_nothing_changes_but_noise() -> None:
    found = require_right(ordinary(), off(ordinary(), 0.0, 0.0), least=1.0)
    assert ordinary().error(found.reference_from_source) < 2 * ordinary().error(ordinary().true_fit())


def test_where_trees_leave_a_choice_rivals_come_back() -> None:
    xy = grid(8, 14)
    trees = FeatureSet.of(xy, area=np.full(len(xy), 5.0))
    rows = Rows(tuple(np.arange(14) + 14 * k for k in range(8)))
    found = NearestRows().match(Pair(trees, trees, rows=MatchedRows(rows, rows, NO_MATCHES)), CONTEXT)
    assert 2 <= len(found) <= 4
    shifts = np.array([pair.reference_from_source.shift for pair in found])
    np.testing.assert_allclose(shifts[0], 0, atol=1e-6)
    apart = np.hypot(*(shifts[:, None] - shifts[None]).transpose(2, 0, 1))
    assert apart[~np.eye(len(found), dtype=bool)].min() > 1.0
    for pair in found:
        assert len(rows_of(pair).matches) >= 6


def test_the_same_input_gives_the_same_bytes() -> None:
    pair = off(ordinary(), 1.0, 0.2)
    first, second = (NearestRows().match(pair, Context(threads=threads)) for threads in (1, 2))
    assert [plain(p.reference_from_source) for p in first] == [plain(p.reference_from_source) for p in second]
    assert [plain(rows_of(p).matches) for p in first] == [plain(rows_of(p).matches) for p in second]


def test_the_order_of_rows_and_trees_is_irrelevant() -> None:
    pair = off(ordinary(), 1.0, 0.2)
    rows = rows_of(pair)
    mixed = MatchedRows(
        Rows(tuple(row[::-1] for row in rows.reference.trees[::-1])), Rows(rows.source.trees[::-1]), NO_MATCHES
    )
    before = NearestRows().match(pair, CONTEXT)[0]
    after = NearestRows().match(shuffled(replace(pair, rows=mixed)), CONTEXT)[0]
    assert seen(before).matches == seen(after).matches
    np.testing.assert_allclose(before.reference_from_source.matrix, after.reference_from_source.matrix, atol=1e-6)


def test_far_coordinates_change_nothing() -> None:
    pair, far = off(ordinary(), 1.0, 0.2), Rigid(np.eye(2), (5e5, 6e6))
    there = Pair(
        moved(pair.reference, far),
        moved(pair.source, far),
        far @ pair.reference_from_source @ far.inverse(),
        pair.rows,
    )
    before, after = NearestRows().match(pair, CONTEXT)[0], NearestRows().match(there, CONTEXT)[0]
    assert seen(before).matches == seen(after).matches
    moved_back = far.inverse() @ after.reference_from_source @ far
    np.testing.assert_allclose(moved_back(pair.source.xy), before.reference_from_source(pair.source.xy), atol=1e-4)


def test_one_straight_row_is_enough() -> None:
    rng = np.random.default_rng(1)
    xy = np.column_stack([3.0 * np.arange(25) + rng.normal(0, 0.3, 25), rng.normal(0, 0.3, 25)])
    trees = FeatureSet.of(xy, area=rng.lognormal(1, 0.4, 25))
    row = Rows((np.arange(25),))
    start = Rigid.turn(1.0, shift=(4.0, 0.5))
    found = NearestRows().match(Pair(trees, trees, start, MatchedRows(row, row, NO_MATCHES)), CONTEXT)[0]
    np.testing.assert_allclose(found.reference_from_source(xy), xy, atol=1e-6)


def test_lines_bridge_gaps_and_know_their_distances() -> None:
    xy = np.delete(grid(4, 12), [16, 17, 18], axis=0)
    rows = Rows((np.arange(12), np.arange(12, 21)[::-1], np.arange(21, 33), np.arange(33, 45)))
    lines = RowLines.of(rows, FeatureSet.of(xy))
    assert lines.spacing == pytest.approx(3.0)
    assert lines.distance == pytest.approx(5.5)
    feet = lines.feet(np.array([[13.5, 6.0], [13.5, 0.4], [-4.0, 0.0], [-40.0, 0.0]]), np.tile([-1.0, 0.0], (4, 1)), 50)
    assert feet.row.tolist()[:3] == [1, 0, 0]
    assert feet.found.tolist() == [True, True, True, False]
    np.testing.assert_allclose(np.abs(feet.across[:3]), [0.5, 0.4, 0.0], atol=1e-9)
    assert not lines.feet(np.array([[13.5, 6.0]]), np.array([[0.7, 0.8]]), 50).found.any()


def test_rows_are_matched_on_the_stretch_that_both_have() -> None:
    trees = FeatureSet.of(grid(3, 20))
    whole = [np.arange(20) + 20 * k for k in range(3)]
    pieces = Rows((whole[0][:6], whole[0][7:], whole[1][12:][::-1], whole[2]))
    reference, source = RowLines.of(Rows(tuple(whole)), trees), RowLines.of(pieces, trees)
    assert match_rows(reference, source, Rigid(np.eye(2), (1.0, 0.9))).tolist() == [[0, 1], [1, 2], [2, 3]]
    assert match_rows(source, reference, Rigid(np.eye(2), (1.0, 0.9))).tolist() == [[1, 0], [2, 1], [3, 2]]


def test_trees_along_rows_are_near_and_of_one_match() -> None:
    trees = FeatureSet.of(grid(2, 6))
    rows = Rows((np.arange(6), np.arange(6, 12)))
    matched = MatchedRows(rows, rows, np.array([[0, 0], [1, 1]]))
    pair = Pair(trees, trees, Rigid(np.eye(2), (1.0, 0.0)), matched)
    assert trees_along_rows(pair).tolist() == [[k, k] for k in range(12)]
    assert len(trees_along_rows(pair.at(Rigid(np.eye(2), (1.3, 0.0))))) == 0
    across = Pair(trees, trees, Rigid(np.eye(2), (0.0, 5.5)), matched)
    assert len(trees_along_rows(across)) == 0


def test_what_rows_give_without_a_point_matcher_is_the_fit_to_their_trees() -> None:
    pair = off(ordinary(), 0.0, 0.0)
    matched = NearestRows().match(pair, CONTEXT)[0]
    found = Pipeline(stages=(NearestRows(),)).register(pair, CONTEXT)
    i, j = pair.reference.positions(found.pairs[:, 0]), pair.source.positions(found.pairs[:, 1])
    fit = Model.RIGID.fit(pair.source.xy[j], pair.reference.xy[i], found.weights)
    assert fit == found.transform
    np.testing.assert_allclose(found.transform.matrix, matched.reference_from_source.matrix, atol=1e-3)
    again = along_rows(matched, CONTEXT)
    assert (again.pairs == found.pairs).all()
    assert len(found.pairs) > 0.9 * len(ordinary().true_pairs())


def test_hedges_far_apart_are_laid_on_each_other() -> None:
    """Rows that stand five of their spacings apart, so that the ground between trees is a strip along each row."""
    rng = np.random.default_rng(4)
    xy = np.array([[0.8 * i, 4.0 * k] for k in range(10) for i in range(60)]) + 0.06 * rng.standard_normal((600, 2))
    area = np.exp(0.3 * rng.standard_normal(600))
    rows = Rows(tuple(np.arange(60) + 60 * k for k in range(10)))
    survey = FeatureSet.of(xy, area=area)
    seen_again = FeatureSet.of(xy + 0.03 * rng.standard_normal(xy.shape), area=area)
    start = Rigid.turn(0, shift=(1.4, -1.5))
    result = NearestRows().match(Pair(survey, seen_again, start, MatchedRows(rows, rows, NO_MATCHES)), CONTEXT)[0]
    np.testing.assert_allclose(result.reference_from_source(xy), xy, atol=0.1)


def test_rows_in_which_trees_stand_twice_are_matched() -> None:
    twice = FeatureSet.of(np.repeat(grid(12, 9), 2, axis=0))
    rows = Rows(tuple(np.arange(18) + 18 * k for k in range(12)))
    result = NearestRows().match(Pair(twice, twice, rows=MatchedRows(rows, rows, NO_MATCHES)), CONTEXT)[0]
    np.testing.assert_allclose(result.reference_from_source(twice.xy), twice.xy, atol=0.01)


def test_a_few_huge_steps_do_not_fill_the_memory() -> None:
    far = FeatureSet.of(np.array([[0.0, 0], [1e-5, 0], [2e-5, 0], [300, 0]]))
    assert len(RowLines.of(Rows((np.arange(4),)), far).points) <= 200
