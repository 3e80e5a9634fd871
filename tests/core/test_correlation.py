"""Every shift at once: the true one is among the peaks, and those say how many trees meet."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.orchards import alike, grid, off_by, truth_of
from treereg_core.correlation import FINE, ROUGH, Correlator, Grid, Peaks
from treereg_core.evidence import Evidence
from treereg_core.simulate import Scene, Simulation, simulate, simulate_family
from treereg_core.testing import scenes
from treereg_core.testing.scenes import moved
from treereg_core.transform import Affine, FloatArray, Rigid, Similarity


def correlator(simulation: Simulation, grid: Grid = ROUGH, threads: int = 1) -> Correlator:
    return Correlator(Evidence(simulation.reference, simulation.source, threads), grid)


def away(peaks: Peaks, from_: Affine) -> FloatArray:
    """How far the peaks are from a placement of the same linear part, metres."""
    return np.asarray(np.hypot(*(peaks.shift - from_.shift).T))


@pytest.mark.parametrize("grid_", [ROUGH, FINE], ids=["rough", "fine"])
@pytest.mark.parametrize("family", ["shift_15", "rotation_any", "noisy", "overlap_50", "small_150", "bare_rectangle"])
def test_the_true_shift_is_among_the_foremost(family: str, grid_: Grid) -> None:
    simulation = simulate_family(family, 40)
    truth = truth_of(simulation)
    peaks, _ = correlator(simulation, grid_).at(Rigid(truth.linear, (0, 0)))
    foremost = peaks.foremost(12)
    assert away(peaks, truth)[foremost].min() < simulation.reference.spacing / 4


@pytest.mark.parametrize("family", ["rotation_any", "overlap_50"])
def test_so_it_is_for_the_half_turn(family: str) -> None:
    simulation = simulate_family(family, 41)
    truth = truth_of(simulation)
    _, peaks = correlator(simulation).at(Rigid(-truth.linear, (0, 0)))
    assert peaks.transform(0).linear == pytest.approx(truth.linear)
    assert away(peaks, truth)[peaks.foremost(12)].min() < simulation.reference.spacing / 4


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1e4, -3e4), (-70.3, 55.1)])
@pytest.mark.parametrize("turn_deg", [0.0, 30.0])
def test_far_shifts_of_an_exact_copy(shift: tuple[float, float], turn_deg: float) -> None:
    survey = scenes.ordinary().reference
    truth = Rigid.turn(turn_deg, shift=shift)
    evidence = Evidence(survey, moved(survey, truth.inverse()))
    peaks, _ = Correlator(evidence).at(Rigid.turn(turn_deg))
    assert away(peaks, truth)[0] < survey.spacing / 8
    assert 0.5 * len(survey) < peaks.met[0] < 1.1 * len(survey), "drawing on a grid loses some"
    assert peaks.met[0] == peaks.met.max()


def test_the_first_peak_is_the_true_one_where_crowns_tell() -> None:
    for seed in range(4):
        simulation = scenes.ordinary(seed)
        truth = truth_of(simulation)
        peaks, turned = correlator(simulation).at(truth)
        assert away(peaks, truth)[0] < simulation.reference.spacing / 4
        assert peaks.score[0] > 2 * turned.score[0]


def test_crowns_that_agree_raise_the_true_peak() -> None:
    for seed in range(2):
        simulation = simulate(Scene(trees=600, outline="rectangle", gaps=0.02, area_persistence=0.8), seed)
        truth = truth_of(simulation)
        equal = [f.replace(area=np.full(len(f), 5.0)) for f in (simulation.reference, simulation.source)]
        with_crowns, _ = correlator(simulation).at(truth)
        without, _ = Correlator(Evidence(equal[0], equal[1])).at(truth)
        assert away(with_crowns, truth)[0] < simulation.reference.spacing / 4
        lead = [float(peaks.score[0] - peaks.score[1]) for peaks in (with_crowns, without)]
        assert lead[0] > 2 * abs(lead[1])


def test_the_neighbouring_cells_are_peaks_too() -> None:
    simulation = simulate(Scene(trees=600, rotation=25.0), 2)
    peaks, _ = correlator(simulation).at(truth_of(simulation))
    for cell in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (2, 0)):
        assert away(peaks, off_by(simulation, *cell)).min() < simulation.reference.spacing / 4, f"cell {cell}"


def test_peaks_come_best_first_and_are_finite() -> None:
    for peaks in correlator(scenes.scene("noisy")).at(Rigid.identity()):
        assert len(peaks) == len(peaks.shift) == len(peaks.met) == len(peaks.score) > 10
        assert (np.diff(peaks.score) <= 0).all()
        assert np.isfinite(peaks.shift).all()
        assert np.isfinite(peaks.score).all()
        assert (peaks.met > 0).all()


def test_the_foremost_are_the_best_and_those_where_most_trees_meet() -> None:
    peaks, _ = correlator(scenes.ordinary()).at(Rigid.identity())
    foremost = set(peaks.foremost(5).tolist())
    assert {0, 1, 2, 3, 4} <= foremost
    assert set(np.argsort(-peaks.met)[:5].tolist()) <= foremost
    assert len(peaks.foremost(10**6)) == len(peaks)


def test_placements_are_of_the_templates_kind() -> None:
    template = Similarity(np.eye(2) * 1.01, (0, 0))
    for peaks in correlator(scenes.ordinary()).at(template):
        assert type(peaks.transform(0)) is Similarity
        assert peaks.transform(0).scale == pytest.approx(1.01)


def test_the_shift_of_the_template_is_of_no_account() -> None:
    simulation = scenes.ordinary()
    truth = truth_of(simulation)
    for ours, theirs in zip(
        correlator(simulation).at(truth), correlator(simulation).at(Rigid(truth.linear, (0, 0))), strict=True
    ):
        assert np.array_equal(ours.shift, theirs.shift)
        assert np.array_equal(ours.score, theirs.score)


def test_threads_are_of_no_account() -> None:
    simulation = scenes.ordinary()
    for ours, theirs in zip(
        correlator(simulation).at(Rigid.identity()), correlator(simulation, threads=2).at(Rigid.identity()), strict=True
    ):
        assert np.array_equal(ours.shift, theirs.shift)
        assert np.array_equal(ours.met, theirs.met)


def test_a_shift_of_both_surveys_is_of_no_account() -> None:
    simulation = scenes.ordinary()
    far = Rigid(np.eye(2), (1e4, -2e4))
    evidence = Evidence(moved(simulation.reference, far), moved(simulation.source, far))
    truth = truth_of(simulation)
    peaks, _ = Correlator(evidence).at(truth)
    assert away(peaks, far @ truth @ far.inverse())[0] < simulation.reference.spacing / 4


def test_no_cell_of_an_exact_lattice_stands_out() -> None:
    lattice, orchard = alike(grid(30, 30, 4.0, 4.0)), scenes.ordinary().reference
    clear = Correlator(Evidence(orchard, orchard)).at(Rigid.identity())[0].score
    for peaks in Correlator(Evidence(lattice, lattice)).at(Rigid.identity()):
        cells = peaks.shift[:20] / 4.0
        assert np.abs(cells - np.round(cells)).max() < 0.25
        assert peaks.score[0] - peaks.score[1] < 0.1 * (clear[0] - clear[1])


def test_surveys_that_hardly_touch_are_not_proposed() -> None:
    simulation = scenes.ordinary()
    reference, source = simulation.reference, simulation.source
    evidence = Evidence(reference, source)
    for peaks in Correlator(evidence).at(Rigid.identity()):
        for k in range(0, len(peaks), 10):
            match = evidence.match(peaks.transform(k))
            assert match.covered_reference.sum() + match.covered_source.sum() > 0.02 * len(source)
