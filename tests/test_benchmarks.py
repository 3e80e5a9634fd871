"""The benchmarks' own arithmetic: a table that lies would be worse than none."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import accuracy, calibration, comparison, methods, results
from benchmarks.given import read_trials
from benchmarks.pages import filled
from benchmarks.starts import GROUPS, Near, brought_near, is_near, row_ends
from treereg_core.errors import UsageError
from treereg_core.evaluation import Families, Study, Trial, run_trial
from treereg_core.evaluation.case import is_right
from treereg_core.evaluation.log import Log
from treereg_core.options import Options
from treereg_core.simulate import Scene, simulate, simulate_family
from treereg_core.statistics import upper_bound, wilson
from treereg_core.transform import Rigid

ICP = Options(method="icp")
MISPLACED = {"rotation_deg": 0.5, "translation_m": 2.0, "misplaced": 2.0}
TRIAL = Trial("icp", "coarse", "0", "shift_3", 1, 100, **MISPLACED, verdict="accepted", right=True, bend=0.0)


def write(path, trials):
    """A file of trials, as the harness writes it."""
    Log(path, Study(Families(), (ICP,), range(1))).append(trials)


def test_wilson_against_published_values():
    # Newcombe 1998, doi:10.1002/(SICI)1097-0258(19980430)17:8<857::AID-SIM777>3.0.CO;2-E, table I.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)


def test_upper_bound_is_the_rule_of_three_when_nothing_was_seen():
    assert upper_bound(0, 3000) == pytest.approx(0.001)
    assert upper_bound(1, 3000) > 0.001
    assert upper_bound(0, 0) == 1


@pytest.mark.parametrize(
    ("error", "fit_error", "bend", "right"),
    [
        (0.49, 0.01, 0.0, True),
        (0.51, 0.01, 0.0, False),
        (0.60, 0.50, 0.0, True),
        (0.63, 0.50, 0.0, False),
        (0.40, 0.05, 0.6, True),
        (0.50, 0.05, 0.6, False),
        (0.40, math.nan, 0.0, True),
        (math.nan, 0.1, 0.0, False),
    ],
)
def test_right_is_half_a_metre_or_near_the_fit_with_true_pairs(error, fit_error, bend, right):
    assert is_right(error, fit_error, bend) is right


def test_a_crash_is_counted_not_hidden():
    crashed = replace(TRIAL, name="small_60", verdict="crashed", right=False)
    assert "CRASHED: 1 trials" in accuracy.report([crashed, replace(TRIAL, name="small_60")])


def test_a_file_that_holds_no_trials_is_refused(tmp_path):
    path = tmp_path / "trials.csv"
    write(path, [TRIAL])
    assert read_trials([path, path])[0].name == "shift_3"
    path.write_text("a,b\n1,2\n")
    for file in (path, tmp_path / "none.csv"):
        with pytest.raises(UsageError, match=file.name):
            read_trials([file])


def test_an_interrupted_run_goes_on(tmp_path, monkeypatch, capsys):
    out = tmp_path / "trials.csv"
    arguments = ["accuracy", "--family", "small_60", "--method", "icp", "--jobs", "1", "--out", str(out), "--seeds"]
    monkeypatch.setattr(sys, "argv", [*arguments, "1"])
    assert accuracy.main() == 0
    first = out.read_text()
    monkeypatch.setattr(sys, "argv", [*arguments, "2", "--method", "confidence+icp"])
    assert accuracy.main() == 0
    assert out.read_text().startswith(first)
    assert sorted((trial.method, trial.seed) for trial in read_trials([out])) == [
        *(("confidence+icp", 0), ("confidence+icp", 1), ("icp", 0), ("icp", 1)),
    ]
    shown = capsys.readouterr().out
    assert shown.index("icp from coarse") < shown.index("confidence+icp from coarse")
    monkeypatch.setattr(sys, "argv", [*arguments, "2", "--georeference-sd", "3"])
    assert accuracy.main() == 2
    assert "under other options" in capsys.readouterr().err


def test_the_table_counts_right_silent_and_flagged():
    right = replace(TRIAL, error=0.02, fit_error=0.01, ci_low=0.01, ci_high=0.03, start_s=1, match_s=1, judge_s=1)
    trials = [right] * 6 + [replace(right, verdict="ambiguous", ci_high=0.015)] * 2
    trials += [replace(TRIAL, right=False), replace(TRIAL, right=False, verdict="failed")]
    cells = accuracy.line("x", trials)
    assert cells == ("x", "10", "80.0 %", "1", "25.0 %", "10.0 %", "0.020", "0.010", "2.00", "75.0 %", "3.00")


def test_reliability_shows_a_liar():
    honest = [replace(TRIAL, failure_probability=0.05, right=k >= 5) for k in range(100)]
    liar = [replace(TRIAL, failure_probability=0.005, right=k >= 30) for k in range(100)]
    rows = calibration.reliability([*honest, *liar]).splitlines()
    assert next(row for row in rows if row.startswith("0.01 to 0.1")).endswith("yes")
    assert next(row for row in rows if row.startswith("0.001 to 0.01")).endswith("NO")
    assert calibration.silence(liar).splitlines()[-1].split()[:3] == ["all", "100", "30"]


def test_the_trade_counts_what_each_limit_would_flag_and_accept():
    probabilities = [1e-6, 1e-3, 1e-3, 0.05, 0.9]
    hard = [replace(TRIAL, name="overlap_50", right=k != 2, failure_probability=p) for k, p in enumerate(probabilities)]
    plain = [replace(TRIAL, name="shift_3", right=True, failure_probability=1e-5)]
    rows = [row.split() for row in calibration.trade([*hard, *plain]).splitlines()[2:]]
    assert [row[1] for row in rows if row[0] == "hard"] == ["1e-06", "1e-05", "0.0001", "0.001", "0.01", "0.1", "0.5"]
    assert ["hard", "1e-06", "4", "3", "75.0", "%", "1", "0", "100.00", "%"] in rows
    assert ["hard", "0.001", "(default)", "4", "2", "50.0", "%", "3", "1", "79.23", "%"] in rows
    assert ["hard", "0.1", "4", "1", "25.0", "%", "4", "1", "69.94", "%"] in rows
    assert ["ordinary", "1e-06", "1", "1", "100.0", "%", "0", "0", "-"] in rows
    assert [row[-4] for row in rows if row[0] == "all"] == ["1", "2", "2", "4", "4", "5", "5"]


def test_a_start_is_near_while_every_row_end_is():
    scene = Scene(trees=400, outline="rectangle", planting_jitter=0.0, gaps=0.0, missed=0.0, false=0.0)
    simulation = simulate(scene, seed=0)
    ends = row_ends(simulation)
    along, centre = ends.along[0] * np.sign(ends.along[0, 0]), ends.truth.mean(axis=0)
    across = np.array([-along[1], along[0]])

    def near(shift, turn_deg=0.0):
        return is_near(ends, scene, Rigid.turn(turn_deg, about=centre, shift=shift) @ simulation.truth)

    assert near(1.99 * scene.spacing * along)
    assert not near(2.01 * scene.spacing * along)
    assert near(0.39 * scene.row_spacing * across)
    assert not near(0.41 * scene.row_spacing * across)
    assert near(0.39 * scene.row_spacing * across + 1.99 * scene.spacing * along)
    half_length = np.abs((ends.truth - centre) @ along).max()
    assert near((0, 0), math.degrees(0.39 * scene.row_spacing / half_length))
    assert not near((0, 0), math.degrees(0.41 * scene.row_spacing / half_length))


@pytest.mark.parametrize("family", ["noisy", "curved", "headlands", "double_hedgerow", "distortion_1", "square_any"])
def test_a_source_brought_near_is_near_and_as_good_as_before(family):
    before = simulate_family(family, 3)
    off = []
    for seed in range(20):
        after = brought_near(before, np.random.default_rng(seed))
        ends = row_ends(after)
        assert is_near(ends, after.scene, Rigid.identity())
        assert after.error(after.true_fit()) == pytest.approx(before.error(before.true_fit()), rel=1e-6)
        off.append(np.hypot(*(ends.source - ends.truth).T).max() / before.scene.row_spacing)
    assert not is_near(row_ends(before), before.scene, Rigid.identity())
    assert max(off) > 0.3
    assert np.ptp(off) > 0.1


def test_near_cases_are_near_and_have_names_of_their_own():
    source = Near(("small_60", "different"))
    assert source.names == ("near small_60",)
    assert GROUPS["near small_60"] == "near frontier"
    case = source.case("near small_60", 0)
    limit = math.hypot(0.4 * 5.5 * 1.15, 2 * 3.0 * 1.2)
    assert 0 < case.misplaced[1] < limit
    assert case.error(Rigid.identity()) < limit
    assert np.array_equal(source.case("near small_60", 0).problem.source.xy, case.problem.source.xy)
    trial = run_trial(Options(method="aco", start="identity"), case)
    assert (trial.name, trial.start) == ("near small_60", "identity")


def test_methods_stand_side_by_side(tmp_path, monkeypatch, capsys):
    right, wrong = replace(TRIAL, error=0.02, fit_error=0.01), replace(TRIAL, seed=2, right=False, error=2.0)
    aco = replace(right, method="aco", start="identity", verdict="ambiguous")
    trials = [right, wrong, aco, replace(aco, name="near shift_3"), replace(wrong, name="periodic_turn")]
    trials.append(replace(right, method="aco"))
    path = tmp_path / "trials.csv"
    # near cases and families come from two sources, so from two files
    write(path, trials)
    monkeypatch.setattr(sys, "argv", ["methods", str(path)])
    assert methods.main() == 0
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in out.splitlines() if line.startswith("|")]
    overall = {(row[0], row[1]): row[2:] for row in rows if len(row) == 10}
    assert overall["`coarse`", "`icp`"][:3] == ["2", "50.0 % [9.5, 90.5]", "2 (at most 93.85 %)"]
    assert overall["`coarse`", "`icp`"][4] == "2.00"
    assert overall["`near`", "`aco`"][3] == "100.0 % [20.7, 100.0]"
    coarse, identity, near = out.split("### From ")[1:]
    assert "| family | trials | `icp` | `aco` |" in coarse
    assert "| `shift_3` | 2 | 50.0 (1) | 100.0 (0) |" in coarse
    assert "| **all ordinary** | 2 | 50.0 (1) | 100.0 (0) |" in coarse
    assert "| `periodic_turn` | 1 | - (1) | - |" in coarse
    assert "| `shift_3` | 1 | 100.0 (0) |" in identity
    assert "| `near shift_3` | 1 | 100.0 (0) |" in near


def test_one_command_makes_the_page_of_results(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("# Before\n<!-- results -->\nstale figures\n<!-- /results -->\nafter\n")
    monkeypatch.setattr(results, "PAGE", page)
    monkeypatch.setattr(results, "METHODS", ("icp", "confidence+icp"))
    arguments = ["--out", str(tmp_path / "out"), "--family", "small_60", "--seeds", "1", "--jobs", "1"]
    assert results.main(arguments) == 0
    first = page.read_text()
    assert first.startswith("# Before\n")
    assert first.endswith("<!-- /results -->\nafter\n")
    assert "stale figures" not in first
    assert "--out results --seeds 1 --first-seed 0 --family small_60\n" in first
    for start in results.STARTS:
        assert f"### From `{start}`" in first
    assert "| family | trials | `icp` | `confidence+icp` |" in first
    assert results.main(arguments) == 0
    assert page.read_text() == first
    assert results.main([*arguments, "--family", "small_6"]) == 2


def test_the_page_of_results_has_its_place_and_every_method():
    page = results.PAGE.read_text(encoding="utf-8")
    assert filled(page, {"results": "x"}) != page
    assert all(f"`{name}`" in page for name in results.METHODS)


def test_methods_are_compared_on_the_seeds_that_all_tried(tmp_path, monkeypatch, capsys):
    icp = [replace(TRIAL, seed=k, error=0.01 * (k + 1), fit_error=0.01) for k in range(9)]
    aco = [replace(trial, method="aco", error=2 * trial.error) for trial in icp]
    aco[0] = replace(aco[0], right=False)
    combined = [replace(trial, method="combined", error=trial.error / 2) for trial in icp[:8]]
    path = tmp_path / "trials.csv"
    write(path, [*icp, *aco, *combined])
    monkeypatch.setattr(sys, "argv", ["comparison", str(path), "--against", "icp", "--against", "aco"])
    assert comparison.main() == 0
    out = capsys.readouterr().out
    lines = {line.split()[1]: line.split()[2:] for line in out.splitlines() if line.startswith("shift_3")}
    assert " ".join(lines["icp"][:9]) == "8 100.0 % 67.6 to 100.0 % 0 4.50"
    assert lines["icp"][-1] == "*"
    assert " ".join(lines["aco"][:9]) == "8 87.5 % 52.9 to 97.8 % 1 10.00"
    assert " ".join(lines["aco"][-6:]) == "2.00 2.00 to 2.00 0 1"
    assert " ".join(lines["combined"][-6:]) == "0.50 0.50 to 0.50 0 0"
    monkeypatch.setattr(sys, "argv", ["comparison", str(tmp_path / "none.csv")])
    assert comparison.main() == 2


def test_a_method_that_is_never_right_has_no_ratio():
    wrong = [replace(TRIAL, seed=k, right=False, verdict="failed") for k in range(3)]
    right = [replace(TRIAL, seed=k, method="aco", error=0.02, fit_error=0.01) for k in range(3)]
    lines = comparison.report([*wrong, *right, replace(TRIAL, name="different")]).splitlines()[2:]
    assert [line.split()[:2] for line in lines[:2]] == [["shift_3", "icp"], ["shift_3", "aco"]]
    assert [line.split()[:2] for line in lines[2:]] == [["all", "ordinary"]] * 2
    assert lines[0].split()[-6:] == ["-", "-", "-", "-", "0", "3"]


def test_the_bootstrap_covers_the_ratio_of_medians_as_often_as_it_says():
    rng = np.random.default_rng(3)
    covered = []
    for _ in range(200):
        pairs = np.exp(0.3 * rng.standard_normal((60, 2))) * (1.2, 1.0)
        ratio, interval = comparison.with_interval(pairs, comparison.of_medians)
        low, _, high = interval.split()
        assert float(low) <= float(ratio) <= float(high)
        covered.append(float(low) - 0.005 <= 1.2 <= float(high) + 0.005)
    assert 0.9 < np.mean(covered) <= 0.99
