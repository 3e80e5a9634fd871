"""How often the result is right, wrong in silence, or flagged though right, over families of simulated surveys.

    python -m benchmarks.accuracy --group ordinary --seeds 400 --out ordinary.csv

`treereg evaluate` on simulated surveys, with another table and one start more. Every trial is written as it finishes,
and a file may hold trials of several methods and starts; the same command goes on where it was interrupted. `--start
identity` shows plain matching from the files' own georeference, and gives many wrong placements for
`benchmarks.calibration`. `--start near` does too, once each source was laid anew so that no row end lies further from
its true place than 0.4 of the row spacing across the rows and two in-row spacings along them (families with a truth
only, each under the name `near NAME`). Exit code 1 when a trial crashed.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.processes import told
from benchmarks.starts import GROUPS, NEAR, Near
from benchmarks.table import percent, table
from treereg_core.cli.evaluate import families_of, setups_of
from treereg_core.errors import TreeregError
from treereg_core.evaluation import Families, Study, Trial, run_all
from treereg_core.evaluation.case import Source
from treereg_core.evaluation.page import label
from treereg_core.evaluation.summary import Line
from treereg_core.evaluation.trial import CRASHED
from treereg_core.options import defaults
from treereg_core.plan import IDENTITY
from treereg_core.simulate import FAMILIES

HEADER = ("family", "trials", "right", "silent", "flagged", "failed", "error", "fit", "ratio", "coverage", "seconds")
LEGEND = """\
right     share of all trials with an error below 0.5 m or 1.25 times that of the fit with true pairs
silent    accepted though wrong, a count
flagged   not accepted though right, share of the right
failed    without a placement, share of all trials
error     median true error of the right, metres; fit: the same of the fit with true pairs; ratio: of the two
coverage  how often the 95 % interval of the expected error holds the true one, among the right
seconds   median on one thread, simulation apart"""


def main() -> int:
    """Run the trials that are missing and print a table for each method."""
    options = arguments()
    near = options.start == NEAR
    names = families_of([*(options.family or ()), *(options.group or ())] or list(FAMILIES))
    source: Source = Near(names) if near else Families(names)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    try:
        how = (options.method or [defaults()["method"]], [IDENTITY if near else options.start])
        study = Study(source, setups_of({"georeference_sd": options.georeference_sd, "settings": {}}, how, None), seeds)
        trials = run_all(study, options.out, options.jobs, told)
    except TreeregError as error:
        print(error, file=sys.stderr)
        return 2
    by_label: dict[str, list[Trial]] = {}
    for trial in trials:
        by_label.setdefault(label(trial), []).append(trial)
    for name, some in by_label.items():
        print(f"{name}\n\n{report(some)}\n")
    print(LEGEND)
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        "benchmarks.accuracy", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    groups = list(dict.fromkeys(family.group for family in FAMILIES.values()))
    start, add = defaults()["start"], parser.add_argument
    add("--family", action="append", choices=list(FAMILIES), metavar="NAME", help="repeatable; default: all")
    add("--group", action="append", choices=groups, help="all families of a group; repeatable")
    add("--seeds", type=int, default=20, metavar="N", help="trials of each family (default 20)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--method", action="append", metavar="EXPR", help="repeatable; default: that of treereg run")
    add("--start", default=start, metavar="NAME", help="default: that of treereg run; or identity, or near")
    add("--georeference-sd", type=float, metavar="METRES", help="as in treereg run")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    add("--out", type=Path, metavar="FILE.csv", help="one row per trial; trials that it already holds are not repeated")
    return parser.parse_args()


def report(trials: Sequence[Trial]) -> str:
    """The table of one method and start, with a line for each group."""
    names = [name for name in GROUPS if any(trial.name == name for trial in trials)]
    rows = [line(name, [t for t in trials if t.name == name]) for name in names]
    for group in dict.fromkeys(GROUPS[name] for name in names):
        rows.append(line(f"all {group}", [t for t in trials if GROUPS[t.name] == group]))
    crashed = sum(trial.verdict == CRASHED for trial in trials)
    warning = f"\nCRASHED: {crashed} trials, counted as not right." if crashed else ""
    return f"{table(HEADER, rows)}{warning}"


def line(name: str, trials: Sequence[Trial]) -> tuple[str, ...]:
    """One line of the table."""
    of = Line.of(trials, name)
    right = [trial for trial in trials if trial.right]
    error = statistics.median(t.error for t in right) if right else math.nan
    fit = statistics.median(t.fit_error for t in right) if right else math.nan
    return (
        name,
        str(of.trials),
        percent(of.right.count, of.right.of),
        str(of.silent),
        percent(of.flagged.count, of.flagged.of),
        percent(of.failed.count, of.failed.of),
        f"{error:.3f}" if right else "-",
        f"{fit:.3f}" if right else "-",
        f"{error / fit:.2f}" if right else "-",
        percent(of.covered.count, of.covered.of),
        f"{of.seconds:.2f}" if of.seconds is not None else "-",
    )


if __name__ == "__main__":
    sys.exit(main())
