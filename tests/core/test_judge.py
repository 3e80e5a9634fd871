"""The judge: what is right is accepted, what is wrong never, and what nobody can know is called so."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.core.orchards import (
    CONTEXT,
    IDENTITY,
    MAX_FAILURE,
    alike,
    grid,
    guesses,
    half_turn_symmetric,
    judged,
    lattice_steps,
    off_by,
    pair_of,
    settled,
    shifted_by,
    truth_of,
)
from treereg_core.api import execute
from treereg_core.features import FeatureSet
from treereg_core.judge import Judge
from treereg_core.judgement import Judgement, Verdict
from treereg_core.method import Context, Registration
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import installed
from treereg_core.simulate import Scene, simulate, simulate_family
from treereg_core.testing import scenes
from treereg_core.testing.scenes import moved
from treereg_core.transform import Rigid


def assert_failed(judgement: Judgement) -> None:
    """It says so in every field."""
    assert judgement.verdict is Verdict.FAILED
    assert judgement.transform is None
    assert judgement.expected_error is None
    assert judgement.failure_probability == 1
    assert judgement.rivals == ()
    assert len(judgement.matches.pairs) == 0
    assert judgement.matches.residual_rms is None
    assert judgement.reason.endswith(".")


class TestRight:
    @pytest.mark.parametrize(
        "family",
        ["shift_15", "rotation_any", "noisy", "curved", "bare_rectangle", "overlap_60", "square_any", "overlap_25"],
    )
    def test_a_right_placement_is_accepted_and_its_error_is_as_expected(self, family: str) -> None:
        for seed in range(2):
            simulation = simulate_family(family, 70 + seed)
            found = judged(pair_of(simulation), truth_of(simulation))
            assert found.verdict is Verdict.ACCEPTED
            assert found.failure_probability <= MAX_FAILURE
            assert found.transform is not None
            assert found.expected_error is not None
            error = simulation.error(found.transform)
            low, high = found.expected_error.ci95
            assert 0 < low < found.expected_error.rms < high < simulation.reference.spacing / 4
            assert low / 3 < error < 3 * high, f"{error} m, where {found.expected_error} was expected"

    def test_the_best_of_several_is_chosen_in_any_order(self) -> None:
        for seed in range(2):
            simulation = scenes.scene("noisy", seed)
            wrong = [off_by(simulation, 1, 0), off_by(simulation, 0, -1), Rigid.turn(180) @ truth_of(simulation)]
            for k in (0, 1, 3):
                found = judged(pair_of(simulation), *wrong[:k], truth_of(simulation), *wrong[k:])
                assert found.verdict is Verdict.ACCEPTED
                assert found.transform is not None
                assert simulation.error(found.transform) < 0.3

    def test_the_transform_is_the_candidates_own(self) -> None:
        """The judge decides; it does not fit again."""
        simulation = scenes.ordinary()
        candidate = settled(pair_of(simulation), truth_of(simulation))
        found = Judge().judge(pair_of(simulation), [candidate], CONTEXT, MAX_FAILURE)
        assert found.transform is candidate.transform

    def test_matches_are_one_to_one_and_hold_ids(self) -> None:
        pair = scenes.shuffled(pair_of(scenes.ordinary()))
        found = judged(pair, truth_of(scenes.ordinary()))
        assert found.transform is not None
        pairs = found.matches.pairs
        assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs) > 450
        ends = pair.reference.xy[pair.reference.positions(pairs[:, 0])]
        starts = found.transform(pair.source.xy[pair.source.positions(pairs[:, 1])])
        assert found.matches.residual == pytest.approx(np.hypot(*(ends - starts).T))
        assert len(found.before.pairs) < len(pairs) / 2

    @pytest.mark.parametrize("seed", range(4))
    def test_an_ordinary_survey_against_itself_is_the_identity(self, seed: int) -> None:
        survey = (scenes.ordinary(seed) if seed % 2 else simulate_family("small_150", seed)).reference
        found = judged(Pair(survey, survey), IDENTITY)
        assert found.verdict is Verdict.ACCEPTED
        assert found.transform is not None
        assert found.transform.matrix == pytest.approx(np.eye(3), abs=1e-9)
        assert found.matches.pairs.tolist() == [[i, i] for i in range(len(survey))]
        assert found.matches.residual_rms == pytest.approx(0, abs=1e-9)

    def test_planting_errors_alone_suffice_for_that(self) -> None:
        survey = alike(grid(20, 30) + np.random.default_rng(0).normal(0, 0.2, (600, 2)))
        assert judged(Pair(survey, survey), IDENTITY).verdict is Verdict.ACCEPTED

    def test_gaps_alone_suffice_for_that(self) -> None:
        survey = alike(grid(30, 40)[np.random.default_rng(0).random(1200) > 0.07])
        assert judged(Pair(survey, survey), IDENTITY).verdict is Verdict.ACCEPTED

    def test_a_stricter_limit_makes_it_ambiguous(self) -> None:
        simulation = simulate_family("small_60", 2)
        candidates = [settled(pair_of(simulation), truth_of(simulation))]
        free = Judge().judge(pair_of(simulation), candidates, CONTEXT, 1.0)
        assert free.verdict is Verdict.ACCEPTED
        strict = Judge().judge(pair_of(simulation), candidates, CONTEXT, free.failure_probability / 2)
        assert strict.verdict is not Verdict.ACCEPTED
        just = Judge().judge(pair_of(simulation), candidates, CONTEXT, free.failure_probability)
        assert just.verdict is Verdict.ACCEPTED


class TestWrong:
    """Here the truth is not among the candidates."""

    @pytest.mark.parametrize("family", ["shift_15", "noisy", "rectangle_05", "silent_areas", "small_150", "overlap_25"])
    @pytest.mark.parametrize("cell", [(1, 0), (0, 1), (-2, 1)])
    def test_a_cell_over_is_never_accepted(self, family: str, cell: tuple[int, int]) -> None:
        simulation = simulate_family(family, 80)
        assert judged(pair_of(simulation), off_by(simulation, *cell)).verdict is not Verdict.ACCEPTED

    def test_nor_are_partners_that_lie_no_nearer_than_by_chance(self) -> None:
        simulation = simulate_family("different", 5000196)
        found = execute(
            plan_for(Options(threads=1), installed()), (simulation.reference, simulation.source), Clock()
        ).judgement
        assert_failed(found)

    def test_nor_is_a_placement_of_a_part_of_a_bent_map(self) -> None:
        simulation = simulate_family("distortion_2", 2000149)
        found = judged(pair_of(simulation), truth_of(simulation) @ Rigid.turn(-0.3623, shift=(0.2678, 0.7845)))
        assert found.verdict is Verdict.AMBIGUOUS
        assert "bent" in found.reason

    @pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
    def test_nor_is_a_half_turn_or_a_shift_to_nowhere(self, name: str) -> None:
        simulation = scenes.scene(name, 4)
        centre = simulation.reference.xy.mean(axis=0)
        half_turn = Rigid.turn(180, about=centre) @ truth_of(simulation)
        step, row = lattice_steps(simulation)
        for wrong in (half_turn, Rigid(np.eye(2), step + row) @ half_turn, shifted_by(1.4, 2.3) @ truth_of(simulation)):
            assert judged(pair_of(simulation), wrong).verdict is not Verdict.ACCEPTED

    @pytest.mark.parametrize("seed", range(4))
    def test_different_orchards_are_never_accepted(self, seed: int) -> None:
        for simulation in (scenes.scene("different orchards", seed), simulate_family("different", seed)):
            pair = pair_of(simulation)
            assert judged(pair, *guesses(pair)).verdict is not Verdict.ACCEPTED

    @pytest.mark.parametrize("seed", range(3))
    def test_two_parts_of_one_orchard_that_do_not_meet_are_never_accepted(self, seed: int) -> None:
        simulation = simulate(Scene(trees=1000, rotation="any"), seed)
        axis = np.array([math.cos(seed), math.sin(seed)])
        here = simulation.reference.xy @ axis
        there = truth_of(simulation)(simulation.source.xy) @ axis
        middle = float(np.median(here))
        other_survey = Pair(simulation.reference.take(here < middle - 1), simulation.source.take(there > middle + 1))
        same_survey = Pair(simulation.reference.take(here < middle), simulation.reference.take(here >= middle))
        for pair in (other_survey, same_survey):
            assert judged(pair, *guesses(pair)).verdict is not Verdict.ACCEPTED


class TestNothingToSay:
    def test_without_candidates_it_has_failed(self) -> None:
        pair = pair_of(scenes.ordinary())
        found = Judge().judge(pair, [], CONTEXT, MAX_FAILURE)
        assert_failed(found)
        assert len(found.before.pairs) > 0, "the files' own georeference is measured all the same"

    @pytest.mark.parametrize("name", scenes.degenerate())
    def test_too_few_trees_and_trees_at_one_point_have_failed(self, name: str) -> None:
        pair = scenes.degenerate()[name]
        nothing = Registration(IDENTITY, np.zeros((0, 2), np.int64), np.zeros(0))
        for candidates in ([], [nothing]):
            found = Judge().judge(pair, candidates, CONTEXT, MAX_FAILURE)
            assert_failed(found)
            assert "too few" in found.reason

    @pytest.mark.parametrize("count", [3, 4, 6])
    def test_a_handful_of_trees_is_never_accepted(self, count: int) -> None:
        few = scenes.ordinary().reference.take(np.arange(count))
        assert judged(Pair(few, few), IDENTITY).verdict is not Verdict.ACCEPTED

    def test_a_placement_where_nothing_meets_has_failed(self) -> None:
        pair = pair_of(scenes.ordinary())
        nowhere = Registration(shifted_by(1e5, 0), np.array([[0, 0], [1, 1], [2, 2]]), np.ones(3))
        assert_failed(Judge().judge(pair, [nowhere], CONTEXT, MAX_FAILURE))

    def test_a_line_of_trees_is_never_accepted(self) -> None:
        assert judged(scenes.line(), IDENTITY).verdict is not Verdict.ACCEPTED


class TestGeoreference:
    def test_it_sharpens_what_is_right_and_near(self) -> None:
        accepted = {None: 0, 2.0: 0}
        for seed in range(10):
            small = Scene(trees=60, shift_sd=0.8, rotation_sd=0.5)
            simulation = simulate(small, seed)
            pair, near = pair_of(simulation), truth_of(simulation)
            without = judged(pair, near)
            known = judged(pair, near, context=Context(georeference_sd=2.0))
            assert known.failure_probability <= without.failure_probability
            accepted[None] += without.verdict is Verdict.ACCEPTED
            accepted[2.0] += known.verdict is Verdict.ACCEPTED
        assert accepted[2.0] > accepted[None]

    def test_it_tells_against_a_half_turn_that_nothing_else_tells_from_the_truth(self) -> None:
        xy, area = half_turn_symmetric(0.2)
        survey = FeatureSet.of(xy, area=area)
        pair = Pair(survey, moved(survey, shifted_by(1.0, -0.5)))
        near = shifted_by(-1.0, 0.5)
        known = Context(georeference_sd=2.0)
        either = judged(pair, near).failure_probability
        assert judged(pair, near, context=known).failure_probability < either / 20
        assert judged(pair, Rigid.turn(180) @ near, context=known).failure_probability > 0.99

    @pytest.mark.parametrize("sd", [0.5, 3.0, 20.0])
    def test_it_never_makes_a_wrong_one_accepted(self, sd: float) -> None:
        """Not even where the georeference itself is off by a tree or a row, and claims not to be."""
        known = Context(georeference_sd=sd)
        for scene in (Scene(trees=500, area_persistence=0.0), Scene(trees=150), Scene(trees=500, outline="rectangle")):
            simulation = simulate(scene, 90)
            for cell in ((1, 0), (0, 1)):
                wrong = off_by(simulation, *cell)
                there = Pair(simulation.reference, moved(simulation.source, wrong))
                assert judged(there, IDENTITY, context=known).verdict is not Verdict.ACCEPTED
                assert judged(pair_of(simulation), wrong, context=known).verdict is not Verdict.ACCEPTED

    def test_it_does_not_decide_between_different_orchards(self) -> None:
        for seed in range(2):
            pair = pair_of(scenes.scene("different orchards", seed))
            for sd in (1.0, 10.0):
                found = judged(pair, IDENTITY, *guesses(pair, 3), context=Context(georeference_sd=sd))
                assert found.verdict is not Verdict.ACCEPTED


class TestRivals:
    @pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap", "few trees"])
    def test_they_are_sorted_finite_and_other_placements(self, name: str) -> None:
        simulation = scenes.scene(name, 1)
        found = judged(pair_of(simulation), truth_of(simulation))
        odds = [rival.log_odds for rival in found.rivals]
        assert len(odds) > 0
        assert np.isfinite(odds).all()
        assert odds == sorted(odds, reverse=True)
        assert max(odds) < 0, "less probable than the one chosen"
        for rival in found.rivals:
            assert simulation.error(rival.transform) > 0.45 * simulation.reference.spacing

    @pytest.mark.parametrize("count", [0, 2, 5])
    def test_their_number_is_a_setting(self, count: int) -> None:
        simulation = scenes.ordinary()
        candidates = [settled(pair_of(simulation), truth_of(simulation))]
        few = Judge(rivals=count).judge(pair_of(simulation), candidates, CONTEXT, MAX_FAILURE)
        all_of_them = Judge(rivals=8).judge(pair_of(simulation), candidates, CONTEXT, MAX_FAILURE)
        assert len(few.rivals) == count
        assert few.rivals == all_of_them.rivals[:count]
        assert few.failure_probability == all_of_them.failure_probability

    def test_on_a_lattice_they_are_as_good(self) -> None:
        survey = alike(grid(26, 40))
        found = judged(Pair(survey, survey), IDENTITY)
        assert [rival.log_odds for rival in found.rivals] == pytest.approx([0] * 5, abs=1e-6)


class TestInvariance:
    @pytest.mark.parametrize("name", ["ordinary", "noisy", "few trees"])
    def test_threads_are_of_no_account(self, name: str) -> None:
        simulation = scenes.scene(name)
        candidate = settled(pair_of(simulation), truth_of(simulation))
        one, two = (Judge().judge(pair_of(simulation), [candidate], Context(threads=n), MAX_FAILURE) for n in (1, 2))
        assert one.failure_probability == two.failure_probability
        assert one.rivals == two.rivals
        assert one.expected_error == two.expected_error
        assert np.array_equal(one.matches.pairs, two.matches.pairs)

    @pytest.mark.parametrize("name", ["ordinary", "half overlap"])
    @pytest.mark.parametrize(
        ("reference_moves", "source_moves"),
        [
            (IDENTITY, IDENTITY),
            (shifted_by(1e4, -1e4), shifted_by(1e4, -1e4)),
            (IDENTITY, shifted_by(-1e4, 3e4)),
            (IDENTITY, Rigid.turn(77.0, shift=(5.0, 6.0))),
            (Rigid.turn(-31.0), Rigid.turn(180.0)),
        ],
        ids=["as it is", "far off", "source far off", "source turned", "both turned"],
    )
    def test_frames_and_the_order_of_trees_are_of_no_account(
        self, name: str, reference_moves: Rigid, source_moves: Rigid
    ) -> None:
        simulation = scenes.scene(name, 2)
        pair, truth = pair_of(simulation), truth_of(simulation)
        mixed = scenes.shuffled(pair)
        there = Pair(moved(mixed.reference, reference_moves), moved(mixed.source, source_moves))
        ours = judged(pair, truth)
        theirs = judged(there, reference_moves @ truth @ source_moves.inverse())
        assert ours.verdict is theirs.verdict is Verdict.ACCEPTED
        assert {tuple(p) for p in theirs.matches.pairs} == {tuple(p) for p in ours.matches.pairs}
        assert ours.transform is not None
        assert theirs.transform is not None
        back = reference_moves.inverse() @ theirs.transform @ source_moves
        assert back(pair.source.xy) == pytest.approx(ours.transform(pair.source.xy), abs=1e-4)
        assert ours.expected_error is not None
        assert theirs.expected_error is not None
        assert theirs.expected_error.rms == pytest.approx(ours.expected_error.rms, rel=1e-3)
