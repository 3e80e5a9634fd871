"""The evaluators of the core by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.methods import orchard
from treereg_core.evaluator import Problem
from treereg_core.evaluators import Checkpoints, Pixels, Residuals, Truth
from treereg_core.image import Image
from treereg_core.judgement import Judgement, Matches, Verdict
from treereg_core.transform import Affine, FloatArray, Rigid

NONE = Matches(np.empty((0, 2)), np.empty(0))
PIXEL_M = 0.5


def judged(transform: Affine | None, matches: Matches = NONE) -> Judgement:
    return Judgement(Verdict.AMBIGUOUS, "for a test", transform, matches, NONE, None, 0.5, ())


@pytest.mark.parametrize(
    ("shift", "placed", "milestone"), [((0.3, 0.4), 1.0, 0.95), ((0.0, 3.0), 0.0, 0.0)], ids=["near", "a tree over"]
)
def test_a_shift_is_its_own_error(shift: tuple[float, float], placed: float, milestone: float) -> None:
    trees = orchard()
    truth = Rigid.turn(10)
    found = Rigid.turn(0, shift=shift) @ truth
    figures = Truth().score(judged(found), Problem(trees, trees, truth))
    assert figures["error_m"] == pytest.approx(np.hypot(*shift))
    assert figures["translation_error_m"] == pytest.approx(np.hypot(*shift))
    assert figures["rotation_error_deg"] == pytest.approx(0, abs=1e-9)
    assert (figures["placed"], figures["milestone"]) == (placed, milestone)


def test_a_turn_is_measured_over_the_trees() -> None:
    trees = orchard()
    figures = Truth().score(judged(Rigid.turn(1, about=(0, 0))), Problem(trees, trees, Rigid.identity()))
    chord = 2 * np.sin(np.radians(1) / 2)
    assert figures["error_m"] == pytest.approx(chord * np.sqrt((trees.xy**2).sum(axis=1).mean()))


@pytest.mark.parametrize(("found", "truth", "apart"), [(179.5, -179.5, 1.0), (-30.0, 30.0, 60.0), (0.25, 0.0, 0.25)])
def test_turns_are_compared_the_short_way_round(found: float, truth: float, apart: float) -> None:
    trees = orchard()
    figures = Truth().score(judged(Rigid.turn(found)), Problem(trees, trees, Rigid.turn(truth)))
    assert figures["rotation_error_deg"] == pytest.approx(apart)


def test_the_milestone_is_the_highest_that_is_reached() -> None:
    trees = orchard()
    # turned about one end, the near trees stay within half a spacing of where they belong and the far ones do not
    far = np.hypot(*(trees.xy - trees.xy[0]).T)
    turn = np.degrees(trees.spacing / 2 / np.quantile(far, 0.85))
    figures = Truth().score(judged(Rigid.turn(turn, about=trees.xy[0])), Problem(trees, trees, Rigid.identity()))
    assert figures["placed"] == pytest.approx(0.85, abs=0.02)
    assert figures["milestone"] == 0.80


def test_without_a_truth_or_a_placement() -> None:
    trees = orchard()
    unknown = Truth().score(judged(Rigid.identity()), Problem(trees, trees))
    assert set(unknown.values()) == {None}
    failed = Truth().score(judged(None), Problem(trees, trees, Rigid.identity()))
    assert (failed["placed"], failed["milestone"], failed["error_m"]) == (0.0, 0.0, None)
    assert failed.keys() == unknown.keys()


def test_residuals_are_those_of_the_judges_pairs() -> None:
    trees = orchard(rows=1, trees=10)
    matches = Matches(np.column_stack([np.arange(5)] * 2), [0.1, 0.2, 0.3, 0.4, 1.0])
    figures = Residuals().score(judged(Rigid.identity(), matches), Problem(trees, trees))
    assert figures["rms_m"] == pytest.approx(np.sqrt(1.3 / 5))
    assert figures["median_m"] == pytest.approx(0.3)
    assert figures["matched"] == 0.5
    nothing = Residuals().score(judged(None), Problem(trees, trees))
    assert nothing["rms_m"] is None
    assert nothing["matched"] == 0.0


def picture(height: int = 80, width: int = 100, seed: int = 0) -> FloatArray:
    """A smooth random picture in 0 to 1."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(height, width)), 3)
    return np.asarray((noise - noise.min()) / np.ptp(noise))


def north_up(left: float, top: float) -> Affine:
    """Pixels of half a metre, the first one's centre at this place."""
    return Affine([[PIXEL_M, 0], [0, -PIXEL_M]], [left, top])


def test_pictures_that_lie_rightly_on_each_other_are_equal() -> None:
    grey = picture()
    misplaced = Rigid.turn(7, about=(20, 20), shift=(3, -2))
    images = Image(grey, north_up(0, 40)), Image(grey, misplaced @ north_up(0, 40))
    trees = orchard()
    figures = Pixels().score(judged(misplaced.inverse()), Problem(trees, trees, None, images))
    assert figures["mse"] == pytest.approx(0, abs=1e-6)
    assert figures["ncc"] == pytest.approx(1, abs=1e-4)
    assert figures["mse_before"] is not None
    assert figures["mse_before"] > 100 * 1e-6
    assert figures["ncc_before"] is not None
    assert figures["ncc_before"] < 0.9


def test_light_costs_squares_but_no_correlation() -> None:
    grey = picture()
    images = Image(grey, north_up(0, 40)), Image(0.5 * grey + 0.2, north_up(0, 40))
    figures = Pixels().score(judged(Rigid.identity()), Problem(orchard(), orchard(), None, images))
    assert figures["ncc"] == pytest.approx(1)
    assert figures["mse"] == pytest.approx(np.mean((0.5 * grey - 0.2) ** 2), rel=1e-4)


def test_only_what_both_show_is_compared() -> None:
    grey = picture()
    holed = grey.copy()
    holed[:40] = np.nan
    images = Image(holed, north_up(0, 40)), Image(grey, north_up(0, 40))
    figures = Pixels().score(judged(Rigid.identity()), Problem(orchard(), orchard(), None, images))
    assert figures["mse"] == pytest.approx(0, abs=1e-9)
    far = images[0], images[1].moved(Rigid.turn(0, shift=(500, 0)))
    assert Pixels().score(judged(Rigid.identity()), Problem(orchard(), orchard(), None, far))["mse"] is None
    assert set(Pixels().score(judged(None), Problem(orchard(), orchard())).values()) == {None}


def test_checkpoints_are_compared_where_they_end() -> None:
    reference = np.random.default_rng(0).uniform(0, 100, (40, 2))
    truth = Rigid.turn(3, shift=(5, 1))
    source = truth.inverse()(reference + np.array([0.3, 0.4]))
    problem = Problem(orchard(), orchard(), None, None, (reference, source))
    figures = Checkpoints().score(judged(truth), problem)
    assert figures["rmse_m"] == pytest.approx(0.5)
    assert figures["ce90_m"] == pytest.approx(0.5)
    assert figures["rmse_m_before"] is not None
    assert figures["rmse_m_before"] > 3
    assert set(Checkpoints().score(judged(None), Problem(orchard(), orchard())).values()) == {None}
