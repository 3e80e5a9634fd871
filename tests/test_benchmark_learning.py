"""The benchmark of learning: its series, its surveys that spoil, and its arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import learning
from benchmarks.landmarks import BINS
from benchmarks.learning_trial import FIRST, KINDS, SPOILT, SURVEYS, Measured, Trial, begun, hostile, run, scene
from treereg_core.simulate import Seasons, simulate_series

DEAD = 0.02


@pytest.fixture(scope="module")
def trial() -> Trial:
    return run(7000, DEAD)


def test_a_series_with_and_without_a_memory(trial: Trial) -> None:
    found = trial.found
    assert found.keys() == set(KINDS)
    assert list(found["none"]) == list(found["memory"]) == list(range(FIRST, SURVEYS))
    assert list(found["hostile"]) == list(found["astray"]) == list(range(SPOILT, SURVEYS))
    for one in (one for kind in ("none", "memory") for one in found[kind].values()):
        assert one.accepted
        assert one.right
        assert 0.9 < one.precision <= 1
        assert 0.01 < one.brier < 0.2
        assert 0.5 < one.error / one.best < 5
        assert one.bins[:, 0].sum() > 1000
    # Nothing is remembered at first; then the same pairs come out otherwise.
    assert found["memory"][FIRST].brier == found["none"][FIRST].brier
    assert found["memory"][SURVEYS - 1].brier < found["none"][SURVEYS - 1].brier
    assert found["memory"][SPOILT + 1].brier != found["hostile"][SPOILT + 1].brier


def test_surveys_that_spoil_are_what_they_say(trial: Trial) -> None:
    astray = trial.found["astray"][SPOILT]
    assert not astray.right
    assert astray.error == pytest.approx(scene(trial.seed, DEAD).row_spacing, rel=0.2)
    for kind in ("hostile", "astray"):
        assert all(trial.found[kind][survey].right for survey in range(SPOILT + 1, SURVEYS))
    series = simulate_series(scene(trial.seed, DEAD), trial.seed, Seasons(surveys=SURVEYS))
    good = begun(series, SPOILT)
    bad = hostile(good)
    true = bad.source_trees[:, 0] >= 0
    assert true.sum() == pytest.approx(0.5 * (good.source_trees[:, 0] >= 0).sum(), abs=1)
    assert true.mean() < 0.6
    assert bad.source.confidence[true].mean() < bad.source.confidence[~true].mean() - 0.2
    assert bad.error(bad.true_fit()) < 0.2


def test_the_report_has_a_line_for_every_difference(trial: Trial) -> None:
    text = learning.report([trial])
    assert text.count("memory - none  ") == len(learning.FIGURES) * (SURVEYS - FIRST) + 1
    assert text.count("first to last") == len(learning.FIGURES) + 1
    assert text.endswith("Of all other registrations, 0 are not right.")


def measured(precision: float, probability: float, landmark: float, error: float) -> Measured:
    bins = np.zeros((BINS, 3))
    bins[int(probability * BINS)] = 100, 100 * probability, 100 * landmark
    return Measured(precision, 0.1, bins, error, best=1.0, accepted=True, right=True)


def test_figures_over_orchards() -> None:
    orchards = [measured(0.9, 0.55, 0.45, 1.0), measured(1.0, 0.55, 0.65, 7.0)]
    counts = np.array([[1, 1], [2, 0]])
    precision, _, calibration, error = (figure.of(orchards, counts) for figure in learning.FIGURES)
    assert precision == pytest.approx([0.95, 0.9])
    # Of all trees together the probabilities are true; of the first orchard's they are not.
    assert calibration == pytest.approx([0.0, 0.1])
    assert error == pytest.approx([5.0, 1.0])
    assert learning.line("x", "2", ".2f", (precision, precision + 0.01))[2:] == (
        *("0.95", "0.96", "+0.01"),
        "+0.01 to +0.01",
    )
