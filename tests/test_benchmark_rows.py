"""The benchmark of rows: what an edge is worth, and that its tables and pictures show it."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from benchmarks import rows
from benchmarks.edges import compare, truths
from benchmarks.row_trial import RowTrial, best_edges, run_row_trial
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.pair import Rows
from treereg_core.simulate import Simulation, Trees, simulate, simulate_family, write_simulation
from treereg_core.simulate.families import family_scene
from treereg_core.testing.scenes import true_rows
from treereg_core.transform import Rigid


def by_hand():
    """Two rows; ids count from 100.

    Row 0: trees in columns 0 to 3, 5 and 8 are features 100 to 105, one in column 4 is missed. 106 is false.
    Row 1: columns 0 to 2 are 107 to 109; 3 is split into 110 and 111; 4 and 5 are merged into 112; 6 is 113.
    """
    column = np.array([0, 1, 2, 3, 4, 5, 8, 0, 1, 2, 3, 4, 5, 6])
    row = np.array([0] * 7 + [1] * 7)
    xy = np.column_stack([3.0 * column, 5.0 * row])
    shown = np.full((14, 2), -1)
    shown[:, 0] = [0, 1, 2, 3, 5, 6, -1, 7, 8, 9, 10, 10, 11, 13]
    shown[12, 1] = 12
    survey = FeatureSet.of(xy[np.maximum(shown[:, 0], 0)]).replace(ids=np.arange(100, 114))
    trees = Trees(xy, np.ones(len(xy)), row, column)
    scene = family_scene("small_60", 0)
    return Simulation(scene, 0, survey, survey, Rigid.identity(), 0.0, trees, shown, shown, np.zeros((0, 2)))


def edges_of(*found):
    simulation = by_hand()
    return compare(Rows(tuple(np.array(row) for row in found)), simulation, simulation.reference)


TRUE = {(100, 101), (101, 102), (102, 103), (103, 104), (107, 108), (108, 109)}


@pytest.mark.parametrize(
    ("found", "right", "wrong", "neither"),
    [
        ([100, 101, 102, 103, 104], {(100, 101), (101, 102), (102, 103), (103, 104)}, set(), set()),
        ([104, 103], {(103, 104)}, set(), set()),
        ([104, 105], set(), set(), {(104, 105)}),
        ([107, 109], set(), {(107, 109)}, set()),
        ([102, 104], set(), {(102, 104)}, set()),
        ([100, 107], set(), {(100, 107)}, set()),
        ([100, 106, 101], set(), set(), {(100, 106), (101, 106)}),
        ([109, 110, 111, 112, 113], set(), set(), {(109, 110), (110, 111), (111, 112), (112, 113)}),
        ([109, 113], set(), set(), {(109, 113)}),
    ],
    ids=["row", "bridge", "gap", "skip", "skip at a bridge", "across", "false", "split, merged", "over split, merged"],
)
def test_what_an_edge_is_worth(found, right, wrong, neither):
    edges = edges_of(found)
    assert (edges.right, edges.wrong, edges.neither, edges.missed) == (right, wrong, neither, TRUE - right)


def test_iou_precision_and_recall():
    edges = edges_of([100, 101, 102, 103, 104], [107, 109])
    assert (edges.iou, edges.precision, edges.recall) == pytest.approx((4 / 7, 4 / 5, 4 / 6))
    nothing = edges_of()
    assert (nothing.iou, nothing.precision, nothing.recall) == (0, 0, 0)


@pytest.mark.parametrize("family", ["rotation_any", "noisy", "paths", "headlands", "double_hedgerow", "overlap_60"])
def test_the_true_rows_of_both_surveys_are_right(family):
    simulation = simulate_family(family, 0)
    given = true_rows(simulation)
    for found, survey in ((given.reference, simulation.reference), (given.source, simulation.source)):
        edges = compare(found, simulation, survey)
        assert len(edges.right) > 500
        assert not edges.wrong
        # a split or merged tree stands between the trees that are missed, if at all
        assert edges.recall > 0.99


def test_columns_are_as_true_in_a_square_lattice_alone():
    square, oblong = simulate_family("square_any", 0), simulate_family("rotation_any", 0)
    assert len(truths(oblong)) == 1
    by_rows, by_columns = (true_rows(truth).reference for truth in truths(square))
    assert best_edges(by_rows, square).iou > 0.99
    assert best_edges(by_columns, square).iou > 0.99
    assert compare(by_columns, square, square.reference).iou < 0.01


def test_a_trial_of_rows():
    trial = run_row_trial("aco", "small_150", 0)
    assert trial.iou > 0.9
    assert 0.9 < trial.in_rows <= 1
    assert 0 <= trial.false_in_rows < 0.5
    assert 0 < trial.seconds < 10


@pytest.mark.parametrize("fault", [NoRegistration("none"), ZeroDivisionError("on purpose")])
def test_no_rows_and_crashes_count_as_nothing_found(monkeypatch, capsys, fault):
    def refuse(*_):
        raise fault

    run_row_trial("aco", "small_60", 0)  # so that the method has run once
    monkeypatch.setattr("benchmarks.row_trial.carry_out", refuse)
    trial = run_row_trial("aco", "small_60", 0)
    assert (trial.iou, trial.in_rows) == (0, 0)
    said = capsys.readouterr().err + rows.report([trial], ["small_60"])
    crashed = isinstance(fault, ZeroDivisionError)
    assert ("small_60 seed 0: ZeroDivisionError: on purpose" in said) is crashed
    assert ("CRASHED: 1 surveys" in said) is crashed


def test_a_line_of_the_table():
    trial = RowTrial("x", 1, 100, right=90, wrong=5, missed=5, in_rows=0.9, false_in_rows=0.1, seconds=1.0)
    worse = replace(trial, seed=2, right=45, wrong=45, missed=10, false_in_rows=math.nan, seconds=3.0)
    cells = rows.line("x", [trial, worse])
    assert cells == ("x", "2", "100", "0.6750", "0.4500", "2", "0.7297", "0.9000", "90.0 %", "10.0 %", "2.00")


def test_figures_and_pictures(tmp_path, monkeypatch, capsys):
    survey = tmp_path / "orchard"
    write_simulation(simulate(family_scene("small_60", 0), 0), survey)
    out = ["--jobs", "1", "--pictures", str(tmp_path / "pictures")]
    monkeypatch.setattr(sys, "argv", ["rows", "--family", "small_60", "--seeds", "1", *out])
    assert rows.main() == 0
    assert next(line for line in capsys.readouterr().out.splitlines() if line.startswith("small_60")).split()[1] == "1"
    monkeypatch.setattr(sys, "argv", ["rows", "--survey", str(survey / "reference"), "--sizes", "100", "300", *out])
    assert rows.main() == 0
    printed = capsys.readouterr().out
    assert "orchard/reference" in printed
    assert "n^" in printed
    red, green, blue = picture(tmp_path / "pictures" / "small_60.png").T
    assert ((green > red + 60) & (green > blue + 60)).sum() > 100, "no green edges"
    assert len(picture(tmp_path / "pictures" / "orchard-reference.png")) > 300


def picture(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), dtype=int)
