"""Rows matched from starts that are some rows off: `bn_rows` beside the default row matcher, on the same trials.

    python -m benchmarks.row_matching --family noisy --family curved --seeds 50 --first-seed 5000

Each trial simulates two surveys, detects their rows (`--detector`), and lays the source off the truth: by up to two
in-row spacings along, by the given number of rows and up to 0.35 more across, and turned a little. Both matchers start
there; the judge then chooses among the placements that each hands on. Exit code 1 when a trial crashed.
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from statistics import fmean, median

import numpy as np

from benchmarks.processes import spread
from benchmarks.row_trial import ready, timed
from benchmarks.table import percent, table
from treereg_core.errors import NoRegistration
from treereg_core.evaluation.case import of_simulation
from treereg_core.features import FeatureSet
from treereg_core.judge import Judge
from treereg_core.method import Context, RowMatcher
from treereg_core.options import Options
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.registry import installed
from treereg_core.row_trees import along_rows
from treereg_core.rows import NearestRows
from treereg_core.simulate import FAMILIES, Simulation, simulate_family
from treereg_core.statistics import wilson
from treereg_core.testing.scenes import off, row_of_trees
from treereg_core.transform import Rigid

USUAL = ("rotation_any", "noisy", "curved", "overlap_60", "bare_rectangle", "small_150")
MATCHERS = ("bn_rows", "nearest_rows")
ALONG, ACROSS, TURNED_DEG = 2.0, 0.35, 0.3
HEADER = (
    *("family", "rows off", "matcher", "trials", "first", "handed on", "judged", "95 % interval", "silent"),
    *("pairs right", "rows found", "placements", "seconds"),
)
LEGEND = """\
first        the first placement is right: an error below 0.5 m or 1.25 times that of the fit with true pairs
handed on    a right placement is among those that are handed to the judge
judged       the placement that the judge chooses is right, accepted or not; with its interval
silent       accepted though wrong, a count
pairs right  share of the matched row pairs of a right placement that share a true row; of all trials together
rows found   share of the true rows that both surveys show whose rows are matched, there
placements   mean number handed on; seconds: median per start, rows and judge aside, on one thread"""


@dataclass(frozen=True)
class MatchTrial:
    """What one matcher made of one start."""

    family: str
    rows_off: int
    matcher: str
    first: bool = False
    handed_on: bool = False
    judged: bool = False
    silent: bool = False
    pairs: int = 0
    pairs_right: int = 0
    rows: int = 0
    rows_found: int = 0
    placements: int = 0
    seconds: float = 0.0
    fault: str = ""


def main() -> int:
    """Run the trials and print the table."""
    options = arguments()
    names = options.family or list(USUAL)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tasks = [(options.detector, name, seed, tuple(options.rows_off)) for seed in seeds for name in names]
    trials = [trial for found in spread(run, tasks, options.jobs) for trial in found]
    print(report(trials, [*names, "all"] if len(names) > 1 else names))
    return 1 if any(trial.fault for trial in trials) else 0


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        "benchmarks.row_matching", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--family", action="append", choices=list(FAMILIES), metavar="NAME", help=f"default: {', '.join(USUAL)}")
    add("--rows-off", type=int, nargs="+", default=[0, 1, 2], metavar="K", help="default: 0 1 2")
    add("--seeds", type=int, default=50, metavar="N", help="pairs of surveys of each family (default 50)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--detector", default="aco", metavar="NAME", help="of rows (default aco)")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    return parser.parse_args()


def run(detector: str, family: str, seed: int, rows_off: Sequence[int]) -> list[MatchTrial]:
    """All trials of one pair of surveys. A fault of the code under test makes a trial that says so."""
    simulation = simulate_family(family, seed)
    ready(detector)
    rows = MatchedRows(
        timed(detector, simulation.reference)[0],
        timed(detector, simulation.source)[0],
        np.empty((0, 2), dtype=np.int64),
    )
    trials = []
    for k in rows_off:
        pair = start(simulation, k, np.random.default_rng([zlib.crc32(family.encode()), seed, k]), rows)
        for name in MATCHERS:
            try:
                trials.append(trial(simulation, pair, MatchTrial(family, k, name)))
            except Exception as fault:
                said = f"{type(fault).__name__}: {fault}"
                print(f"{family} seed {seed}, {k} rows off, {name}: {said}", file=sys.stderr, flush=True)
                trials.append(MatchTrial(family, k, name, fault=said))
    return trials


def start(simulation: Simulation, rows_off: int, rng: np.random.Generator, rows: MatchedRows) -> Pair:
    """The surveys with these rows, so many rows off to either side, and somewhat more in all ways."""
    across = rows_off * rng.choice([-1, 1]) + rng.uniform(-ACROSS, ACROSS)
    placed = off(simulation, rng.uniform(-ALONG, ALONG), across).reference_from_source
    turn = Rigid.turn(rng.normal(0, TURNED_DEG), about=simulation.reference.xy.mean(axis=0))
    return Pair(simulation.reference, simulation.source, turn @ placed, rows)


def trial(simulation: Simulation, pair: Pair, about: MatchTrial) -> MatchTrial:
    """What the matcher hands on from a start, and what the judge makes of it."""
    context = Context(seed=simulation.seed)
    begin = time.perf_counter()
    try:
        found = matcher(about.matcher).match(pair, context)
    except NoRegistration:
        return about
    seconds = time.perf_counter() - begin
    results = [along_rows(one, context) for one in found]
    right = of_simulation(simulation, about.family).right
    good = [right(one.transform) for one in results]
    plain = Pair(pair.reference, pair.source)
    said = Judge().judge(plain, results, context, Options().max_failure)
    pairs = (0, 0, 0, 0)
    if any(good):
        pairs = compared(simulation, found[good.index(True)])
    return MatchTrial(
        about.family,
        about.rows_off,
        about.matcher,
        first=good[0],
        handed_on=any(good),
        judged=right(said.transform),
        silent=said.verdict.value == "accepted" and not right(said.transform),
        pairs=pairs[0],
        pairs_right=pairs[1],
        rows=pairs[2],
        rows_found=pairs[3],
        placements=len(found),
        seconds=seconds,
    )


@cache
def matcher(name: str) -> RowMatcher:
    """An installed row matcher, or the core's default."""
    if name == NearestRows.name:
        return NearestRows()
    offer = installed().entry(name).offer
    assert isinstance(offer, type)
    assert issubclass(offer, RowMatcher)
    return offer()


