"""The ground a survey's trees cover: gaps and holes yes, outside no."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.orchards import grid
from treereg_core.footprint import Footprint
from treereg_core.simulate import Scene, simulate
from treereg_core.transform import FloatArray, Rigid

REACH = 7.5


def without_disc(xy: FloatArray, centre: FloatArray, radius: float) -> FloatArray:
    return np.asarray(xy[np.hypot(*(xy - centre).T) > radius])


@pytest.mark.parametrize("seed", range(3))
def test_every_tree_is_covered(seed: int) -> None:
    survey = simulate(Scene(trees=400, holes=2), seed).reference
    footprint = Footprint.of(survey.xy, 2.5 * survey.spacing)
    assert footprint.covers(survey.xy).mean() > 0.98, "but for those that stand all alone at the edge"


def test_gaps_and_enclosed_holes_belong_to_it() -> None:
    block = grid(20, 30)
    centre = block.mean(axis=0)
    for radius in (4.0, 12.0, 30.0):
        footprint = Footprint.of(without_disc(block, centre, radius), REACH)
        assert footprint.covers(block).all(), f"a hole of {radius} m"


def test_what_lies_outside_does_not() -> None:
    block = grid(20, 30)
    footprint = Footprint.of(block, REACH)
    low, high = block.min(axis=0), block.max(axis=0)
    middle = (low + high) / 2
    for beyond in (2.0, 20.0, 1e6):
        outside = [
            [low[0] - beyond, middle[1]],
            [high[0] + beyond, middle[1]],
            [middle[0], low[1] - beyond],
            [middle[0], high[1] + beyond],
        ]
        assert not footprint.covers(np.array(outside)).any(), f"{beyond} m beyond the outermost trees"


def test_a_bay_that_is_open_to_one_side_does_not_belong_to_it() -> None:
    block = grid(20, 30)
    bay = (block[:, 0] > 30) & (block[:, 0] < 60) & (block[:, 1] > 40)
    footprint = Footprint.of(block[~bay], REACH)
    assert not footprint.covers(np.array([[45.0, 80.0], [45.0, 100.0]])).any()
    assert footprint.covers(block[~bay]).all()


def test_two_blocks_across_a_wide_road_are_two_grounds() -> None:
    blocks = np.concatenate([grid(10, 10), grid(10, 10) + np.array([27 + 40, 0])])
    footprint = Footprint.of(blocks, REACH)
    assert footprint.covers(blocks).all()
    assert not footprint.covers(np.array([[27 + 20.0, 25.0]])).any()


@pytest.mark.parametrize("reach", [5.0, 7.5, 12.0])
def test_its_area_is_that_between_the_outermost_trees(reach: float) -> None:
    block = grid(30, 50)
    width, height = np.ptp(block, axis=0)
    footprint = Footprint.of(block, reach)
    assert footprint.mask.sum() * footprint.cell**2 == pytest.approx(width * height, rel=0.05)
    assert footprint.covers(footprint.points).all()
    assert len(footprint.points) * footprint.cell**2 == pytest.approx(footprint.mask.sum() * footprint.cell**2)


def test_it_moves_with_the_trees() -> None:
    block = without_disc(grid(20, 30), np.array([30.0, 40.0]), 9.0)
    probe = np.random.default_rng(0).uniform(-20, 130, (4000, 2))
    here = Footprint.of(block, REACH).covers(probe)
    for motion in (Rigid.turn(90), Rigid.turn(33, shift=(1e4, -1e4))):
        there = Footprint.of(motion(block), REACH).covers(motion(probe))
        assert np.mean(here != there) < 0.02, "but for the width of a cell along the edge"


def test_one_tree_and_a_line_of_trees_cover_hardly_anything() -> None:
    for xy in (np.zeros((1, 2)), np.column_stack([np.arange(20) * 3.0, np.zeros(20)])):
        footprint = Footprint.of(xy, REACH)
        assert footprint.covers(xy).all()
        assert not footprint.covers(xy + np.array([0, REACH])).any()


def test_a_straggler_a_hundred_kilometres_off_does_not_need_a_giant_grid() -> None:
    block = np.concatenate([grid(5, 5), [[1e5, 1e5]]])
    assert Footprint.of(block, REACH).mask.size < 1e7
