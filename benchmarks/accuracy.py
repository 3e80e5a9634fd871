"""How often the result is right, wrong in silence, or flagged though right, over families of simulated surveys.

    python -m benchmarks.accuracy --group ordinary --seeds 400 --out ordinary.csv

Every trial is written as it finishes; the same command goes on where it was interrupted. `--start identity` shows plain
matching from the files' own georeference, and gives many wrong placements for `benchmarks.calibration`. `--start near`
does too, once each source was laid anew so that no row end lies further from its true place than 0.4 of the row spacing
across the rows and two in-row spacings along them (families with a truth only). Exit code 1 when a trial crashed.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from benchmarks.processes import spread
from benchmarks.table import percent, table
from benchmarks.trial import CRASHED, NEAR, Conditions, Trial, append, plan, read_trials, run_trial, write_header
from treereg_core.errors import TreeregError, UsageError
from treereg_core.options import defaults
from treereg_core.simulate import FAMILIES

Task = tuple[str, int]
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
    """Run the trials that are missing and print the table."""
    options = arguments()
    conditions = Conditions(options.method, options.start, options.georeference_sd)
    names = list(chosen(options.family, options.group))
    if options.start == NEAR:
        names = [name for name in names if FAMILIES[name].group != "absent"]
    # Seed by seed, so that an interrupted run has trials of every family.
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    wanted = [(name, seed) for seed in seeds for name in names]
    try:
        plan(conditions)
        trials = resumed(options.out, conditions, wanted)
    except TreeregError as error:
        print(error, file=sys.stderr)
        return 2
    done = {(trial.family, trial.seed) for trial in trials}
    for trial in spread(run_trial, [(conditions, *task) for task in wanted if task not in done], options.jobs):
        trials.append(trial)
        if options.out:
            append(options.out, trial)
    print(report(trials, names))
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        "benchmarks.accuracy", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    groups = list(dict.fromkeys(family.group for family in FAMILIES.values()))
    add = parser.add_argument
    add("--family", action="append", choices=list(FAMILIES), metavar="NAME", help="repeatable; default: all")
    add("--group", action="append", choices=groups, help="all families of a group; repeatable")
    add("--seeds", type=int, default=20, metavar="N", help="trials of each family (default 20)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--method", default=defaults()["method"], metavar="EXPR", help="default: that of treereg run")
    add(
        "--start",
        default=defaults()["start"],
        metavar="NAME",
        help="default: that of treereg run; or identity, or near",
    )
    add("--georeference-sd", type=float, default=math.inf, metavar="METRES", help="as in treereg run")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    add("--out", type=Path, metavar="FILE.csv", help="one row per trial; trials that it already holds are not repeated")
    return parser.parse_args()


def chosen(families: Sequence[str] | None, groups: Sequence[str] | None) -> Iterator[str]:
    """The families asked for by name or by group, all when none are, in their own order."""
    for name, family in FAMILIES.items():
        if not (families or groups) or name in (families or ()) or family.group in (groups or ()):
            yield name


def resumed(out: Path | None, conditions: Conditions, wanted: Iterable[Task]) -> list[Trial]:
    """The wanted trials that a file already holds. `UsageError` when it holds trials under other conditions."""
    if out is None:
        return []
    write_header(out)
    trials = read_trials([out])
    for trial in trials:
        if Conditions(trial.method, trial.start, trial.georeference_sd) != conditions:
            raise UsageError(f"{out} holds trials of {trial.method} from {trial.start}; give another file.")
    tasks = set(wanted)
    return [trial for trial in trials if (trial.family, trial.seed) in tasks]


def report(trials: Sequence[Trial], names: Sequence[str]) -> str:
    """The table, with a line for each group and what its columns mean."""
    rows = [line(name, [t for t in trials if t.family == name]) for name in names]
    for group in dict.fromkeys(FAMILIES[name].group for name in names):
        rows.append(line(f"all {group}", [t for t in trials if FAMILIES[t.family].group == group]))
    crashed = sum(trial.verdict == CRASHED for trial in trials)
    warning = f"\nCRASHED: {crashed} trials, counted as not right." if crashed else ""
    return f"{table(HEADER, rows)}\n\n{LEGEND}{warning}"


def line(name: str, trials: Sequence[Trial]) -> Sequence[str]:
    """One line of the table."""
    right = [trial for trial in trials if trial.right]
    error = statistics.median(t.error for t in right) if right else math.nan
    fit = statistics.median(t.fit_error for t in right) if right else math.nan
    return (
        name,
        str(len(trials)),
        percent(len(right), len(trials)),
        str(sum(t.accepted and not t.right for t in trials)),
        percent(sum(not t.accepted for t in right), len(right)),
        percent(sum(t.verdict == "failed" for t in trials), len(trials)),
        f"{error:.3f}" if right else "-",
        f"{fit:.3f}" if right else "-",
        f"{error / fit:.2f}" if right else "-",
        percent(sum(t.ci_low <= t.error <= t.ci_high for t in right), len(right)),
        f"{statistics.median(t.seconds for t in trials):.2f}" if trials else "-",
    )


if __name__ == "__main__":
    sys.exit(main())
