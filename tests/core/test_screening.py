"""Many placements refined and scored at once on a sample of the trees."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.orchards import lattice_steps, truth_of
from treereg_core.evidence import Evidence
from treereg_core.screening import screen
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.testing import scenes
from treereg_core.testing.scenes import moved
from treereg_core.transform import Affine, Rigid, Similarity


def nudged(simulation: Simulation, seed: int) -> Affine:
    """A placement about a quarter of the spacing off the truth."""
    return scenes.near(simulation, seed).reference_from_source


def cells(simulation: Simulation, start: Affine, reach: int = 2) -> tuple[Affine, ...]:
    """The start, first, and its neighbours on the planting lattice."""
    numbers = [(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1) if (i, j) != (0, 0)]
    steps = [np.zeros(2), *(np.array(n) @ lattice_steps(simulation) for n in numbers)]
    return tuple(Rigid(np.eye(2), step) @ start for step in steps)


def everything(simulation: Simulation) -> np.ndarray:
    return np.arange(len(simulation.source))


@pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
@pytest.mark.parametrize("seed", range(3))
def test_it_refines_to_the_truth(name: str, seed: int) -> None:
    simulation = scenes.scene(name, seed)
    evidence = Evidence(simulation.reference, simulation.source)
    start = nudged(simulation, seed)
    screened = screen(evidence, (start,), everything(simulation), rounds=4)
    assert simulation.error(start) > 0.2 * simulation.reference.spacing
    assert simulation.error(screened.transforms[0]) < 0.1 * simulation.reference.spacing


@pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
@pytest.mark.parametrize("share", [1, 3])
def test_the_truth_scores_best_among_its_neighbours(name: str, share: int) -> None:
    for seed in range(2):
        simulation = scenes.scene(name, seed)
        evidence = Evidence(simulation.reference, simulation.source)
        screened = screen(evidence, cells(simulation, nudged(simulation, seed)), everything(simulation)[::share])
        assert np.argmax(screened.score) == 0
        assert simulation.error(screened.transforms[0]) < 0.15 * simulation.reference.spacing


def test_each_is_refined_by_itself() -> None:
    """Which others are screened with it changes scores, never where a placement goes."""
    simulation = scenes.ordinary()
    evidence = Evidence(simulation.reference, simulation.source)
    starts = cells(simulation, nudged(simulation, 0), reach=1)
    together = screen(evidence, starts, everything(simulation)).transforms
    for start, there in zip(starts, together, strict=True):
        alone = screen(evidence, (start,), everything(simulation)).transforms[0]
        assert alone.matrix == pytest.approx(there.matrix, abs=1e-9)


def test_scores_are_finite_and_in_the_order_given() -> None:
    simulation = scenes.ordinary()
    evidence = Evidence(simulation.reference, simulation.source)
    starts = (*cells(simulation, truth_of(simulation)), Rigid(np.eye(2), (1e5, 0.0)), Rigid.turn(180), Rigid.turn(45))
    screened = screen(evidence, starts, everything(simulation))
    assert len(screened.transforms) == len(screened.score) == len(starts)
    assert np.isfinite(screened.score).all()
    backwards = screen(evidence, starts[::-1], everything(simulation))
    assert backwards.score[::-1] == pytest.approx(screened.score)


def test_where_nothing_meets_it_stays_and_scores_least() -> None:
    simulation = scenes.ordinary()
    evidence = Evidence(simulation.reference, simulation.source)
    far = Rigid(np.eye(2), (1e5, 0.0))
    screened = screen(evidence, (truth_of(simulation), far), everything(simulation))
    assert screened.transforms[1] == far
    assert screened.score[1] < screened.score[0]


def test_kinds_and_scales_are_kept() -> None:
    simulation = scenes.ordinary()
    evidence = Evidence(simulation.reference, simulation.source)
    wider = Similarity(truth_of(simulation).linear * 1.003, truth_of(simulation).shift)
    screened = screen(evidence, (wider, truth_of(simulation)), everything(simulation))
    assert [type(t) for t in screened.transforms] == [Similarity, Rigid]
    assert screened.transforms[0].scale == pytest.approx(1.003)


def test_without_rounds_nothing_moves() -> None:
    simulation = scenes.ordinary()
    evidence = Evidence(simulation.reference, simulation.source)
    start = nudged(simulation, 0)
    screened = screen(evidence, (start,), everything(simulation), rounds=0)
    assert screened.transforms[0].matrix == pytest.approx(start.matrix)


def test_the_place_of_the_surveys_is_of_no_account() -> None:
    simulation = simulate(Scene(trees=400), 1)
    starts = cells(simulation, nudged(simulation, 0))
    here = screen(Evidence(simulation.reference, simulation.source), starts, everything(simulation))
    far = Rigid(np.eye(2), (1e4, -1e4))
    moved_evidence = Evidence(moved(simulation.reference, far), moved(simulation.source, far))
    there = screen(moved_evidence, tuple(far @ s @ far.inverse() for s in starts), everything(simulation))
    assert there.score == pytest.approx(here.score, rel=1e-3, abs=0.5)
