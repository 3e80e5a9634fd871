"""Methods against each other, family by family, with how far each figure could be due to chance.

    python -m benchmarks.accuracy --method aco+icp --seeds 50 --out aco-icp.csv  # and so on
    python -m benchmarks.comparison *.csv --against icp --against aco

Reads what `benchmarks.accuracy --out` wrote. Of each family only the seeds that all methods tried count. Every method
is also compared, seed by seed, with the best of those given with `--against`, all when none are: the one that is right
most often there, and of several the one with the least RMS error. Chosen for having done best, it has luck on its side.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.given import read_trials
from benchmarks.starts import GROUPS
from benchmarks.table import percent, table
from treereg_core.errors import UsageError
from treereg_core.evaluation import Trial
from treereg_core.evaluation.trial import CRASHED
from treereg_core.statistics import wilson
from treereg_core.transform import FloatArray

DRAWS = 2000
HEADER = ("family", "method", "trials", "right", "95 %", "silent", "ratio", "95 %", "to best", "95 %", "won", "lost")
LEGEND = """\
right        share of the trials, with its Wilson interval; silent: accepted though wrong, a count
ratio        median error of the right over that of the fit with true pairs, with its bootstrap interval
to best      RMS of the errors over that of the best method of those compared with (*), where both are right, with its
             bootstrap interval; an error near 0 is luck, and counts no more than it should
won, lost    trials that are right here and not there, and the other way round"""

Task = tuple[str, int]
ByTask = Mapping[Task, Trial]
Statistic = Callable[[FloatArray], FloatArray]


def main() -> int:
    """Print a table for each start."""
    parser = argparse.ArgumentParser(
        "benchmarks.comparison", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.csv", help="trials from benchmarks.accuracy --out")
    parser.add_argument("--against", action="append", metavar="EXPR", help="compare with the best of these; repeatable")
    options = parser.parse_args()
    try:
        trials = read_trials(options.files)
    except UsageError as error:
        print(error, file=sys.stderr)
        return 2
    for start in dict.fromkeys(trial.start for trial in trials):
        print(f"From {start}:\n\n{report([t for t in trials if t.start == start], options.against)}\n")
    print(LEGEND)
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def report(trials: Sequence[Trial], against: Sequence[str] | None = None) -> str:
    """The table of trials from one start; families without a truth have nothing to compare, and are left out."""
    names = [name for name in GROUPS if any(trial.name == name for trial in trials)]
    names = [name for name in names if GROUPS[name] != "absent"]
    parts = [(name, [name]) for name in names]
    for group in dict.fromkeys(GROUPS[name] for name in names):
        parts.append((f"all {group}", [name for name in names if GROUPS[name] == group]))
    lines = []
    for title, families in parts:
        tried = shared([trial for trial in trials if trial.name in families])
        best = best_of({method: tried[method] for method in tried if not against or method in against} or tried)
        for method, by_task in tried.items():
            lines.append((title, *line(method, by_task, None if method == best else tried[best])))
    return table(HEADER, lines)


def shared(trials: Iterable[Trial]) -> dict[str, ByTask]:
    """By method, the trials of the families and seeds that all methods tried."""
    tried: dict[str, dict[Task, Trial]] = {}
    for trial in trials:
        tried.setdefault(trial.method, {})[trial.name, trial.seed] = trial
    tasks = sorted(set.intersection(*(set(by_task) for by_task in tried.values())))
    return {method: {task: by_task[task] for task in tasks} for method, by_task in tried.items()}


def best_of(tried: Mapping[str, ByTask]) -> str:
    """The method that is right most often, and of several the one with the least RMS error."""

    def quality(method: str) -> tuple[int, float]:
        square = [trial.error**2 for trial in tried[method].values() if trial.right]
        return len(square), -float(np.mean(square)) if square else 0.0

    return max(tried, key=quality)


def line(method: str, by_task: ByTask, best: ByTask | None) -> tuple[str, ...]:
    """The cells of a method, compared with the best one; `None` where it is the best itself."""
    right = np.array([(t.error, t.fit_error) for t in by_task.values() if t.right]).reshape(-1, 2)
    low, high = wilson(len(right), len(by_task))
    paired, won, lost = ("*", ""), "", ""
    if best is not None:
        both = [(t.error, best[task].error) for task, t in by_task.items() if t.right and best[task].right]
        paired = with_interval(np.array(both).reshape(-1, 2), of_rms)
        won = str(sum(t.right and not best[task].right for task, t in by_task.items()))
        lost = str(sum(best[task].right and not t.right for task, t in by_task.items()))
    return (
        method,
        str(len(by_task)),
        percent(len(right), len(by_task)),
        f"{100 * low:.1f} to {100 * high:.1f} %",
        str(sum(t.silent for t in by_task.values())),
        *with_interval(right, of_medians),
        *paired,
        won,
        lost,
    )


def of_medians(pairs: FloatArray) -> FloatArray:
    """The ratio of the medians of pairs of errors (..., n, 2)."""
    median = np.median(pairs, axis=-2)
    return np.asarray(median[..., 0] / median[..., 1])


def of_rms(pairs: FloatArray) -> FloatArray:
    """The ratio of the root mean squares of pairs of errors (..., n, 2)."""
    square = (pairs**2).mean(axis=-2)
    return np.asarray(np.sqrt(square[..., 0] / square[..., 1]))


def with_interval(pairs: FloatArray, statistic: Statistic) -> tuple[str, str]:
    """A statistic of pairs of errors (n, 2) and its 95 % interval, as cells; dashes where there are none.

    By the bootstrap (Efron 1979, doi:10.1214/aos/1176344552) with percentiles, from a fixed seed.
    """
    if not len(pairs):
        return "-", "-"
    drawn = np.random.default_rng(0).integers(len(pairs), size=(DRAWS, len(pairs)))
    low, high = np.quantile(statistic(pairs[drawn]), (0.025, 0.975))
    return f"{float(statistic(pairs)):.2f}", f"{low:.2f} to {high:.2f}"


if __name__ == "__main__":
    sys.exit(main())
