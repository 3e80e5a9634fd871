"""Rows detected in simulated surveys against the true ones, in figures and in pictures.

    python -m benchmarks.rows --family rotation_any --family noisy --seeds 30 --pictures DIR
    python -m benchmarks.rows --survey FOLDER --pictures DIR
    python -m benchmarks.rows --sizes 1500 5000 20000 100000

Without `--survey` and `--sizes` all families. A survey has no truth: its rows are drawn and counted. Exit code 1 when a
trial crashed.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.processes import spread
from benchmarks.row_trial import RowTrial, best_edges, ready, run_row_trial, timed
from benchmarks.speed import growth
from benchmarks.table import percent, table
from treereg_core import io
from treereg_core.errors import TreeregError
from treereg_core.options import defaults
from treereg_core.simulate import FAMILIES, Scene, simulate, simulate_family

HEADER = ("family", "surveys", "trees", "IoU", "least", "seed", "precision", "recall", "in rows", "false in", "seconds")
LEGEND = """\
trees      median number of detections
IoU        right / (right + wrong + missed) edges, mean over the surveys; least: of any survey, that of the seed named
precision  right / (right + wrong), all surveys together; recall: right / (right + missed)
in rows    share of the true trees, split and merged ones aside, that stand in a row; false in: of the false detections
seconds    median per survey on one thread, after compilation
An edge joins consecutive trees of a row; one missing tree is bridged. Edges along the row over a longer gap, and those
that touch a false, split or merged detection, count neither way. Rows of a square lattice may as well be
its columns: the better of both counts."""
REPEATS = 3


def main() -> int:
    """Print the tables that are asked for and draw the pictures."""
    options = arguments()
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    try:
        ready(options.method)
        if options.survey:
            print(surveys(options.survey, options.method, options.pictures))
        if options.sizes:
            print(sizes(options.sizes, options.method))
        if (options.survey or options.sizes) and not options.family:
            return 0
        names = options.family or list(FAMILIES)
        # Pictures first, and seed by seed: what goes wrong shows early.
        for name in names if options.pictures else ():
            picture(name, options.first_seed, options.method, options.pictures / f"{name}.png")
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        tasks = [(options.method, name, seed) for seed in seeds for name in names]
        trials = list(spread(run_row_trial, tasks, options.jobs))
    except TreeregError as error:
        print(error, file=sys.stderr)
        return 2
    print(report(trials, names))
    return 1 if any(trial.fault for trial in trials) else 0


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        "benchmarks.rows", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--method", default=defaults()["rows"], metavar="EXPR", help="default: that of treereg rows")
    add("--family", action="append", choices=list(FAMILIES), metavar="NAME", help="repeatable; default: all")
    add("--seeds", type=int, default=30, metavar="N", help="surveys of each family (default 30)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    add("--pictures", type=Path, metavar="DIR", help="draw the first survey of each family, and the given ones")
    add("--survey", type=Path, nargs="+", metavar="FOLDER", help="real surveys")
    add("--sizes", type=int, nargs="+", metavar="N", help="seconds over sizes of straight orchards instead")
    return parser.parse_args()


def report(trials: Sequence[RowTrial], names: Sequence[str]) -> str:
    """The table and what its columns mean."""
    rows = [line(name, [trial for trial in trials if trial.family == name]) for name in names]
    crashed = sum(bool(trial.fault) for trial in trials)
    warning = f"\nCRASHED: {crashed} surveys, counted as without rows." if crashed else ""
    return f"{table(HEADER, rows)}\n\n{LEGEND}{warning}"


def line(name: str, trials: Sequence[RowTrial]) -> Sequence[str]:
    """One line of the table."""
    right, wrong, missed = (sum(getattr(trial, kind) for trial in trials) for kind in ("right", "wrong", "missed"))
    worst = min(trials, key=lambda trial: trial.iou)
    done = [trial for trial in trials if not trial.fault]
    false = [trial.false_in_rows for trial in done if not math.isnan(trial.false_in_rows)]
    return (
        name,
        str(len(trials)),
        f"{statistics.median(trial.trees for trial in trials):.0f}",
        f"{statistics.fmean(trial.iou for trial in trials):.4f}",
        f"{worst.iou:.4f}",
        str(worst.seed),
        f"{right / max(right + wrong, 1):.4f}",
        f"{right / max(right + missed, 1):.4f}",
        percent(statistics.fmean(trial.in_rows for trial in trials), 1),
        percent(statistics.fmean(false), 1) if false else "-",
        f"{statistics.median(trial.seconds for trial in done):.2f}" if done else "-",
    )


def picture(family: str, seed: int, method: str, path: Path) -> None:
    """Draw the detected against the true rows of one survey."""
    from benchmarks.row_pictures import against_truth

    simulation = simulate_family(family, seed)
    rows, _ = timed(method, simulation.reference)
    edges = best_edges(rows, simulation)
    against_truth(simulation, edges, f"{method}, {family}, seed {seed}: IoU {edges.iou:.3f}", path)


def surveys(folders: Sequence[Path], method: str, pictures: Path | None) -> str:
    """How many rows surveys without a truth have, and what they are like; draws them."""
    lines = []
    for folder in folders:
        survey = io.read_survey(folder)
        features = survey.features
        rows, seconds = timed(method, features)
        steps = [np.hypot(*np.diff(features.xy[features.positions(row)], axis=0).T) for row in rows.trees]
        counts = [len(row) for row in rows.trees]
        lines.append(
            (
                "/".join(folder.resolve().parts[-2:]),
                str(len(features)),
                str(len(rows)),
                percent(sum(counts), len(features)),
                f"{statistics.median(counts):.0f}" if counts else "-",
                f"{np.median(np.concatenate(steps)):.2f} m" if steps else "-",
                f"{seconds:.2f}",
            )
        )
        if pictures:
            from benchmarks.row_pictures import over_canopies

            title = f"{lines[-1][0]}: {len(rows)} rows"
            over_canopies(survey, rows, title, pictures / f"{'-'.join(folder.resolve().parts[-2:])}.png")
    return table(("survey", "trees", "rows", "in rows", "trees in a row", "tree to tree", "seconds"), lines)


def sizes(trees: Sequence[int], method: str) -> str:
    """Seconds of detection over sizes of straight orchards on one thread: the fastest of several, after compilation."""
    lines: list[tuple[str, ...]] = []
    before: tuple[int, float] | None = None
    for size in trees:
        survey = simulate(Scene(trees=size, rotation="any"), seed=0).reference
        # a new copy each time, of which nothing was computed before
        seconds = min(timed(method, survey.replace())[1] for _ in range(REPEATS))
        exponent = f"n^{growth(before, (size, seconds)):.2f}" if before else ""
        lines.append((f"{size:,}", f"{seconds:.2f} s", f"{1000 * seconds / size:.3f} ms", exponent))
        before = size, seconds
    return table(("trees", "detection", "per tree", "growth"), lines)


if __name__ == "__main__":
    sys.exit(main())
