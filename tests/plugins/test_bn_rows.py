"""Rows matched by a network: starts some rows off, whatever a detector made of the rows, and what is learned."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from treereg_bn_rows import BnRows
from treereg_bn_rows.assignment import in_order
from treereg_bn_rows.counts import mixed, prior
from treereg_bn_rows.lessons import same_rows
from treereg_bn_rows.looks import candidates, ground_of
from treereg_bn_rows.network import network, posterior, xmlbif
from treereg_bn_rows.structure import PARENTS, STATES, shape

from tests.core.orchards import grid
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet, IntArray
from treereg_core.learning import Outcome
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.testing.scenes import moved, off, ordinary, row_of_trees, scene, shuffled, true_rows
from treereg_core.testing.using import plain, seen
from treereg_core.transform import Affine, Model, Rigid, Similarity

CONTEXT = Context()
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
RIGHT_M = 0.2
"""Far above what a fit to some hundred trees is off by (0.02 m), far below any wrong placement (a tree spacing)."""
STATE = {"version": 1, "surveys": 1, "counts": {name: np.ones(shape(name)).tolist() for name in PARENTS}}


def rows_of(pair: Pair) -> MatchedRows:
    assert pair.rows is not None
    return pair.rows


def require_right(simulation: Simulation, pair: Pair, least: float = 0.9) -> Pair:
    """The first result lies right, its matches are right, and most rows are matched."""
    first = BnRows().match(pair, CONTEXT)[0]
    assert simulation.error(first.reference_from_source) < RIGHT_M
    rows = rows_of(first)
    ours, theirs = (row_of_trees(simulation, survey) for survey in (simulation.reference, simulation.source))
    for i, j in rows.matches:
        mine = {ours[tree] for tree in rows.reference.trees[i].tolist() if tree in ours}
        assert mine & {theirs[tree] for tree in rows.source.trees[j].tolist() if tree in theirs}
    assert len(rows.matches) >= least * min(len(set(ours.values())), len(set(theirs.values())))
    return first


def changed(pair: Pair, change: object) -> Pair:
    """The same pair with each source row cut into the pieces that `change` gives."""
    assert callable(change)
    rows = rows_of(pair)
    pieces = [piece for k, row in enumerate(rows.source.trees) for piece in change(k, row) if len(piece) > 1]
    return replace(pair, rows=MatchedRows(rows.reference, Rows(tuple(pieces)), NO_MATCHES))


def turned_half(pair: Pair) -> Pair:
    """The same rows, laid the other way round about the middle of the source."""
    return pair.at(Rigid.turn(180.0, about=pair.source_in_reference.mean(axis=0)) @ pair.reference_from_source)


@pytest.mark.parametrize("rows", [-2.3, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 2.3])
@pytest.mark.parametrize("spacings", [-2.0, 0.0, 1.4])
def test_a_start_some_rows_off_is_mended(spacings: float, rows: float) -> None:
    require_right(ordinary(), off(ordinary(), spacings, rows))


@pytest.mark.parametrize("rows", [-1.0, 0.0, 2.0])
def test_a_half_turn_is_mended(rows: float) -> None:
    require_right(ordinary(), turned_half(off(ordinary(), 1.0, rows)))


@pytest.mark.parametrize("turn_deg", [-2.0, 2.0])
def test_a_start_that_is_turned_too_is_mended(turn_deg: float) -> None:
    pair = off(ordinary(), 1.0, 1.15)
    turn = Rigid.turn(turn_deg, about=pair.reference.xy.mean(axis=0))
    require_right(ordinary(), pair.at(turn @ pair.reference_from_source))


@pytest.mark.parametrize("name", ["noisy", "half overlap", "few trees"])
@pytest.mark.parametrize("rows", [0.2, 1.0, -2.0])
def test_noise_crops_and_few_trees(name: str, rows: float) -> None:
    simulation = scene(name, 1)
    require_right(simulation, off(simulation, 1.0, rows), least=0.7)


@pytest.mark.parametrize(
    "settings",
    [
        {"curve": 20.0},
        {"contour": 3.0},
        {"outline": "rectangle", "gaps": 0.03},
        {"row_spacing": 6.0, "spacing": 6.0},
        {"paths": 2},
        {"row_spacing": 3.5, "spacing": 1.5, "jitter": 0.15, "planting_jitter": 0.1, "split": 0.03, "merged": 0.03},
    ],
    ids=["curved", "contour", "a rectangle", "a square lattice", "paths", "dense"],
)
def test_kinds_of_orchards(settings: dict[str, float]) -> None:
    simulation = simulate(Scene(trees=900, rotation="any", shift_sd=15.0, **settings), 5)  # type: ignore[arg-type]
    require_right(simulation, off(simulation, -1.5, 1.1), least=0.85)


def test_the_profile_alone_finds_the_offset() -> None:
    """Crowns that say nothing and trees planted without error: only lengths, ends and gaps are left."""
    settings: dict[str, Any] = {"area_persistence": 0.0, "confidence_information": 0.0, "planting_jitter": 0.0}
    simulation = simulate(Scene(trees=900, rotation="any", **settings), 3)
    for rows in (-2.0, -1.0, 1.0, 2.0):
        require_right(simulation, off(simulation, 0.5, rows))


def test_rows_that_run_the_other_way() -> None:
    pair = off(ordinary(), 2.0, 1.0)
    require_right(ordinary(), changed(pair, lambda k, row: [row[::-1] if k % 2 else row]))


def test_rows_that_are_cut_short_anywhere() -> None:
    rng = np.random.default_rng(3)

    def cut(k: int, row: IntArray) -> list[IntArray]:
        first, last = sorted(rng.choice(len(row) + 1, 2, replace=False).tolist())
        return [row[first:last] if last - first > 5 else row]

    require_right(ordinary(), changed(off(ordinary(), 2.0, -1.0), cut))


def test_rows_that_are_split_in_one_survey_only() -> None:
    def split(k: int, row: IntArray) -> list[IntArray]:
        middle = len(row) // 3 + k % 3
        return [row[:middle], row[middle:]]

    require_right(ordinary(), changed(off(ordinary(), 2.0, 1.0), split))


def test_rows_that_are_missing_leave_gaps() -> None:
    pair = off(ordinary(), 1.0, 1.0)
    without = changed(pair, lambda k, row: [] if k % 4 == 1 else [row])
    first = require_right(ordinary(), without, least=0.65)
    assert len(rows_of(first).matches) >= 0.95 * len(rows_of(without).source)


def test_rows_in_pieces_in_both_surveys() -> None:
    simulation = simulate(Scene(trees=900, paths=2, rotation="any"), 8)
    pair = off(simulation, 1.0, -1.0)
    found = require_right(simulation, pair)
    assert len(rows_of(found).matches) > 0.95 * len(rows_of(pair).source)


def test_rows_across_the_others_are_matched_too() -> None:
    simulation = simulate(Scene(trees=900, outline="rectangle", headlands=2, rotation="any"), 2)
    found = require_right(simulation, off(simulation, 1.0, 1.0), least=0.95)
    across = simulation.trees.row.max()
    ours = row_of_trees(simulation, simulation.reference)
    assert across in {ours[int(rows_of(found).reference.trees[i][0])] for i, _ in rows_of(found).matches}


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
    source = moved(features, truth.inverse())
    start = Rigid(np.eye(2), (2.0, 3.0)) @ Rigid.turn(3.0)
    (found, *_) = BnRows().match(Pair(features, source, start, MatchedRows(rows, rows, NO_MATCHES)), Context(model))
    assert type(found.reference_from_source) is model.kind
    np.testing.assert_allclose(found.reference_from_source(source.xy), features.xy, atol=1e-6)


def test_where_the_profile_leaves_a_choice_several_placements_come_back() -> None:
    xy = grid(12, 20)
    trees = FeatureSet.of(xy, area=np.full(len(xy), 5.0))
    rows = Rows(tuple(np.arange(20) + 20 * k for k in range(12)))
    pair = Pair(trees, trees, rows=MatchedRows(rows, rows, NO_MATCHES))
    found = BnRows().match(pair, CONTEXT)
    assert 2 <= len(found) <= 5
    np.testing.assert_allclose(found[0].reference_from_source(xy), xy, atol=1e-6)
    places = np.array([one.reference_from_source(xy[:1])[0] for one in found])
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    assert apart[~np.eye(len(found), dtype=bool)].min() > 1.0
    assert len(BnRows(placements=1).match(pair, CONTEXT)) == 1


def test_where_it_leaves_none_one_comes_back() -> None:
    assert len(BnRows().match(off(ordinary(), 1.0, 1.0), CONTEXT)) == 1


def test_offsets_say_how_far_to_look() -> None:
    pair = off(ordinary(), 0.0, 5.0)
    assert ordinary().error(BnRows().match(pair, CONTEXT)[0].reference_from_source) > 5
    assert ordinary().error(BnRows(offsets=6.0).match(pair, CONTEXT)[0].reference_from_source) < RIGHT_M


def test_the_same_input_gives_the_same_bytes() -> None:
    pair = off(ordinary(), 1.0, 1.2)
    first, second = (BnRows().match(pair, Context(threads=threads)) for threads in (1, 2))
    assert [plain(p.reference_from_source) for p in first] == [plain(p.reference_from_source) for p in second]
    assert [plain(rows_of(p).matches) for p in first] == [plain(rows_of(p).matches) for p in second]


def test_the_order_of_rows_and_trees_is_irrelevant() -> None:
    pair = off(ordinary(), 1.0, 1.2)
    rows = rows_of(pair)
    mixed_up = MatchedRows(
        Rows(tuple(row[::-1] for row in rows.reference.trees[::-1])), Rows(rows.source.trees[::-1]), NO_MATCHES
    )
    before = BnRows().match(pair, CONTEXT)[0]
    after = BnRows().match(shuffled(replace(pair, rows=mixed_up)), CONTEXT)[0]
    assert seen(before).matches == seen(after).matches
    np.testing.assert_allclose(before.reference_from_source.matrix, after.reference_from_source.matrix, atol=1e-6)


def test_four_hundred_rows_find_their_own() -> None:
    rng = np.random.default_rng(0)
    xy = grid(400, 25, 5.0, 3.0) + rng.normal(0, 0.15, (10_000, 2))
    begin, end = rng.integers(0, 6, 400), rng.integers(19, 26, 400)
    column = np.tile(np.arange(25), 400)
    there = (column >= np.repeat(begin, 25)) & (column < np.repeat(end, 25)) & (rng.random(10_000) > 0.05)
    rows = Rows(tuple(25 * k + np.flatnonzero(there[25 * k : 25 * k + 25]) for k in range(400)))
    trees = FeatureSet.of(xy)
    trees = trees.take(np.flatnonzero(there))
    pair = Pair(trees, trees, Rigid(np.eye(2), (3.0, 5.0)), MatchedRows(rows, rows, NO_MATCHES))
    first = BnRows().match(pair, CONTEXT)[0]
    assert rows_of(first).matches.tolist() == [[k, k] for k in range(400)]


def estate(lines: int, pieces: int) -> Pair:
    """Rows of three trees, with a lane after each, of two equal surveys."""
    xy = grid(lines, 3 * pieces, 5.0, 3.0)
    xy[:, 0] += 6.0 * np.tile(np.arange(3 * pieces) // 3, lines)
    trees = FeatureSet.of(xy)
    rows = Rows(tuple(np.arange(len(xy)).reshape(-1, 3)))
    return Pair(trees, trees, rows=MatchedRows(rows, rows, NO_MATCHES))


def test_pairs_of_rows_grow_with_the_rows_and_not_with_their_square() -> None:
    """An estate may have 100,000 short rows; the memory is that of the pairs that lie beside each other."""
    pairs, peaks = [], []
    for size in (20, 40):
        pair = estate(size, size)
        ground = ground_of(pair, CONTEXT)
        tracemalloc.start()
        (found,) = candidates(ground, (pair.reference_from_source,), 20.0)
        chosen = in_order(found.i, found.j, np.where(np.abs(found.across) < 1, 5.0, -5.0))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        pairs.append(len(found.i))
        assert (found.i[chosen] == np.arange(size**2)).all()
        assert (found.j[chosen] == np.arange(size**2)).all()
    assert pairs == [20 * (20 * 7 - 12), 40 * (40 * 7 - 12)]  # up to three lines to both sides, less at the edges
    assert peaks[1] < 5 * peaks[0]


def test_short_rows_find_their_own() -> None:
    pair = estate(30, 30)
    first = BnRows().match(pair.at(Rigid(np.eye(2), (1.0, 1.5))), CONTEXT)[0]
    assert rows_of(first).matches.tolist() == [[k, k] for k in range(900)]


def test_assignments_keep_the_order_and_are_the_best() -> None:
    rng = np.random.default_rng(2)

    def best(values: np.ndarray, i: int = 0, j: int = 0) -> float:
        """The greatest sum by trying everything."""
        if i == values.shape[0] or j == values.shape[1]:
            return 0.0
        return float(max(best(values, i + 1, j), best(values, i, j + 1), values[i, j] + best(values, i + 1, j + 1)))

    for shape_ in ((1, 1), (3, 5), (5, 4), (6, 6)):
        values = rng.normal(0, 3, shape_)
        values[rng.random(shape_) < 0.3] = -np.inf
        i, j = np.divmod(rng.permutation(values.size), shape_[1])
        chosen = in_order(i, j, values[i, j])
        assert (np.diff(i[chosen]) > 0).all()
        assert (np.diff(j[chosen]) > 0).all()
        assert (values[i, j][chosen] > 0).all()
        assert values[i, j][chosen].sum() == pytest.approx(best(np.maximum(values, 0)))
    none = np.empty(0, dtype=np.int64)
    assert in_order(none, none, np.empty(0)).shape == (0,)


def test_of_equally_good_assignments_always_the_same_is_taken() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        i, j = np.divmod(rng.permutation(36), 6)
        value = rng.integers(-1, 3, (6, 6)).astype(np.float64)[i, j]
        chosen, mixed_up = in_order(i, j, value), rng.permutation(36)
        again = mixed_up[in_order(i[mixed_up], j[mixed_up], value[mixed_up])]
        assert chosen.tolist() == again.tolist()


def test_the_table_is_what_the_network_says_of_each_state() -> None:
    from pgmpy.inference import VariableElimination

    known = posterior(prior())
    inference = VariableElimination(network(prior()))
    rng = np.random.default_rng(4)
    for _ in range(5):
        state = {name: int(rng.integers(len(states))) for name, states in STATES.items()}
        for left_out in ((), ("field",), ("context", "field")):
            shown = {name: k for name, k in state.items() if name not in left_out}
            yes, no = inference.query(
                ["same"], {name: STATES[name][k] for name, k in shown.items()}, show_progress=False
            ).values
            found = known.log_odds({name: np.array([k]) for name, k in shown.items()})
            assert found == pytest.approx([np.log(yes / no)])


def test_evidence_that_depends_on_evidence_has_an_arc() -> None:
    assert {("length", "trees"), ("begin", "length"), ("end", "length")} <= set(network(prior()).edges())


def test_what_is_known_beforehand_makes_sense() -> None:
    known = posterior(prior())
    best = dict.fromkeys(STATES, np.array([0])) | {"context": np.array([3]), "field": np.array([3])}
    assert known.log_odds(best)[0] > 5
    worst = {name: np.array([len(states) - 1]) for name, states in STATES.items()} | {
        "context": np.array([0]),
        "field": np.array([0]),
    }
    assert known.log_odds(worst)[0] < -5
    alone = {**best, "context": np.array([4])}
    beside = {name: states for name, states in best.items() if name not in ("context", "field")}
    assert known.log_odds(alone | {"field": np.array([3])})[0] < known.log_odds(best)[0]
    assert known.log_odds({**beside, "context": np.array([4])}) == pytest.approx(known.log_odds(beside), abs=0.3)


def outcome_of(simulation: Simulation) -> Outcome:
    """What a method is told after a registration that found the truth."""
    pairs = simulation.true_pairs()
    ids = np.column_stack([simulation.reference.ids[pairs[:, 0]], simulation.source.ids[pairs[:, 1]]])
    return Outcome(off(simulation, 0.0, 0.0), ids)


def test_what_was_learned_is_remembered() -> None:
    state = BnRows().learn(outcome_of(ordinary()), {})
    again = json.loads(json.dumps(state))
    assert again == state
    assert state["surveys"] == 1
    counts = {name: np.array(values) for name, values in state["counts"].items()}
    rows = len(rows_of(BnRows().match(off(ordinary(), 0.0, 0.0), CONTEXT)[0]).matches)
    assert counts["offset"][0].sum() == pytest.approx(rows, abs=3)  # as many same pairs as rows, all counted under each
    assert len({float(counts[name][0].sum()) for name in PARENTS}) == 1
    assert counts["offset"][1].sum() > 5 * rows
    pair = off(ordinary(), 1.0, 1.0)
    learned = BnRows().match(pair, Context(memory={"bn_rows": again}))[0]
    assert ordinary().error(learned.reference_from_source) < RIGHT_M


def test_older_surveys_weigh_less() -> None:
    first = BnRows().learn(outcome_of(ordinary(0)), {})
    second = BnRows().learn(outcome_of(ordinary(1)), first)
    alone = BnRows().learn(outcome_of(ordinary(1)), {})
    assert second["surveys"] == 2
    kept = np.array(second["counts"]["offset"]) - 0.8 * np.array(first["counts"]["offset"])
    np.testing.assert_allclose(kept, alone["counts"]["offset"], atol=1e-4)


def test_what_is_learned_changes_what_is_said() -> None:
    """An orchard whose rows differ in length all the same: length stops speaking against a pair."""
    state = copy.deepcopy(STATE)
    table = np.zeros(shape("offset"))
    table[0, 3] = 10_000.0
    state["counts"]["offset"] = table.tolist()
    before, after = mixed({})["offset"], mixed(state)["offset"]
    assert after[0, 3] / after[0].sum() > 0.9 > 0.1 > before[0, 3] / before[0].sum()


def test_nothing_is_learned_without_rows() -> None:
    outcome = outcome_of(ordinary())
    without = Outcome(replace(outcome.pair, rows=None), outcome.matches)
    assert BnRows().learn(without, STATE) == STATE


def test_rows_are_the_same_when_most_of_their_matched_trees_are() -> None:
    rows = MatchedRows(
        Rows((np.array([0, 1, 2, 3]), np.array([4, 5, 6, 7]))),
        Rows((np.array([10, 11]), np.array([12, 13]), np.array([14, 15, 16, 17]))),
        NO_MATCHES,
    )
    matches = np.array([[0, 10], [1, 11], [2, 12], [3, 13], [4, 14], [5, 15], [6, 16], [7, 12]])
    assert same_rows(rows, matches) == {(0, 0), (0, 1), (1, 2)}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda state: state.update(version=2), "of version 2"),
        (lambda state: state.pop("version"), "of version None"),
        (lambda state: state.update(surveys="many"), "how many surveys"),
        (lambda state: state.update(surveys=0), "how many surveys"),
        (lambda state: state.pop("counts"), "exactly the counts"),
        (lambda state: state["counts"].pop("gaps"), "exactly the counts"),
        (lambda state: state["counts"].update(colour=[1]), "exactly the counts"),
        (lambda state: state["counts"].update(offset=[[1, 2], [3]]), "'offset' are not 2 x 4 numbers"),
        (lambda state: state["counts"].update(offset="1"), "'offset' are not 2 x 4 numbers"),
        (lambda state: state["counts"]["offset"][0].__setitem__(1, None), "'offset' are not 2 x 4 numbers"),
        (lambda state: state["counts"]["offset"][0].__setitem__(1, -1), "negative"),
        (lambda state: state["counts"]["offset"][0].__setitem__(1, float("nan")), "no number"),
        (lambda state: state["counts"]["offset"][0].__setitem__(1, 1e300), "too large"),
    ],
)
def test_a_damaged_memory_is_refused(change: object, sentence: str) -> None:
    assert callable(change)
    state = copy.deepcopy(STATE)
    change(state)
    for use in (
        lambda: BnRows().match(off(ordinary(), 0.0, 0.0), Context(memory={"bn_rows": state})),
        lambda: BnRows().learn(outcome_of(ordinary()), state),
        lambda: BnRows().export(state),
    ):
        with pytest.raises(InputError, match=f"memory of bn_rows is damaged.*{sentence}"):
            use()


def test_the_network_is_exported_for_other_programs(tmp_path: Any) -> None:
    from pgmpy.readwrite import XMLBIFReader

    (text,) = BnRows().export(STATE).values()
    assert list(BnRows().export(STATE)) == ["bn_rows.xml"]
    assert text == xmlbif(mixed(STATE))
    path = tmp_path / "bn_rows.xml"
    path.write_text(text, encoding="utf-8")
    again = XMLBIFReader(path=str(path)).get_model()
    original = network(mixed(STATE))
    assert set(again.edges()) == set(original.edges())
    assert again.check_model()


def test_pgmpy_is_imported_only_when_a_network_runs() -> None:
    code = "import sys, treereg_bn_rows.matcher; sys.exit('pgmpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
