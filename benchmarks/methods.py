"""Methods and starts side by side, as tables of Markdown over files of trials.

    python -m benchmarks.accuracy --method aco+icp --start near --out near.csv
    python -m benchmarks.methods near.csv coarse.csv identity.csv

Reads what `benchmarks.accuracy --out` or `treereg evaluate` wrote, any number of files with simulated trials of any
methods and starts.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterable, Sequence

from benchmarks.given import trials_given
from benchmarks.pages import markdown
from benchmarks.starts import GROUPS, NEAR, PREFIX
from treereg_core.evaluation import Trial
from treereg_core.evaluation.page import in_words, silent_in_words
from treereg_core.evaluation.summary import ALL, Line
from treereg_core.evaluation.trial import CRASHED

OVERALL = (
    *("start", "method", "trials", "right", "silent", "flagged", "error / best fit", "coverage", "crashed", "seconds"),
)
LEGEND = """\
Right: an error below 0.5 m or 1.25 times that of the fit with the true pairs. Silent: accepted though wrong, a count of
all trials, those without a truth too, and the 95 % upper bound of its share among the accepted. Flagged: not accepted
though right, share of the right. Error / best fit: the median error of the right over that of the fit with the true
pairs. Coverage: how often the 95 % interval of the expected error holds the true one, among the right. Seconds: median
on one thread. In square brackets 95 % intervals (Wilson)."""
CELLS = "Per cent of the trials that are right, and in brackets how many are accepted though wrong."


def main() -> int:
    """Print the tables."""
    trials = trials_given("benchmarks.methods", __doc__)
    print(tables(trials))
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def tables(trials: Sequence[Trial]) -> str:
    """One table over all trials with a truth, then for each start a table of the families."""
    parts = ["### All families with a truth", overall(trials), LEGEND]
    for start in dict.fromkeys(map(begun, trials)):
        parts += [f"### From `{start}`", by_family([trial for trial in trials if begun(trial) == start]), CELLS]
    return "\n\n".join(parts)


def begun(trial: Trial) -> str:
    """Its start; `near` for the identity after the source was laid anew."""
    return NEAR if trial.name.startswith(PREFIX) else trial.start


def overall(trials: Iterable[Trial]) -> str:
    """A line per start and method."""
    groups: dict[str, dict[str, list[Trial]]] = {}
    for trial in trials:
        groups.setdefault(begun(trial), {}).setdefault(trial.method, []).append(trial)
    rows = []
    for start, method, every in ((start, *one) for start, by_method in groups.items() for one in by_method.items()):
        line = Line.of([trial for trial in every if GROUPS[trial.name] != "absent"] or every, ALL)
        rows.append(
            (
                *(f"`{start}`", f"`{method}`", str(line.trials), in_words(line.right)),
                *(silent_in_words(Line.of(every, ALL)), in_words(line.flagged)),
                f"{line.ratio:.2f}" if line.ratio is not None else "-",
                *(in_words(line.covered), str(line.crashed)),
                f"{line.seconds:.2f}" if line.seconds is not None else "-",
            )
        )
    return markdown(OVERALL, rows, 2)


def by_family(trials: Sequence[Trial]) -> str:
    """A line per family, each group's own line below its families, and a column per method."""
    methods = list(dict.fromkeys(trial.method for trial in trials))
    names = [name for name in GROUPS if any(trial.name == name for trial in trials)]
    parts = []
    for group in dict.fromkeys(GROUPS[name] for name in names):
        mine = [name for name in names if GROUPS[name] == group]
        parts += [(f"`{name}`", [name]) for name in mine] + [(f"**all {group}**", mine)]
    rows = []
    for title, some in parts:
        inside = [trial for trial in trials if trial.name in some]
        by_method = [[trial for trial in inside if trial.method == method] for method in methods]
        rows.append((title, str(max(map(len, by_method))), *map(cell, by_method)))
    return markdown(("family", "trials", *(f"`{method}`" for method in methods)), rows, 1)


def cell(trials: Sequence[Trial]) -> str:
    """The share right, and how many are wrong in silence; no share where there is no truth."""
    if not trials:
        return "-"
    share = "-" if GROUPS[trials[0].name] == "absent" else f"{100 * statistics.fmean(t.right for t in trials):.1f}"
    return f"{share} ({sum(trial.silent for trial in trials)})"


if __name__ == "__main__":
    sys.exit(main())
