"""Rotations between two surveys, found before any shift is known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.orchards import alike, grid, truth_of
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.rotation import BINS, RADIUS, RINGS, rotations, vector_rose
from treereg_core.simulate import Scene, simulate, simulate_family
from treereg_core.testing.scenes import moved
from treereg_core.transform import FloatArray, Rigid


def found(reference: FeatureSet, source: FeatureSet, count: int = 4) -> tuple[FloatArray, FloatArray]:
    return rotations(reference, source, reference.spacing, Context().rng("directions"), count)


def off(angles: FloatArray, truth_deg: float) -> FloatArray:
    """How far each angle is from the truth or its twin, degrees."""
    return np.abs((angles - truth_deg + 90) % 180 - 90)


@pytest.mark.parametrize(
    ("family", "tolerance_deg"),
    [("rotation_any", 0.1), ("noisy", 0.2), ("heavy_noise", 0.3), ("small_150", 0.6), ("curved", 1.0)],
)
@pytest.mark.parametrize("seed", range(3))
def test_the_first_is_the_true_one(family: str, tolerance_deg: float, seed: int) -> None:
    simulation = simulate_family(family, 300 + seed)
    angles, _ = found(simulation.reference, simulation.source)
    assert off(angles[:1], truth_of(simulation).rotation_deg)[0] < tolerance_deg


@pytest.mark.parametrize("turn_deg", [0.0, 0.1, 44.9, 90.0, 135.3, 179.95, -60.0])
def test_a_turned_copy(turn_deg: float) -> None:
    survey = simulate(Scene(trees=500), 0).reference
    angles, _ = found(survey, moved(survey, Rigid.turn(-turn_deg, shift=(300, -200))))
    assert off(angles[:1], turn_deg)[0] < 0.05


def test_a_rotation_stands_for_its_twin() -> None:
    """All angles lie within one half turn, and a source turned by a half turn gives the very same ones."""
    simulation = simulate(Scene(trees=500, rotation=200.0), 3)
    angles, fit = found(simulation.reference, simulation.source)
    turned, same = found(simulation.reference, moved(simulation.source, Rigid.turn(180)))
    assert ((angles > -0.5) & (angles < 180.5)).all()
    assert off(turned, 0) == pytest.approx(off(angles, 0), abs=1e-6)
    assert same == pytest.approx(fit)


def test_they_come_best_first_and_apart() -> None:
    simulation = simulate_family("square_any", 1)
    angles, fit = found(simulation.reference, simulation.source, 6)
    assert len(angles) == len(fit) <= 6
    assert (np.diff(fit) <= 0).all()
    for k, angle in enumerate(angles):
        assert (off(np.delete(angles, k), angle) > 1.5).all()


def test_a_square_lattice_may_be_turned_by_a_quarter() -> None:
    survey = alike(grid(20, 20, 4.0, 4.0))
    angles, fit = found(survey, moved(survey, Rigid.turn(20)))
    assert sorted(off(angles[:2], -20)) == pytest.approx([0, 90], abs=0.1)
    assert fit[1] == pytest.approx(fit[0], rel=0.05)


def test_a_hexagonal_lattice_may_be_turned_by_a_sixth() -> None:
    hexagons = grid(24, 24, 4 * np.sqrt(0.75), 4.0)
    hexagons[np.repeat(np.arange(24), 24) % 2 == 1, 0] += 2.0
    survey = alike(hexagons)
    angles, _ = found(survey, survey)
    assert sorted(off(angles[:3], 0)) == pytest.approx([0, 60, 60], abs=0.2)


def test_an_oblong_lattice_has_no_other_turn_that_suits() -> None:
    simulation = simulate(Scene(trees=800, outline="rectangle"), 0)
    _, fit = found(simulation.reference, simulation.source)
    assert fit[1] < 0.6 * fit[0]


def test_shift_and_order_are_of_no_account() -> None:
    simulation = simulate_family("rotation_any", 5)
    reference, source = simulation.reference, simulation.source
    angles, _ = found(reference, source)
    far, _ = found(moved(reference, Rigid(np.eye(2), (5e5, 6e6))), source)
    assert far == pytest.approx(angles, abs=1e-3)
    order = np.random.default_rng(0).permutation(len(source))
    mixed, _ = found(reference, source.take(order))
    assert off(mixed[:1], angles[0])[0] < 0.05


def test_the_rose_counts_every_pair_once() -> None:
    """Of a small survey, which is not sampled."""
    survey = simulate(Scene(trees=150), 0).reference
    distance = np.hypot(*(survey.xy[:, None] - survey.xy[None]).transpose(2, 0, 1)) / survey.spacing
    pairs = ((distance >= RINGS[0]) & (distance < RINGS[-1])).sum() / 2
    rose = vector_rose(survey, survey.spacing, np.random.default_rng(0))
    assert rose.shape == (len(RADIUS), BINS)
    assert rose.sum() == pytest.approx(pairs, abs=1)


def test_the_rose_of_a_lattice_points_along_its_rows_and_columns() -> None:
    rose = vector_rose(alike(grid(10, 10, 4.0, 4.0)), 4.0, np.random.default_rng(0))
    first = rose[np.argmin(np.abs(RADIUS - 1.0))]
    assert np.flatnonzero(first > 1).tolist() == [0, BINS // 2]


@pytest.mark.parametrize("xy", [np.zeros((5, 2)), grid(1, 3), np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 1e4]])])
def test_surveys_without_a_pattern_give_finite_answers(xy: FloatArray) -> None:
    survey = alike(xy)
    angles, fit = rotations(survey, survey, max(survey.spacing, 1.0), np.random.default_rng(0), 4)
    assert np.isfinite(angles).all()
    assert np.isfinite(fit).all()