def compared(simulation: Simulation, pair: Pair) -> tuple[int, int, int, int]:
    """How many row pairs are matched, and rightly; how many true rows both surveys show, and how many are matched."""
    assert pair.rows is not None
    ours = true_rows_of(simulation, pair.rows.reference, simulation.reference)
    theirs = true_rows_of(simulation, pair.rows.source, simulation.source)
    common = [ours[i] & theirs[j] for i, j in pair.rows.matches.tolist()]
    both = set().union(*ours) & set().union(*theirs)
    return len(common), sum(map(bool, common)), len(both), len(set().union(*common))


def true_rows_of(simulation: Simulation, rows: Rows, survey: FeatureSet) -> list[set[int]]:
    """For each detected row the true rows that it is of: of two trees and a third of all at least."""
    true = row_of_trees(simulation, survey)
    found = []
    for trees in rows.trees:
        count = Counter(true[tree] for tree in trees.tolist() if tree in true)
        found.append({row for row, many in count.items() if many >= max(2, len(trees) / 3)})
    return found


def report(trials: Sequence[MatchTrial], names: Sequence[str]) -> str:
    """The table and what its columns mean."""
    lines = []
    for name in names:
        for k in sorted({trial.rows_off for trial in trials}):
            for which in MATCHERS:
                chosen = [t for t in trials if name in (t.family, "all")]
                lines.append(line(name, k, which, [t for t in chosen if (t.rows_off, t.matcher) == (k, which)]))
    crashed = sum(bool(trial.fault) for trial in trials)
    warning = f"\nCRASHED: {crashed} trials, counted as wrong." if crashed else ""
    return f"{table(HEADER, lines)}\n\n{LEGEND}{warning}"


def line(name: str, rows_off: int, which: str, trials: Sequence[MatchTrial]) -> Sequence[str]:
    """One line of the table."""
    n = len(trials)
    judged = sum(trial.judged for trial in trials)
    low, high = wilson(judged, n)
    return (
        name,
        str(rows_off),
        which,
        str(n),
        percent(sum(trial.first for trial in trials), n),
        percent(sum(trial.handed_on for trial in trials), n),
        percent(judged, n),
        f"{100 * low:.1f} to {100 * high:.1f} %",
        str(sum(trial.silent for trial in trials)),
        percent(sum(trial.pairs_right for trial in trials), sum(trial.pairs for trial in trials)),
        percent(sum(trial.rows_found for trial in trials), sum(trial.rows for trial in trials)),
        f"{fmean(trial.placements for trial in trials):.1f}",
        f"{median(trial.seconds for trial in trials):.2f}",
    )


if __name__ == "__main__":
    sys.exit(main())
