"""The whole command on random orchards: what may not matter does not matter, and nothing wrong is accepted."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import numpy as np
import pytest
from earth import CERES, Drawn, Place, Ran, drawn, ran, rms
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from treereg_core.simulate import Scene, Simulation, simulate

MILLIMETRE = 0.001


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


def few(examples: int) -> settings:
    return settings(max_examples=examples, suppress_health_check=list(HealthCheck))


@dataclass(frozen=True)
class Case:
    """What makes a simulation: shorter to print than that."""

    scene: Scene
    seed: int

    def simulated(self) -> tuple[Simulation, tuple[Drawn, Drawn]]:
        simulation = simulate(self.scene, self.seed)
        return simulation, drawn(simulation)


SEEDS = st.integers(0, 2**16)
CLEAR = st.builds(
    Case,
    st.builds(
        Scene,
        trees=st.integers(200, 300),
        row_spacing=numbers(4, 7),
        spacing=numbers(2.5, 4),
        curve=st.sampled_from([0.0, 5.0]),
        planting_jitter=numbers(0.15, 0.3),
        area_persistence=numbers(0.7, 0.9),
        jitter=numbers(0.05, 0.15),
        rotation=st.just("any"),
        shift_sd=numbers(0, 20),
    ),
    SEEDS,
)
"""Orchards that nobody could mistake."""
ANY = st.builds(
    Case,
    st.builds(
        Scene,
        trees=st.integers(150, 300),
        row_spacing=numbers(4, 7),
        spacing=numbers(2.5, 5),
        curve=st.sampled_from([0.0, 5.0]),
        outline=st.sampled_from(["rectangle", "irregular"]),
        planting_jitter=numbers(0.05, 0.3),
        area_persistence=numbers(0, 0.9),
        missed=numbers(0, 0.2),
        false=numbers(0, 0.2),
        jitter=numbers(0.05, 0.3),
        overlap=numbers(0.6, 1),
        rotation=st.just("any"),
        shift_sd=numbers(0, 20),
        same_orchard=st.sampled_from([True, True, True, False]),
    ),
    SEEDS,
)
"""Orchards of which some are hard, and some are two."""
PLACES = st.builds(Place, numbers(-180, 180), numbers(-90, 90), numbers(-180, 180))


def require_honest(found: Ran, simulation: Simulation, place: Place = CERES) -> None:
    """What is accepted is right: as near as the laws ask for."""
    if found.accepted:
        assert simulation.truth is not None
        error = rms(found.moved(simulation.source.xy, place), simulation.truth(simulation.source.xy))
        assert error < max(0.5, 1.25 * simulation.error(simulation.true_fit()))


def apart(found: Ran, before: Ran, simulation: Simulation, place: Place = CERES) -> float:
    """How far from each other two runs put the source's trees, in the orchard's frame, metres."""
    return rms(found.moved(simulation.source.xy, place), before.moved(simulation.source.xy))


@few(6)
@given(case=CLEAR, place=PLACES)
def test_surveys_that_are_moved_together_are_placed_the_same(case: Case, place: Place) -> None:
    simulation, surveys = case.simulated()
    before, after = ran(surveys), ran(surveys, place)
    assert before.verdict == after.verdict == "accepted"
    assert apart(after, before, simulation, place) < MILLIMETRE


@few(10)
@given(case=ANY, place=PLACES)
def test_hard_surveys_anywhere_are_right_or_not_accepted(case: Case, place: Place) -> None:
    simulation, surveys = case.simulated()
    require_honest(ran(surveys, place), simulation, place)


@few(8)
@given(case=ANY, chance=st.randoms(use_true_random=False))
def test_the_order_of_features_and_corners_does_not_matter(case: Case, chance: Random) -> None:
    def mixed(survey: Drawn) -> Drawn:
        order = chance.sample(range(len(survey.rings)), len(survey.rings))
        rings = [np.roll(survey.rings[i], chance.randrange(20), axis=0)[:: chance.choice((1, -1))] for i in order]
        return Drawn(np.stack(rings), survey.confidence[order])

    simulation, surveys = case.simulated()
    before, after = ran(surveys), ran((mixed(surveys[0]), mixed(surveys[1])))
    require_honest(before, simulation)
    assert after.verdict == before.verdict
    if before.accepted:
        assert after.registration["matched"] == before.registration["matched"]
        assert apart(after, before, simulation) < MILLIMETRE


@few(6)
@given(case=CLEAR)
def test_swapped_surveys_are_placed_inversely_to_within_the_expected_error(case: Case) -> None:
    simulation, surveys = case.simulated()
    before, after = ran(surveys), ran(surveys[::-1])
    assert before.verdict == after.verdict == "accepted"
    there_and_back = after.moved(before.moved(simulation.source.xy))
    assert rms(there_and_back, simulation.source.xy) < before.registration["expected_error_m"]["rms"]


@few(8)
@given(case=ANY)
def test_hard_surveys_that_are_swapped_do_not_contradict_each_other(case: Case) -> None:
    simulation, surveys = case.simulated()
    before, after = ran(surveys), ran(surveys[::-1])
    require_honest(before, simulation)
    if before.accepted and after.accepted:
        there_and_back = after.moved(before.moved(simulation.source.xy))
        assert rms(there_and_back, simulation.source.xy) < before.registration["expected_error_m"]["ci95"][1]


def doubled(survey: Drawn, share: float, off_m: float, rng: np.random.Generator) -> Drawn:
    """A share of the trees twice, the second a little off."""
    again = np.flatnonzero(rng.random(len(survey.rings)) < share)
    rings = survey.rings[again] + rng.normal(0, off_m, (len(again), 1, 2))
    return Drawn(np.concatenate([survey.rings, rings]), np.append(survey.confidence, survey.confidence[again]))


@few(6)
@given(case=ANY, shares=st.sampled_from([(0.3, 0.0), (0.0, 1.0), (1.0, 0.5)]))
def test_trees_that_are_twice_in_a_file_count_once(case: Case, shares: tuple[float, float]) -> None:
    simulation, surveys = case.simulated()
    rng = np.random.default_rng(case.seed)
    twice = doubled(surveys[0], shares[0], 0.0, rng), doubled(surveys[1], shares[1], 0.0, rng)
    before, after = ran(surveys), ran(twice)
    assert "duplicate of another" in after.told
    assert after.registration["failure_probability"] == pytest.approx(before.registration["failure_probability"], 1e-3)
    assert after.verdict == before.verdict
    if before.accepted:
        assert apart(after, before, simulation) < MILLIMETRE


@example(case=Case(Scene(trees=150, planting_jitter=0.25, jitter=0.25), 0), shares=(0.5, 0.5), off_m=0.001)
@few(16)
@given(
    case=ANY,
    shares=st.sampled_from([(0.1, 0.0), (1.0, 0.0), (0.0, 0.5), (0.0, 1.0), (0.5, 0.5), (1.0, 1.0)]),
    off_m=st.sampled_from([1e-7, 0.001, 0.05, 0.3, 1.0]),
)
def test_trees_that_were_found_twice_make_nothing_wrong(case: Case, shares: tuple[float, float], off_m: float) -> None:
    simulation, (first, second) = case.simulated()
    rng = np.random.default_rng(case.seed)
    require_honest(ran((doubled(first, shares[0], off_m, rng), doubled(second, shares[1], off_m, rng))), simulation)
