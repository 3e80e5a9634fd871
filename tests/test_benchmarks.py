"""The benchmarks' own arithmetic: a table that lies would be worse than none."""

import math
import sys
from dataclasses import replace

import pytest

from benchmarks import accuracy, calibration
from benchmarks.table import upper_bound, wilson
from benchmarks.trial import Conditions, Trial, append, is_right, plan, read_trials, run_trial, write_header
from treereg_core.errors import UsageError

ICP = Conditions("icp", "coarse", math.inf)
TRIAL = Trial(**vars(ICP), family="shift_3", seed=1, trees=100, verdict="accepted", right=True, bend=0.0)


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
