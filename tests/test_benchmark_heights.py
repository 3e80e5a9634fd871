"""The benchmarks of heights: what they compare, and what their tables count."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import elevation, heights
from benchmarks.heights import How, Outcome
from treereg_core.simulate import Scene, simulate

HOW = How("coarse", 0.08, None)


def test_told_heights_are_those_of_the_trees_with_their_error():
    simulation = simulate(Scene(trees=2000, false=0.2), 1)
    flight = simulation.flights[1]
    told = heights.told_heights(simulation.source, flight, 0.1, np.random.default_rng(0))
    trees = simulation.source_trees
    whole = (trees[:, 0] >= 0) & (trees[:, 1] < 0)
    off = told[whole] - simulation.heights()[trees[whole, 0], 1]
    assert 1.48 * np.median(np.abs(off)) == pytest.approx(0.1, rel=0.15)
    assert np.median(told[trees[:, 0] < 0]) < np.median(told[whole])


def test_a_trial_is_one_pair_with_and_without_heights():
    without, having = heights.trial(HOW, "small_150", 3)
    assert (without.heights, having.heights) == (False, True)
    assert having.right
    assert having.accepted


def test_one_raster_gives_both_surveys_heights():
    simulation, told = heights.with_one_raster(2)
    assert [len(values) for values in told] == [len(simulation.reference), len(simulation.source)]
    assert np.isfinite(np.concatenate(told)).all()


def test_the_table_counts_what_is_accepted_and_wrong():
    outcomes = [
        Outcome("small_60", having, right, accepted)
        for having in (False, True)
        for right, accepted in ((True, True), (False, having), (True, False), (False, False))
    ]
    *_, without, having = heights.report(outcomes, ["small_60"]).splitlines()
    assert without.split()[1:4] == ["without", "4", "2"]
    assert [line.split()[-1] for line in (without, having)] == ["0", "1"]


def test_rasters_are_compared_with_the_truth():
    told = elevation.tell("15 % slope", 1)
    assert np.nanmedian(np.abs(told.errors)) < 0.2
    assert abs(told.offset_error) < 0.05
    row = elevation.line("15 % slope", [told])
    assert row[1] == str(len(told.errors))
    assert len(row) == len(elevation.HEADER)
