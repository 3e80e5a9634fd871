"""Methods and starts side by side: one table over files of trials.

    python -m benchmarks.accuracy --method aco+icp --start near --out near.csv
    python -m benchmarks.methods near.csv coarse.csv identity.csv

Reads what `benchmarks.accuracy --out` wrote, any number of files with trials of any methods and starts.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Iterable, Sequence
from itertools import groupby

from benchmarks.table import percent, table
from benchmarks.trial import CRASHED, RIGHT_M, Trial, trials_given
from treereg_core.plan import IDENTITY
from treereg_core.simulate import FAMILIES
from treereg_core.statistics import upper_bound

LEGEND = f"""\
Share of trials that are right, in per cent, by start and method; [n]: so many are accepted and wrong, in silence.
coarse    from the global search
identity  from the files' own georeference, as the families have it
near      from the files' own georeference, the source laid anew so that no row end lies further from its true place
          than 0.4 of the row spacing across the rows and two in-row spacings along them; "of these near" are the
          trials from the identity, (so many), in which that holds as it is
In the second table `within {RIGHT_M} m` is the share with a true error below that; ratio: the median error of the right
against that of the fit with true pairs; flagged: not accepted though right, share of the right."""

Column = tuple[str, str, bool]
"""Start, method, and whether only trials with a near start count."""


def main() -> int:
    """Print the tables."""
    trials = trials_given("benchmarks.methods", __doc__)
    print(f"{by_family(trials)}\n\n{overall(trials)}\n\n{LEGEND}")
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def columns(trials: Iterable[Trial]) -> list[Column]:
    """Every start and method that was tried, in the order in which they come; the identity's near trials once more."""
    found = list(dict.fromkeys((trial.start, trial.method) for trial in trials))
    starts = list(dict.fromkeys(start for start, _ in found))
    blocks = [(start, near) for start in starts for near in ([False, True] if start == IDENTITY else [False])]
    return [(start, method, near) for start, near in blocks for of_start, method in found if of_start == start]


def of(column: Column, trials: Iterable[Trial]) -> list[Trial]:
    """The trials of a column."""
    start, method, near = column
    return [t for t in trials if (t.start, t.method) == (start, method) and (t.near_start or not near)]


def by_family(trials: Sequence[Trial]) -> str:
    """A line per family and group, a column per start and method; trials with a near start apart."""
    names = [name for name in FAMILIES if any(trial.family == name for trial in trials)]
    parts = [(name, [trial for trial in trials if trial.family == name]) for name in names]
    for group in dict.fromkeys(FAMILIES[name].group for name in names):
        parts.append((f"all {group}", [trial for trial in trials if FAMILIES[trial.family].group == group]))
    parts.append(("all with a truth", with_truth(trials)))

    header, lines = ["family"], [[name] for name, _ in parts]
    for (start, near), of_block in groupby(columns(trials), key=lambda column: (column[0], column[2])):
        block = list(of_block)
        header += ["of these near" if near else start, *(method for _, method, _ in block)]
        for line, (_, part) in zip(lines, parts, strict=True):
            inside = [of(column, part) for column in block]
            line += [f"({max(map(len, inside))})", *map(cell, inside)]
    return table(header, lines)


def with_truth(trials: Iterable[Trial]) -> list[Trial]:
    """The trials in which there is a placement to be found."""
    return [trial for trial in trials if FAMILIES[trial.family].group != "absent"]


def cell(trials: Sequence[Trial]) -> str:
    """The share right, and how many are wrong in silence."""
    if not trials:
        return "-"
    silent = sum(trial.accepted and not trial.right for trial in trials)
    return f"{100 * statistics.fmean(trial.right for trial in trials):.1f}" + (f" [{silent}]" if silent else "")


def overall(trials: Sequence[Trial]) -> str:
    """A line per start and method over all families that have a truth."""
    lines = []
    for column in columns(trials):
        inside = of(column, with_truth(trials))
        right = [trial for trial in inside if trial.right]
        silent = sum(trial.accepted and not trial.right for trial in inside)
        accepted = sum(trial.accepted for trial in inside)
        error = statistics.median(trial.error for trial in right) if right else math.nan
        fit = statistics.median(trial.fit_error for trial in right) if right else math.nan
        lines.append(
            (
                f"{column[0]}{', near' if column[2] else ''}: {column[1]}",
                str(len(inside)),
                percent(len(right), len(inside)),
                percent(sum(trial.error < RIGHT_M for trial in inside), len(inside)),
                f"{error / fit:.2f}" if right else "-",
                percent(sum(not trial.accepted for trial in right), len(right)),
                str(silent),
                f"{100 * upper_bound(silent, accepted):.2f} %" if accepted else "-",
                str(sum(trial.verdict == CRASHED for trial in inside)),
                f"{statistics.median(trial.seconds for trial in inside):.2f}" if inside else "-",
            )
        )
    header = ("start: method", "trials", "right", f"within {RIGHT_M} m", "ratio", "flagged", "silent", "at most")
    return table((*header, "crashed", "seconds"), lines)


if __name__ == "__main__":
    sys.exit(main())
