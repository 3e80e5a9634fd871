"""Whether the expected error is what errors turn out to be, over many simulated fits to true pairs."""

from __future__ import annotations

import numpy as np
import pytest

from treereg_core.expected_error import expected_error, fit_covariance
from treereg_core.features import FeatureSet
from treereg_core.method import Registration
from treereg_core.transform import FloatArray, Model, Rigid

TRIALS = 1500
TRUTH = Rigid.turn(17.0, shift=(40.0, -12.0))


def planted(trees: int) -> FloatArray:
    """Positions of so many trees, 5.5 x 3 m apart, in an oblong block."""
    columns = round((trees * 2.0) ** 0.5)
    k = np.arange(trees)
    return np.column_stack([k % columns * 3.0, k // columns * 5.5])


def trials(
    model: Model, trees: int, sigma_m: float, seed: int, weighted: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True errors, expected ones and their intervals, of many fits to surveys with noise of this sd per axis."""
    rng = np.random.default_rng(seed)
    xy = planted(trees)
    ids = np.column_stack([np.arange(trees)] * 2)
    errors, expected, intervals = [], [], []
    for _ in range(TRIALS):
        uneven = np.where(np.arange(trees) % 3 == 0, 2.0, 0.5)[:, None] if weighted else 1.0
        reference = FeatureSet.of(xy + rng.normal(0, sigma_m, xy.shape) * uneven)
        source = FeatureSet.of(TRUTH.inverse()(xy + rng.normal(0, sigma_m, xy.shape) * uneven))
        weights = np.ones(trees)
        transform = model.fit(source.xy, reference.xy, weights)
        fit = Registration(transform, ids, weights)
        found = expected_error(*fit_covariance(fit, reference, source, model))
        errors.append(np.sqrt(np.mean(((transform(source.xy) - TRUTH(source.xy)) ** 2).sum(axis=1))))
        expected.append(found.rms)
        intervals.append(found.ci95)
    return np.array(errors), np.array(expected), np.array(intervals)


@pytest.mark.parametrize("model", Model)
@pytest.mark.parametrize(("trees", "sigma_m"), [(60, 0.1), (400, 0.2)])
def test_the_interval_covers_and_the_expected_error_is_the_mean(model: Model, trees: int, sigma_m: float) -> None:
    errors, expected, intervals = trials(model, trees, sigma_m, seed=trees + model.parameters)
    covered = float(np.mean((intervals[:, 0] <= errors) & (errors <= intervals[:, 1])))
    # 95 %, give or take three standard deviations of the count and one per cent for the approximation.
    assert 0.925 <= covered <= 0.97, f"the 95 % interval covers {covered:.1%}"
    ratio = float(np.sqrt(np.mean(expected**2) / np.mean(errors**2)))
    assert 0.95 <= ratio <= 1.1, f"the expected error is {ratio:.3f} times the true one"


@pytest.mark.parametrize("model", Model)
def test_it_is_the_closed_form_where_that_holds(model: Model) -> None:
    """sigma sqrt(p / N), sigma the noise of both surveys together and p the parameters of the model."""
    sigma, trees = 0.1, 400
    _, expected, _ = trials(model, trees, sigma, seed=5)
    closed = np.sqrt(2) * sigma * np.sqrt(model.parameters / trees)
    assert np.sqrt(np.mean(expected**2)) == pytest.approx(closed, rel=0.05)


def test_uneven_noise_is_counted_as_it_is() -> None:
    errors, expected, intervals = trials(Model.RIGID, 300, 0.15, seed=9, weighted=True)
    covered = float(np.mean((intervals[:, 0] <= errors) & (errors <= intervals[:, 1])))
    assert 0.925 <= covered <= 0.97, f"the 95 % interval covers {covered:.1%}"
    assert np.sqrt(np.mean(expected**2) / np.mean(errors**2)) == pytest.approx(1, abs=0.1)


def test_a_known_displacement_comes_on_top() -> None:
    covariance, spread = np.eye(3) * 1e-4, np.eye(3)
    without, on_top = expected_error(covariance, spread), expected_error(covariance, spread, bias=0.3)
    assert on_top.rms == pytest.approx(np.hypot(without.rms, 0.3))
    assert on_top.ci95[0] > 0.3
    assert without.ci95[0] < without.rms < without.ci95[1]


def test_exact_copies_have_no_error() -> None:
    survey = FeatureSet.of(planted(50))
    fit = Registration(Rigid.identity(), np.column_stack([survey.ids, survey.ids]), np.ones(50))
    found = expected_error(*fit_covariance(fit, survey, survey, Model.RIGID))
    assert found.rms == pytest.approx(0, abs=1e-9)
    assert expected_error(np.zeros((3, 3)), np.eye(3), bias=0.2).ci95 == (0.2, 0.2)


@pytest.mark.parametrize("pairs", [0, 1, 2])
def test_fits_that_fix_nothing_have_no_expected_error(pairs: int) -> None:
    survey = FeatureSet.of(planted(50))
    ids = np.column_stack([survey.ids, survey.ids])[:pairs]
    model = Model.AFFINE
    with pytest.raises(ValueError, match=r"without pairs|determine"):
        fit_covariance(Registration(Rigid.identity(), ids, np.ones(pairs)), survey, survey, model)
