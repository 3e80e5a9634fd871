"""What the georeference says beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.orchards import alike, grid
from treereg_core.prior import log_prior
from treereg_core.transform import Rigid

SURVEY = alike(grid(10, 20) + np.array([400.0, -80.0]))
CENTROID = SURVEY.xy.mean(axis=0)


def moved_by(turn_deg: float, x: float = 0.0, y: float = 0.0) -> Rigid:
    """A turn about the survey's centroid, then a shift in metres."""
    return Rigid.turn(turn_deg, about=CENTROID, shift=(x, y))


@pytest.mark.parametrize("placement", [Rigid.identity(), moved_by(180, 1e4, 0), Rigid.turn(90)])
def test_nothing_is_known_without_an_sd(placement: Rigid) -> None:
    assert log_prior(placement, SURVEY, None) == 0


@pytest.mark.parametrize("sd", [0.5, 3.0, 40.0])
def test_it_is_greatest_at_the_identity_and_falls_with_shift_and_turn(sd: float) -> None:
    assert log_prior(Rigid.identity(), SURVEY, sd) == pytest.approx(0, abs=1e-9)
    by_shift = [log_prior(moved_by(0, x), SURVEY, sd) for x in np.linspace(0, 4 * sd, 9)]
    by_turn = [log_prior(moved_by(turn), SURVEY, sd) for turn in np.linspace(0, 180, 13)]
    assert np.all(np.diff(by_shift) < 0)
    assert np.all(np.diff(by_turn) < 0)


@pytest.mark.parametrize("sd", [0.5, 3.0])
def test_no_direction_and_no_sense_of_turning_is_preferred(sd: float) -> None:
    here = log_prior(moved_by(7, 3, 4), SURVEY, sd)
    for turn, x, y in ((-7, 3, 4), (7, -3, -4), (7, 4, -3), (-7, 0, 5), (7, -5, 0)):
        assert log_prior(moved_by(turn, x, y), SURVEY, sd) == pytest.approx(here)


def test_a_shift_of_one_sd_costs_half_a_unit() -> None:
    """The normal density: -(r / sd)^2 / 2."""
    assert log_prior(moved_by(0, 3), SURVEY, 3.0) == pytest.approx(-0.5)
    assert log_prior(moved_by(0, 3, 3), SURVEY, 3.0) == pytest.approx(-1.0)
    assert log_prior(moved_by(0, 30), SURVEY, 3.0) == pytest.approx(-50)


def test_a_half_turn_is_unlikely_and_never_impossible() -> None:
    cost = log_prior(moved_by(180), SURVEY, 3.0)
    assert -50 < cost < -5
    assert log_prior(moved_by(180), SURVEY, 0.1) == pytest.approx(cost), "a turn is not bounded by a shift"


def test_a_wider_sd_forgives_more() -> None:
    costs = [log_prior(moved_by(0, 20), SURVEY, sd) for sd in (1.0, 3.0, 10.0, 100.0)]
    assert np.all(np.diff(costs) > 0)


def test_the_place_of_the_survey_is_of_no_account() -> None:
    far = SURVEY.replace(xy=SURVEY.xy + np.array([3e4, -5e4]))
    placement = moved_by(11, 2, -1)
    assert log_prior(placement.about([-3e4, 5e4]), far, 3.0) == pytest.approx(log_prior(placement, SURVEY, 3.0))
