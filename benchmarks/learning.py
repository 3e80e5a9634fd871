"""Learning: what a memory brings from survey to survey, and what a hostile survey in it costs.

    python -m benchmarks.learning --seeds 50

Each orchard is surveyed six times, in noise, with trees that are missed again and again, die and are replanted. Five
surveys are registered onto the first, in order, with a memory; each also without one, so that all differences are of
the very same pairs. In two more series the fourth survey is a hostile one, or one that is accepted a row off.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.learning_trial import FIRST, SPOILT, SURVEYS, Measured, Trial, run
from benchmarks.processes import spread
from benchmarks.table import table
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

RESAMPLED = 2000
COMPARED = (
    ("memory", "none"),
    ("hostile", "none"),
    ("hostile", "memory"),
    ("astray", "none"),
    ("astray", "memory"),
)
HEADER = ("", "survey", "before", "after", "difference", "95 % interval")
LEGEND = """\
memory - none       with a memory of the surveys before, against without one
hostile - none      with a memory that learned from a hostile survey, number {spoilt}, against without one
hostile - memory    the same, against a memory that learned from the survey as it was: how far it is set back
astray - ...        the same of a survey that is a row off, learned from as if it was accepted
first to last       what the last survey has over the first, without a memory and with one

before and after are the two sides of each difference. The intervals are of the difference, from {resampled} bootstrap
samples of the orchards (Efron 1979, doi:10.1214/aos/1176344552)."""


@dataclass(frozen=True)
class Figure:
    """A figure of one survey over many orchards: `of(measured, counts)` with each orchard counted so often (b, n)."""

    title: str
    form: str
    of: Callable[[Sequence[Measured], IntArray], FloatArray]


def mean_of(name: str) -> Callable[[Sequence[Measured], IntArray], FloatArray]:
    """The mean of one value."""

    def mean(measured: Sequence[Measured], counts: IntArray) -> FloatArray:
        values = np.array([getattr(one, name) for one in measured])
        return np.asarray(counts @ values / counts.sum(axis=1))

    return mean


def calibration(measured: Sequence[Measured], counts: IntArray) -> FloatArray:
    """The expected calibration error of all trees together."""
    bins = np.stack([one.bins for one in measured])
    gap = counts @ (bins[..., 1] - bins[..., 2])
    return np.asarray(np.abs(gap).sum(axis=1) / (counts @ bins[..., 0].sum(axis=1)))


def error_ratio(measured: Sequence[Measured], counts: IntArray) -> FloatArray:
    """The RMS error over that of the fit with the true pairs."""
    error, best = (np.array([getattr(one, name) ** 2 for one in measured]) for name in ("error", "best"))
    return np.asarray(np.sqrt((counts @ error) / (counts @ best)))


FIGURES = (
    Figure("precision: the share of the chosen fifth that both surveys show", ".4f", mean_of("precision")),
    Figure("Brier score of the probabilities of all trees", ".4f", mean_of("brier")),
    Figure("expected calibration error of these", ".4f", calibration),
    Figure("error of bn_landmarks+icp over that of the fit with true pairs, RMS", ".3f", error_ratio),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the series and print the tables. Exit code 1 when a registration that was to be right was not."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.learning",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, default=50, metavar="N", help="orchards (default 50)")
    parser.add_argument("--first-seed", type=int, default=5000, metavar="K", help="seeds from here on (default 5000)")
    parser.add_argument("--dead", type=float, default=0.02, metavar="SHARE", help="dying per survey (default 0.02)")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    trials = list(spread(run, [(seed, options.dead) for seed in seeds], options.jobs))
    print(report(trials))
    return 1 if wrong(trials) else 0


def report(trials: Sequence[Trial]) -> str:
    """All tables, and what they mean."""
    # Trials come in the order in which they finish; the figures must not depend on it.
    trials = sorted(trials, key=lambda trial: trial.seed)
    parts = [f"{figure.title}\n{table(HEADER, lines(trials, figure))}" for figure in FIGURES]
    legend = LEGEND.format(spoilt=SPOILT + 1, resampled=f"{RESAMPLED:,}")
    return "\n\n".join([*parts, legend, verdicts(trials)])


def lines(trials: Sequence[Trial], figure: Figure) -> list[tuple[str, ...]]:
    """The lines of one figure's table."""
    n = len(trials)
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), RESAMPLED)
    counts = np.concatenate([np.ones((1, n), dtype=np.int64), drawn])

    def values(kind: str, survey: int) -> FloatArray:
        return figure.of([trial.found[kind][survey] for trial in trials], counts)

    found = []
    for kind, against in COMPARED:
        surveys = range(FIRST if kind == "memory" else SPOILT + 1, SURVEYS)
        for survey in surveys:
            both = values(against, survey), values(kind, survey)
            found.append(line(f"{kind} - {against}", str(survey + 1), figure.form, both))
    last = SURVEYS - 1
    changes = values("none", last) - values("none", FIRST), values("memory", last) - values("memory", FIRST)
    found.append(line("first to last", f"{FIRST + 1} to {last + 1}", figure.form, changes))
    return found


def line(name: str, survey: str, form: str, both: tuple[FloatArray, FloatArray]) -> tuple[str, ...]:
    """One line: both values, their difference and its interval; the first of each is the estimate."""
    before, after = both
    difference = after - before
    low, high = np.quantile(difference[1:], (0.025, 0.975))
    signed = "+" + form
    return (
        name,
        survey,
        format(before[0], form),
        format(after[0], form),
        format(difference[0], signed),
        f"{low:{signed}} to {high:{signed}}",
    )


def wrong(trials: Sequence[Trial]) -> int:
    """How many registrations are not right, those of the astray surveys aside."""
    return sum(
        not one.right
        for trial in trials
        for kind, surveys in trial.found.items()
        for survey, one in surveys.items()
        if (kind, survey) != ("astray", SPOILT)
    )


def verdicts(trials: Sequence[Trial]) -> str:
    """What the judge said of the surveys that spoil, and whether all others came out right."""
    n = len(trials)
    accepted = {kind: sum(trial.found[kind][SPOILT].accepted for trial in trials) for kind in ("hostile", "astray")}
    return (
        f"The judge accepts {accepted['hostile']} of {n} hostile surveys and {accepted['astray']} of {n} astray ones "
        f"by itself.\nOf all other registrations, {wrong(trials)} are not right."
    )


if __name__ == "__main__":
    sys.exit(main())
