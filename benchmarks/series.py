"""How well trees are followed through a series of surveys: links, states and rows against the truth.

    python -m benchmarks.series --seeds 50 --first-seed 6000

Each trial simulates a series of an orchard in which trees grow, die and are planted anew, registers every survey onto
the first, and follows the trees. A link is a pair of detections, in two surveys, that are said to show one tree.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from statistics import median
from types import MappingProxyType
from typing import Any

import numpy as np

from benchmarks.processes import spread
from benchmarks.table import percent, table
from treereg_core.api import execute
from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.options import Options
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.registry import installed
from treereg_core.series import History, State
from treereg_core.simulate import Scene, Seasons, SeriesSimulation, family_scene, simulate_series
from treereg_core.simulate.series import Lives
from treereg_core.statistics import wilson
from treereg_core.transform import Affine, Rigid

LESS: Mapping[str, float] = MappingProxyType({"missed": 0.08, "false": 0.08, "dead": 0.02, "growth": 1.5})
SERIES: Mapping[str, tuple[str, Mapping[str, float], Seasons]] = MappingProxyType(
    {
        "usual": ("rotation_any", LESS, Seasons()),
        "uneven": ("rotation_any", LESS, Seasons(persistence=0.3)),
        "cropped": ("rotation_any", LESS, Seasons(seen=0.7)),
        "two": ("rotation_any", LESS, Seasons(surveys=2)),
        "ten": ("rotation_any", LESS, Seasons(surveys=10)),
        "curved": ("curved", LESS, Seasons()),
        "paths": ("paths", LESS, Seasons()),
        "small": ("small_150", LESS, Seasons()),
        "dense": ("dense", LESS, Seasons()),
        "noisy": ("noisy", {**LESS, "missed": 0.2, "false": 0.2}, Seasons()),
    }
)
"""By name: the family that the scene is of, what is different in it, and what happens in the series."""
BINS = 10
HEADER = (
    *("series", "trials", "accepted", "links right", "95 %", "links found", "95 %"),
    *("dead missing", "not in view", "replanted right", "found", "real", "ECE", "seconds"),
)
LEGEND = """\
accepted       share of the surveys that were accepted
links right    share of the links said that are true; with its interval
links found    share of the true links, of detections that show one tree whole, that are said; with its interval
dead missing   share of the trees that were dead, and whose place was in view, that are said to be missing (else unseen)
not in view    trees said to be missing though their place was not in view, a count
replanted      right: share of those said that are; found: share of those seen that are said
real           share of the probable trees that are trees; ECE: expected calibration error of the probability
seconds        median, of following alone, one thread"""


@dataclass(frozen=True)
class SeriesTrial:
    """Counts of one simulated series."""

    name: str
    counts: Mapping[str, Any]
    seconds: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.series", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--series", action="append", choices=list(SERIES), metavar="NAME", help=f"default: {', '.join(SERIES)}")
    add("--seeds", type=int, default=50, metavar="N", help="series of each kind (default 50)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--method", default="icp", metavar="EXPR", help="what registers the surveys (default icp)")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    names = options.series or list(SERIES)
    trials = list(spread(run, [(options.method, name, seed) for seed in seeds for name in names], options.jobs))
    lines = [line(name, [trial for trial in trials if trial.name == name]) for name in names]
    print(f"{table(HEADER, lines)}\n\n{LEGEND}")
    return 0


def run(method: str, name: str, seed: int) -> SeriesTrial:
    """Simulate a series, register it, follow its trees, and count."""
    family, changes, seasons = SERIES[name]
    scene: Scene = family_scene(family, seed).model_copy(update=dict(changes))
    simulation = simulate_series(scene, seed, seasons)
    laid = registered(simulation, plan(method))
    begin = time.perf_counter()
    history = History.of([survey for survey in laid if survey])
    state = history.state
    seconds = time.perf_counter() - begin
    shown = [k for k, survey in enumerate(laid) if survey]
    counts = Counter({"surveys": len(laid) - 1, "accepted": len(shown) - 1})
    counts.update(links(simulation, shown, history))
    counts.update(states(simulation, shown, history, state))
    return SeriesTrial(name, dict(counts), seconds)


@cache
def plan(method: str) -> Plan:
    """The plan of this expression, with one thread."""
    return plan_for(Options(method=method, threads=1), installed())


def registered(simulation: SeriesSimulation, how: Plan) -> list[tuple[FeatureSet, Affine] | None]:
    """The surveys with the transforms that lay them on the first; None for one that was not accepted."""
    first = simulation.captures[0].features
    laid: list[tuple[FeatureSet, Affine] | None] = [(first, Rigid.identity())]
    for capture in simulation.captures[1:]:
        result = execute(how, (first, capture.features), Clock())
        transform = result.transform if result.accepted else None
        laid.append((capture.features, transform) if transform else None)
    return laid


def links(simulation: SeriesSimulation, shown: Sequence[int], history: History) -> Counter[str]:
    """Counts of the links said, of those that are true, of the true ones, and of those of them that are said."""
    counts: Counter[str] = Counter()
    spots = [spots_of(simulation, k) for k in shown]
    for a, b in combinations(range(len(shown)), 2):
        said = history.detection[history.seen[:, a] & history.seen[:, b]][:, [a, b]]
        one, two = spots[a][said[:, 0]], spots[b][said[:, 1]]
        same = ((one[:, :, None] == two[:, None, :]) & (one[:, :, None] >= 0)).any(axis=(1, 2))
        counts["said"] += len(said)
        counts["right"] += int(same.sum())
        (whole_a, of_a), (whole_b, of_b) = whole(spots[a]), whole(spots[b])
        _, i, j = np.intersect1d(of_a, of_b, return_indices=True)
        true = set(zip(whole_a[i].tolist(), whole_b[j].tolist(), strict=True))
        counts["true"] += len(true)
        counts["found"] += len(true & set(map(tuple, said.tolist())))
    return counts


def spots_of(simulation: SeriesSimulation, survey: int) -> IntArray:
    """For each feature (n, 2) the planting positions of its trees, -1 for none."""
    return np.asarray(np.append(simulation.lives.spot, -1)[simulation.captures[survey].trees])


def whole(spots: IntArray) -> tuple[IntArray, IntArray]:
    """The features that show one tree, alone and whole, and its planting position."""
    features = np.flatnonzero((spots[:, 0] >= 0) & (spots[:, 1] < 0))
    spot, first, count = np.unique(spots[features, 0], return_index=True, return_counts=True)
    return features[first[count == 1]], spot[count == 1]


def states(simulation: SeriesSimulation, shown: Sequence[int], history: History, state: IntArray) -> Counter[Any]:
    """Counts of what is said of the states of probable trees, and of what is true."""
    lives, counts = simulation.lives, Counter[Any]()
    spot = spot_of_trees(simulation, shown, history)
    followed = np.flatnonzero(history.probable & (spot >= 0))
    counts["probable"] = int(history.probable.sum())
    counts["followed"] = len(followed)
    bins = np.minimum((history.probability * BINS).astype(int), BINS - 1)
    for name, values in (("said", history.probability), ("is", (spot >= 0).astype(float))):
        counts.update({f"{name} {k}": total for k, total in enumerate(np.bincount(bins, values, BINS))})
    counts["all"] = len(spot)
    at = spot[followed]
    for s, k in enumerate(shown):
        capture, now = simulation.captures[k], state[followed, s]
        again = (lives.born == k) & replaces(lives)
        standing, viewed, anew = (np.isin(at, lives.spot[x]) for x in (capture.alive, capture.covered, again))
        seen = history.seen[followed, s]
        dead = ~standing & viewed & ~seen
        counts["dead"] += int(dead.sum())
        counts["dead missing"] += int((dead & (now == State.MISSING)).sum())
        counts["not in view"] += int((~viewed & (now == State.MISSING)).sum())
        counts["replanted"] += int((anew & seen).sum())
        counts["replanted said"] += int((now == State.REPLANTED).sum())
        counts["replanted right"] += int((anew & (now == State.REPLANTED)).sum())
    return counts


def replaces(lives: Lives) -> BoolArray:
    """Which trees (n,) stand where an earlier one died."""
    return np.asarray(np.append(False, lives.spot[1:] == lives.spot[:-1]))


def spot_of_trees(simulation: SeriesSimulation, shown: Sequence[int], history: History) -> IntArray:
    """The planting position (t,) of each tree as the last survey that shows one says, -1 for one that is none.

    Of several at one position the one that is seen most often is the tree.
    """
    spot = np.full(len(history.detection), -1, dtype=np.int64)
    for k, at in zip(shown, history.detection.T, strict=True):
        now = spots_of(simulation, k)[np.maximum(at, 0), 0]
        spot = np.where((at >= 0) & (now >= 0), now, spot)
    # the second half of a split crown is no tree of its own
    order = np.lexsort((-history.seen.sum(axis=1), spot))
    again = np.append(False, spot[order][1:] == spot[order][:-1])
    spot[order[again]] = -1
    return spot


def line(name: str, trials: Sequence[SeriesTrial]) -> Sequence[str]:
    """One line of the table."""
    total: Counter[Any] = Counter()
    for trial in trials:
        total.update(trial.counts)

    def between(count: str, of: str) -> str:
        low, high = wilson(total[count], total[of])
        return f"{100 * low:.2f}-{100 * high:.2f}"

    return (
        *(name, str(len(trials)), percent(total["accepted"], total["surveys"])),
        *(precise(total["right"], total["said"]), between("right", "said")),
        *(precise(total["found"], total["true"]), between("found", "true")),
        *(percent(total["dead missing"], total["dead"]), str(total["not in view"])),
        percent(total["replanted right"], total["replanted said"]),
        percent(total["replanted right"], total["replanted"]),
        percent(total["followed"], total["probable"]),
        f"{sum(abs(total[f'said {k}'] - total[f'is {k}']) for k in range(BINS)) / total['all']:.3f}",
        f"{median(trial.seconds for trial in trials):.2f}",
    )


def precise(count: int, of: int) -> str:
    """A share close to one, for people."""
    return f"{100 * count / of:.2f} %" if of else "-"


if __name__ == "__main__":
    sys.exit(main())
