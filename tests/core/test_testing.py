"""Scenes and strategies: what the laws and the properties stand on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as profile
from hypothesis import strategies as st

from treereg_core.pair import Pair, Rows
from treereg_core.simulate import Simulation
from treereg_core.testing import scenes
from treereg_core.testing import strategies as some
from treereg_core.testing.law import LawSkipped, law, require
from treereg_core.testing.using import apart, difference, plain, require_rows, seen
from treereg_core.transform import Affine, Model, Rigid


@given(st.sampled_from(Model), st.data())
def test_transforms_are_of_the_kind_asked_for(model: Model, data: st.DataObject) -> None:
    t = data.draw(some.transforms(model))
    assert type(t) is model.kind
    assert 0.5 - 1e-9 <= t.scale <= 2 + 1e-9


@given(some.pairs())
def test_pairs_are_consistent(pair: Pair) -> None:
    if pair.rows:
        require_rows(pair.rows.reference, pair.reference.ids.tolist(), "reference")
        require_rows(pair.rows.source, pair.source.ids.tolist(), "source")
        for column, rows in zip(pair.rows.matches.T, (pair.rows.reference, pair.rows.source), strict=True):
            assert len(set(column.tolist())) == len(column)
            assert all(0 <= k < len(rows) for k in column)


@profile(max_examples=20)
@given(some.simulations())
def test_simulated_scenes_have_a_truth_that_their_true_pairs_confirm(simulation: Simulation) -> None:
    pairs = simulation.true_pairs()
    assert simulation.truth is not None
    residual = simulation.truth(simulation.source.xy[pairs[:, 1]]) - simulation.reference.xy[pairs[:, 0]]
    assert math.sqrt(np.mean(residual**2)) < 2 * simulation.scene.jitter


@pytest.mark.parametrize("seed", range(3))
def test_near_is_a_quarter_of_the_spacing_off(seed: int) -> None:
    simulation = scenes.ordinary(seed)
    pair = scenes.near(simulation, seed)
    assert 0.2 < simulation.error(pair.reference_from_source) / simulation.reference.spacing < 0.3
    with pytest.raises(ValueError, match="no true transform"):
        scenes.near(scenes.scene("different orchards"))


def test_copies_are_the_same_trees_in_another_frame() -> None:
    survey, truth = scenes.ordinary().reference, Rigid.turn(30.0, shift=(5.0, 6.0))
    pair = scenes.copies(survey, truth)
    assert not np.array_equal(pair.source.ids, survey.ids)
    at = survey.positions(pair.source.ids)
    np.testing.assert_allclose(truth(pair.source.xy), survey.xy[at], atol=1e-9)


def test_shared_surveys_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="WRITEABLE"):
        scenes.ordinary().source.xy.setflags(write=True)


def test_true_rows_hold_the_trees_of_one_planted_row_in_order() -> None:
    simulation = scenes.ordinary()
    rows = scenes.true_rows(simulation)
    for survey, found in ((simulation.reference, rows.reference), (simulation.source, rows.source)):
        row_of = scenes.row_of_trees(simulation, survey)
        require_rows(found, survey.ids.tolist(), "rows")
        assert all(len({row_of[tree] for tree in row.tolist()}) == 1 for row in found.trees)
        steps = np.concatenate([np.diff(survey.xy[survey.positions(row)], axis=0) for row in found.trees])
        assert np.median(np.hypot(*steps.T)) == pytest.approx(simulation.scene.spacing, rel=0.1)


def test_lattices_look_the_same_one_step_on() -> None:
    for name, pair in scenes.lattices().items():
        features = pair.reference
        step = features.xy[1] - features.xy[0]
        distance, _ = features.tree.query(features.xy + step)
        assert np.mean(distance < 1e-9) > 0.9, name
        assert np.ptp(features.area) == np.ptp(features.confidence) == 0


def test_differences_are_told_in_words() -> None:
    survey = scenes.ordinary().reference
    pair = Pair(survey, survey)
    moved = pair.at(Rigid(np.eye(2), (0.3, 0.4)))
    fewer = pair.narrow(survey.take(np.arange(10, len(survey))), survey)
    heavier = pair.narrow(survey.replace(weight=2 * survey.weight), survey)
    assert difference(seen(pair), seen(scenes.shuffled(pair)), survey.xy, 1e-3) == ""
    assert difference(seen(pair), seen(moved), survey.xy, 1e-3) == "the trees lie 0.5 m apart"
    assert difference(seen(pair), seen(moved), survey.xy, 0.51) == ""
    assert difference(seen(pair), seen(fewer), survey.xy, 1e-3).startswith("10 trees")
    assert "weights" in difference(seen(pair), seen(heavier), survey.xy, 1e-3)
    assert "refused" in difference(seen(pair), seen(()), survey.xy, 1e-3)
    one, two = Rows((np.array([0, 1]),)), Rows((np.array([1, 0]), np.array([2, 3])))
    assert difference(seen((one, one)), seen((two, one)), survey.xy, 1e-3) == "1 rows are not in both"


@given(some.transforms(), some.points(1))
def test_apart_is_a_distance(t: Affine, p: np.ndarray) -> None:
    assert apart(t, t, p) == 0
    assert apart(t, Rigid(np.eye(2), (3.0, 4.0)) @ t, p) == pytest.approx(5)


def test_plain_tells_any_bit() -> None:
    survey = scenes.ordinary().reference
    assert plain(survey) == plain(survey.take(np.arange(len(survey))))
    assert plain(survey) != plain(survey.replace(xy=np.nextafter(survey.xy, np.inf)))


def test_a_law_names_itself_and_takes_errors_and_warnings_for_faults() -> None:
    @law
    def broken(_: object) -> None:
        require(False, "this happened")

    @law
    def crashing(_: object) -> None:
        raise KeyError("lost")

    @law
    def dividing(_: object) -> None:
        np.array([1.0]) / np.array([0.0])

    @law
    def skipped(_: object) -> None:
        raise LawSkipped("not here")

    for function, words in ((broken, "this happened"), (crashing, "KeyError: 'lost'"), (dividing, "divide by zero")):
        with pytest.raises(AssertionError, match=f"{function.__name__}: .*{words}"):
            function(None)
    with pytest.raises(LawSkipped):
        skipped(None)
