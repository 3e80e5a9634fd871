"""Simulated series: the truth about every tree at every survey."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from treereg_core import io
from treereg_core.errors import UsageError
from treereg_core.simulate import Scene, Seasons, simulate_series, write_series

SCENE = Scene(trees=300, missed=0.08, false=0.08, dead=0.05, growth=1.4)


def test_the_same_arguments_give_the_same_series() -> None:
    one, two = (simulate_series(SCENE, 3, Seasons(surveys=3)) for _ in range(2))
    for a, b in zip(one.captures, two.captures, strict=True):
        assert np.array_equal(a.features.xy, b.features.xy)
        assert np.array_equal(a.trees, b.trees)


def test_the_truth_lays_every_survey_on_the_trees() -> None:
    series = simulate_series(SCENE, 4, Seasons(surveys=4))
    for capture in series.captures:
        whole = (capture.trees[:, 0] >= 0) & (capture.trees[:, 1] < 0)
        placed = capture.reference_from_source(capture.features.xy[whole])
        off = placed - series.lives.orchard.xy[capture.trees[whole, 0]]
        # split crowns stand apart from the stem; all others by the detector's error alone
        assert np.median(np.hypot(*off.T)) < 2 * SCENE.jitter


def test_only_living_trees_in_view_are_shown() -> None:
    series = simulate_series(SCENE, 5, Seasons(surveys=5, seen=0.6))
    for survey, capture in enumerate(series.captures):
        shown = capture.trees[capture.trees >= 0]
        assert capture.alive[shown].all()
        assert capture.covered[shown].all()
        assert capture.covered.mean() == pytest.approx(0.6 if survey else 1.0, abs=0.05)


def test_a_spot_has_one_tree_at_a_time_and_the_new_one_is_small() -> None:
    lives = simulate_series(SCENE, 6, Seasons(surveys=6, replanted=1.0)).lives
    for survey in range(6):
        standing = lives.spot[lives.alive(survey)]
        assert len(np.unique(standing)) == len(standing)
    again = np.flatnonzero(np.bincount(lives.spot) == 2)
    assert len(again) > 10
    later = np.flatnonzero((lives.born > 0) & np.isin(lives.spot, again) & (lives.born < 6))
    assert (lives.at(lives.born[later[0]]).area[later[0]] < 0.2 * lives.orchard.area[later[0]]).all()


def test_the_same_trees_are_missed_again() -> None:
    def missed_twice(persistence: float) -> float:
        scene = SCENE.model_copy(update={"trees": 3000, "missed": 0.2, "dead": 0.0})
        series = simulate_series(scene, 7, Seasons(surveys=2, late=0.0, persistence=persistence))
        found = [np.isin(np.arange(len(series.lives.spot)), c.trees) for c in series.captures]
        return float((~found[0] & ~found[1]).mean())

    assert missed_twice(0.0) == pytest.approx(0.04, abs=0.015)
    assert missed_twice(0.5) == pytest.approx(0.04 + 0.5 * 0.16, abs=0.025)


def test_a_series_is_written_as_survey_folders(tmp_path: Path) -> None:
    series = simulate_series(SCENE, 8, Seasons(surveys=2))
    folders = write_series(series, tmp_path)
    assert [folder.name for folder in folders] == ["2021", "2022"]
    for folder, capture in zip(folders, series.captures, strict=True):
        read = io.read_survey(folder)
        assert len(read.features) == len(capture.features)
        assert read.boundary is not None


def test_a_periodic_series_is_refused() -> None:
    with pytest.raises(UsageError, match="no truth"):
        simulate_series(Scene(periodic=True), 0)
