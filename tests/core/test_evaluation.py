"""The harness of evaluations: cases, trials, their log, and what they say together."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from treereg_core.errors import InputError, UsageError
from treereg_core.evaluation import Families, Misregistered, Study, Trial, run_all, run_trial
from treereg_core.evaluation.log import Log, read
from treereg_core.evaluation.plots import Axis
from treereg_core.evaluation.summary import ALL, Share, summed_up
from treereg_core.evaluation.trial import CRASHED
from treereg_core.method import silent
from treereg_core.options import Options
from treereg_core.simulate import Scene, simulate
from treereg_core.statistics import bootstrap, median, wilson
from treereg_core.transform import Rigid

ICP = Options(method="icp")
FROM_IDENTITY = Options(method="icp", start="identity")


def trial(**changes: object) -> Trial:
    base = {
        "method": "icp",
        "start": "coarse",
        "setup": "0",
        "name": "noisy",
        "seed": 0,
        "trees": 100,
        "rotation_deg": 1.0,
        "translation_m": 2.0,
        "misplaced": 2.5,
        "verdict": "accepted",
        "right": True,
        "error": 0.02,
        "fit_error": 0.02,
        "figures": {"truth.placed": 1.0},
    }
    return Trial(**{**base, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def surveys() -> Misregistered:
    made = simulate(Scene(trees=300, jitter=0.1, area_persistence=0.9), 2)
    assert made.truth is not None
    return Misregistered("here", made.reference, made.source.replace(xy=made.truth(made.source.xy)), 1.0, 3.0)


def test_a_misregistered_case_is_undone_by_its_truth(surveys: Misregistered) -> None:
    case = surveys.case("here", 7)
    assert case.problem.truth is not None
    assert np.allclose(case.problem.truth(case.problem.source.xy), surveys.source.xy)
    assert case.error(case.problem.truth) == pytest.approx(0, abs=1e-9)
    assert case.error(Rigid.identity()) > 0.5
    again = surveys.case("here", 7)
    assert np.array_equal(again.problem.source.xy, case.problem.source.xy)
    assert not np.array_equal(surveys.case("here", 8).problem.source.xy, case.problem.source.xy)


def test_misregistrations_are_as_large_as_asked_for(surveys: Misregistered) -> None:
    sizes = np.array([surveys.case("here", seed).misplaced for seed in range(300)])
    assert np.sqrt(np.mean(sizes[:, 0] ** 2)) == pytest.approx(1.0, rel=0.15)
    # two axes of 3 m each
    assert np.sqrt(np.mean(sizes[:, 1] ** 2)) == pytest.approx(3.0 * np.sqrt(2), rel=0.15)


def test_a_family_brings_its_truth() -> None:
    source = Families(("small_150", "different"))
    found = run_trial(ICP, source.case("small_150", 3))
    assert found.right
    assert 0 < found.error < 0.2
    assert found.ci_low < found.expected_rms < found.ci_high
    assert 0 < found.seconds < 60
    case = source.case("different", 3)
    assert not case.right(Rigid.identity())
    assert math.isnan(run_trial(FROM_IDENTITY, case).error)


def test_every_method_and_start_gets_the_same_trials(surveys: Misregistered) -> None:
    study = Study(surveys, (ICP, FROM_IDENTITY), range(3))
    done = run_all(study, None, 1, silent)
    assert [(t.method, t.start, t.seed) for t in done] == [
        ("icp", s, k) for s in ("coarse", "identity") for k in range(3)
    ]
    first, second = done[:3], done[3:]
    assert [t.misplaced for t in first] == [t.misplaced for t in second]
    assert all(t.right and t.accepted for t in first)
    assert all(t.figures["truth.error_m"] == pytest.approx(t.error) for t in first)


def test_an_interrupted_study_goes_on(surveys: Misregistered, tmp_path: Path) -> None:
    log = tmp_path / "trials.csv"
    whole = run_all(Study(surveys, (ICP,), range(3)), None, 1, silent)
    run_all(Study(surveys, (ICP,), range(2)), log, 1, silent)
    content = log.read_bytes()
    log.write_bytes(content[:-20])  # cut off in the last row
    told: list[str] = []
    done = run_all(Study(surveys, (ICP,), range(3)), log, 1, told.append)
    assert told[-1].startswith("2 of 2")
    assert [t.seed for t in done] == [0, 1, 2]
    assert [(t.verdict, t.error, t.matched) for t in done] == [(t.verdict, t.error, t.matched) for t in whole]
    assert len(read(log)[1]) == 3


def test_trials_survive_the_log(tmp_path: Path) -> None:
    study = Study(Families(("noisy",)), (ICP,), range(1))
    one, other = trial(setup="x"), trial(seed=1, error=math.nan, verdict="failed", right=False, figures={})
    Log(tmp_path / "log.csv", study).append([one, other])
    found = read(tmp_path / "log.csv")[1]
    # NaN equals nothing, so the texts are compared
    assert repr(found[0]) == repr(one)
    other = trial(seed=1, error=math.nan, verdict="failed", right=False, figures={"truth.placed": math.nan})
    assert repr(found[1]) == repr(other)


def test_a_log_of_something_else_is_refused(surveys: Misregistered, tmp_path: Path) -> None:
    log = tmp_path / "trials.csv"
    run_all(Study(surveys, (ICP,), range(1)), log, 1, silent)
    tighter = ICP.model_copy(update={"max_failure": 0.5})
    with pytest.raises(UsageError, match="under other options"):
        run_all(Study(surveys, (tighter,), range(1)), log, 1, silent)
    with pytest.raises(UsageError, match="under other options"):
        run_all(Study(Families(("noisy",)), (ICP,), range(1)), log, 1, silent)
    for text in ("a,b\n1,2\n", "method\n\n", "\x00\n"):
        log.write_text(text)
        with pytest.raises(UsageError, match="not a file of trials"):
            run_all(Study(surveys, (ICP,), range(1)), log, 1, silent)
    with pytest.raises(InputError, match="cannot be written"):
        run_all(Study(surveys, (ICP,), range(1)), tmp_path, 1, silent)


def test_a_crash_is_a_trial_and_is_tried_again(
    surveys: Misregistered, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def crash(*arguments: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr("treereg_core.evaluation.trial.execute", crash)
    found = run_trial(ICP, surveys.case("here", 0))
    assert found.verdict == CRASHED
    assert "here seed 0: RuntimeError: boom" in capsys.readouterr().err


def test_lines_say_how_often_and_how_far() -> None:
    trials = [
        *(trial(seed=k, error=0.01 * (k + 1), ci_low=0.015, ci_high=0.065) for k in range(8)),
        trial(seed=8, error=3.0, right=False, figures={"truth.placed": 0.75}),
        trial(seed=9, verdict="failed", right=False, error=math.nan, figures={"truth.placed": 0.0}),
    ]
    (line,) = summed_up(trials)
    assert (line.right.count, line.right.of, line.silent) == (8, 10, 1)
    assert line.right.ci95 == wilson(8, 10)
    assert (line.failed.count, line.flagged.count) == (1, 0)
    assert (line.covered.count, line.covered.of) == (5, 8)
    assert line.to_json()["interval_holds_error"]["share"] == 5 / 8
    assert line.error is not None
    assert line.error.median == pytest.approx(0.05)
    assert line.ratio == pytest.approx(0.045 / 0.02)
    assert {level: share.count for level, share in line.milestones.items()} == {0.7: 9, 0.8: 8, 0.9: 8, 0.95: 8}
    low, high = line.error.median_ci95
    assert low < line.error.median < high


def test_names_are_also_summed_up_together() -> None:
    lines = summed_up([trial(), trial(name="curved"), trial(method="aco", name="curved")])
    assert [(line.method, line.name) for line in lines] == [
        *(("icp", name) for name in ("noisy", "curved", ALL)),
        ("aco", "curved"),
    ]


def test_intervals() -> None:
    values = np.random.default_rng(0).normal(5, 1, 400)
    low, high = bootstrap(values, median)
    # the median of n normal values has a standard error of 1.253 over the root of n
    assert high - low == pytest.approx(2 * 1.96 * 1.253 / 20, rel=0.25)
    assert bootstrap(values, median) == (low, high)
    assert Share(0, 0).to_json()["share"] is None


def test_axes() -> None:
    axis = Axis(0.001, 10, (0, 400), logarithmic=True)
    assert axis(0.1) == pytest.approx(200)
    assert axis(1e9) == 400
    assert axis.ticks == [0.001, 0.01, 0.1, 1, 10]
    assert Axis(0, 1, (100, 0)).ticks == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
