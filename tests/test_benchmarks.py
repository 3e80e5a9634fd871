"""The benchmarks' own arithmetic: a table that lies would be worse than none."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import accuracy, calibration, comparison, methods
from benchmarks.starts import brought_near, is_near, row_ends
from benchmarks.trial import Conditions, Trial, append, is_right, plan, read_trials, run_trial, write_header
from treereg_core.errors import UsageError
from treereg_core.simulate import Scene, simulate, simulate_family
from treereg_core.statistics import upper_bound, wilson
from treereg_core.transform import Rigid

ICP = Conditions("icp", "coarse", math.inf)
ABOUT = {"family": "shift_3", "seed": 1, "trees": 100, "near_start": True, "verdict": "accepted"}
TRIAL = Trial(**vars(ICP), **ABOUT, right=True, bend=0.0)


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


def test_a_trial_knows_its_truth():
    trial = run_trial(ICP, "shift_06", 3)
    assert trial.verdict == "accepted"
    assert trial.right
    assert 0 < trial.error < 0.1
    assert trial.ci_low < trial.expected_rms < trial.ci_high
    assert 0 < trial.seconds < 60
    lost = run_trial(replace(ICP, start="identity"), "rotation_any", 3)
    assert not lost.right
    assert math.isnan(run_trial(ICP, "different", 3).error)


def test_a_crash_is_counted_not_hidden(monkeypatch, capsys):
    def crash(*_):
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("benchmarks.trial.execute", crash)
    trial = run_trial(ICP, "small_60", 0)
    assert (trial.verdict, trial.right) == ("crashed", False)
    assert "small_60 seed 0: ZeroDivisionError: on purpose" in capsys.readouterr().err
    assert "CRASHED: 1 trials" in accuracy.report([trial], ["small_60"])


def test_trials_survive_their_file(tmp_path):
    path = tmp_path / "trials.csv"
    trials = [TRIAL, replace(TRIAL, seed=2, right=False, verdict="ambiguous", error=0.25, failure_probability=0.125)]
    write_header(path)
    for trial in trials:
        append(path, trial)
    write_header(path)
    assert repr(read_trials([path])) == repr(trials)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(UsageError, match=r"trials\.csv"):
        read_trials([path])


def test_an_interrupted_run_goes_on(tmp_path, monkeypatch, capsys):
    out = tmp_path / "trials.csv"
    arguments = ["accuracy", "--family", "small_60", "--jobs", "1", "--out", str(out), "--seeds"]
    monkeypatch.setattr(sys, "argv", [*arguments, "1"])
    assert accuracy.main() == 0
    first = out.read_text()
    monkeypatch.setattr(sys, "argv", [*arguments, "2"])
    assert accuracy.main() == 0
    assert out.read_text().startswith(first)
    assert [trial.seed for trial in read_trials([out])] == [0, 1]
    monkeypatch.setattr(sys, "argv", [*arguments, "2", "--start", "identity"])
    assert accuracy.main() == 2
    assert "holds trials of icp from coarse" in capsys.readouterr().err


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


def test_the_plan_hands_on_the_prior():
    assert plan(ICP).options.georeference_sd is None
    assert plan(replace(ICP, georeference_sd=3.0)).options.georeference_sd == 3.0


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


def test_trials_from_near_starts_say_so():
    icp = replace(ICP, start="near")
    assert run_trial(icp, "small_60", 0).near_start
    assert not run_trial(replace(ICP, start="identity"), "small_60", 0).near_start
    assert not run_trial(ICP, "different", 0).near_start


def test_methods_stand_side_by_side(tmp_path, monkeypatch, capsys):
    aco = replace(TRIAL, method="aco", start="identity", error=0.6, fit_error=0.01)
    trials = [replace(TRIAL, error=0.02, fit_error=0.01), replace(TRIAL, seed=2, right=False, error=2.0)]
    trials += [aco, replace(aco, seed=2, error=0.4), replace(aco, seed=3, near_start=False, right=False, error=9.0)]
    trials += [replace(TRIAL, family="periodic_turn", right=False, near_start=False, verdict="ambiguous")]
    path = tmp_path / "trials.csv"
    write_header(path)
    for trial in trials:
        append(path, trial)
    monkeypatch.setattr(sys, "argv", ["methods", str(path)])
    assert methods.main() == 0
    lines = {line.split("  ")[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines() if line}
    assert lines["family"] == ["coarse", "icp", "identity", "aco", "of", "these", "near", "aco"]
    assert lines["shift_3"] == ["(2)", "50.0", "[1]", "(3)", "66.7", "[1]", "(2)", "100.0"]
    assert lines["all absent"][1:] == ["(1)", "0.0", "(0)", "-", "(0)", "-"]
    assert " ".join(lines["coarse: icp"][1:]) == "2 50.0 % 50.0 % 2.00 0.0 % 1 90.55 % 0 nan"
    assert lines["identity: aco"][1:5] == ["3", "66.7", "%", "33.3"]
    assert lines["identity, near: aco"][2:6] == ["2", "100.0", "%", "50.0"]


def write(path, trials):
    write_header(path)
    for trial in trials:
        append(path, trial)


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
    lines = comparison.report([*wrong, *right, replace(TRIAL, family="different")]).splitlines()[2:]
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
