"""The judge on orchards that nobody can place: lattices, rows that repeat, blocks that a half turn leaves the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.core.orchards import IDENTITY, alike, grid, half_turn_symmetric, judged, shifted_by
from treereg_core.api import execute
from treereg_core.features import FeatureSet
from treereg_core.judgement import Verdict
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import installed
from treereg_core.simulate import Scene, simulate
from treereg_core.testing.scenes import moved
from treereg_core.transform import FloatArray, Rigid


def hexagons(rows: int, columns: int) -> FloatArray:
    """Trees 4 m apart in six directions."""
    xy = grid(rows, columns, 4 * math.sqrt(0.75), 4.0)
    xy[np.repeat(np.arange(rows), columns) % 2 == 1, 0] += 2.0
    return xy


LATTICES: dict[str, FloatArray] = {
    "oblong": grid(20, 32),
    "square": grid(24, 24, 4.0, 4.0),
    "hexagonal": hexagons(26, 26),
}


def crop(xy: FloatArray, low: tuple[float, float], high: tuple[float, float]) -> FloatArray:
    return xy[((xy >= low) & (xy <= high)).all(axis=1)]


@pytest.mark.parametrize("lattice", LATTICES)
class TestPeriodic:
    """Exact lattices: many placements explain them equally well, and their outlines are no evidence."""

    def test_with_itself(self, lattice: str) -> None:
        survey = alike(LATTICES[lattice])
        assert judged(Pair(survey, survey), IDENTITY).verdict is Verdict.AMBIGUOUS

    @pytest.mark.parametrize("turn_deg", [0.0, 33.0])
    def test_with_itself_turned(self, lattice: str, turn_deg: float) -> None:
        survey = alike(LATTICES[lattice])
        motion = Rigid.turn(turn_deg, shift=(12.0, -7.0))
        pair = Pair(survey, moved(survey, motion.inverse()))
        assert judged(pair, motion).verdict is Verdict.AMBIGUOUS

    @pytest.mark.parametrize("turn_deg", [0.0, 33.0])
    @pytest.mark.parametrize("window", [((10.0, 10.0), (50.0, 50.0)), ((24.0, 20.0), (200.0, 200.0))])
    def test_differing_crops(
        self, lattice: str, turn_deg: float, window: tuple[tuple[float, float], tuple[float, float]]
    ) -> None:
        whole = LATTICES[lattice]
        motion = Rigid.turn(turn_deg, shift=(2.0, 9.0))
        reference = alike(crop(whole, (0.0, 0.0), (70.0, 66.0)))
        source = moved(alike(crop(whole, *window)), motion.inverse())
        for placement in (motion, shifted_by(*(whole[1] - whole[0])) @ motion):
            assert judged(Pair(reference, source), placement).verdict is Verdict.AMBIGUOUS

    def test_outlines_of_any_shape(self, lattice: str) -> None:
        whole = LATTICES[lattice]
        middle = whole.mean(axis=0)
        disc = alike(whole[np.hypot(*(whole - middle).T) < 36.0])
        triangle = alike(whole[whole.sum(axis=1) < 110.0])
        for pair in (Pair(disc, disc), Pair(triangle, triangle), Pair(disc, triangle)):
            assert judged(pair, IDENTITY).verdict is Verdict.AMBIGUOUS


class TestLongPeriods:
    """Rows that differ, but repeat: nearer placements are wrong, and further ones as good as the truth."""

    @pytest.mark.parametrize("period", [3, 5, 15])
    @pytest.mark.parametrize("axis", ["rows", "columns"])
    @pytest.mark.parametrize("noise", [0.0, 0.2])
    def test_crops_are_never_accepted(self, period: int, axis: str, noise: float) -> None:
        xy = grid(36, 50)
        number = np.round(xy[:, 1] / 5.5) if axis == "rows" else np.round(xy[:, 0] / 3.0)
        step = np.array([0, 5.5 * period]) if axis == "rows" else np.array([3.0 * period, 0])
        rng = np.random.default_rng(period)

        def survey(low: tuple[float, float], high: tuple[float, float]) -> FeatureSet:
            area = np.where(number % period == 0, 10.0, 5.0) * np.exp(noise * rng.normal(size=len(xy)))
            return FeatureSet.of(xy, area=area).take(((xy >= low) & (xy <= high)).all(axis=1))

        pair = Pair(survey((0.0, 0.0), (100.0, 140.0)), survey((20.0, 30.0), (150.0, 200.0)))
        for k in (0, 1, -1):
            assert judged(pair, Rigid(np.eye(2), k * step)).verdict is not Verdict.ACCEPTED, f"{k} periods off"


class TestSymmetric:
    @pytest.mark.parametrize("planting_error_m", [0.0, 0.2])
    @pytest.mark.parametrize("motion", [IDENTITY, Rigid.turn(50, shift=(3.0, 4.0))])
    def test_what_a_half_turn_leaves_the_same_is_ambiguous(self, planting_error_m: float, motion: Rigid) -> None:
        xy, area = half_turn_symmetric(planting_error_m)
        survey = FeatureSet.of(xy, area=area)
        found = judged(Pair(survey, moved(survey, motion.inverse())), motion)
        assert found.verdict is Verdict.AMBIGUOUS
        first = found.rivals[0].transform
        assert abs(first.rotation_deg - motion.rotation_deg) % 360 == pytest.approx(180, abs=0.01)

    @pytest.mark.parametrize("seed", range(3))
    def test_so_it_is_with_the_noise_of_two_surveys(self, seed: int) -> None:
        xy, area = half_turn_symmetric(0.1)
        rng = np.random.default_rng(seed)

        def survey() -> FeatureSet:
            found = rng.random(len(xy)) > 0.05
            measured = area * rng.lognormal(0, 0.1, len(xy))
            return FeatureSet.of((xy + rng.normal(0, 0.15, xy.shape))[found], area=measured[found])

        pair = Pair(survey(), survey())
        for placement in (IDENTITY, Rigid.turn(180)):
            assert judged(pair, placement).verdict is Verdict.AMBIGUOUS

    def test_one_half_that_differs_decides_it(self) -> None:
        xy, area = half_turn_symmetric(0.2)
        different = np.concatenate(
            [area[: len(area) // 2], np.random.default_rng(0).permutation(area[len(area) // 2 :])]
        )
        survey = FeatureSet.of(xy, area=different)
        assert judged(Pair(survey, survey), IDENTITY).verdict is Verdict.ACCEPTED


def test_rounding_of_equal_crowns_is_no_evidence_wherever_it_falls() -> None:
    """Equal crowns that straddle a step of one per cent would seem to differ, and to agree from survey to survey."""
    xy = grid(20, 25)
    noise = np.random.default_rng(0).normal(0, 1e-5, len(xy))
    trees = FeatureSet.of(xy, area=np.exp(1.745 + noise))
    assert judged(Pair(trees, trees), IDENTITY).verdict is Verdict.AMBIGUOUS


@pytest.mark.parametrize("georeference_sd", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("seed", [0, 2, 6])
def test_a_georeference_does_not_make_a_far_position_on_a_lattice_right(seed: int, georeference_sd: float) -> None:
    """Crowns all alike but for a few that were cut in two, which meet somewhere; files that are 1.1 m off."""
    scene = Scene(trees=600, periodic=True, overlap=0.8, rotation=0.0, shift=(1.0, 0.5))
    simulation = simulate(scene, seed)
    options = Options(method="icp", georeference_sd=georeference_sd, threads=1)
    said = execute(plan_for(options, installed()), (simulation.reference, simulation.source), Clock()).judgement
    if said.verdict is Verdict.ACCEPTED:
        assert said.transform is not None
        assert np.hypot(*(said.transform.shift + scene.shift)) < scene.spacing / 2
