"""Whether heights of trees would help the judge: the same trials with and without them as evidence.

    python -m benchmarks.heights --seeds 100 --first-seed 500000
    python -m benchmarks.heights --one-raster --seeds 40

Each tree has the height that the simulation says, as a raster would tell it: with an error of its own in each survey,
one in twenty ten times as large. `--persistence` is how much of what sets a tree's height apart lasts from survey to
survey (default: that of a scene). `--start identity` gives many wrong placements, of which none may be accepted.
`--one-raster` is another trial: ordinary orchards of 200 trees, written with their rasters and read again, of which the
elevations of the reference lie in the folders of both surveys.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.processes import spread
from benchmarks.table import table
from treereg_core.api import execute
from treereg_core.evaluation.case import of_simulation
from treereg_core.evaluation.trial import plan_of
from treereg_core.features import FeatureSet, nearest
from treereg_core.heights import HEIGHT
from treereg_core.io import read_surveys
from treereg_core.options import Options, defaults
from treereg_core.pipeline import Clock
from treereg_core.simulate import FAMILIES, Scene, Simulation, family_scene, simulate, write_simulation
from treereg_core.simulate.flight import Flight
from treereg_core.statistics import wilson
from treereg_core.transform import FloatArray

FAMILIES_ASKED = (
    *("small_150", "small_60", "heavy_overlap_40", "half_rectangle_silent"),
    *("different", "periodic_crops", "periodic_turn"),
)
NAME = "told_height"
"""The attribute that holds heights here; the one that reading a survey makes is no evidence."""
ONE_RASTER = "one raster"
ORDINARY = Scene(trees=200)
ERROR_M = 0.08
"""Of a height that a simulated raster tells, sd."""
GROSS = 0.05
"""Share of heights that are off by ten times as much."""
GROUND_M = 0.8
"""Heights up to here are what a detection shows that is no tree, where it does not lie in a crown."""
HEADER = ("family", "heights", "trials", "right", "95 % interval", "accepted", "95 % interval", "silent")


@dataclass(frozen=True)
class How:
    """What all trials of a run have in common; `error` of heights in metres, sd; `persistence` None: the scene's."""

    start: str
    error: float
    persistence: float | None


@dataclass(frozen=True)
class Outcome:
    """One trial with or without heights."""

    family: str
    heights: bool
    right: bool
    accepted: bool


def main() -> int:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.heights", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--family", action="append", choices=list(FAMILIES), metavar="NAME", help="repeatable")
    add("--seeds", type=int, default=20, metavar="N", help="trials of each family (default 20)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--persistence", type=float, default=None, metavar="SHARE", help="of heights; default: that of a scene")
    add("--error", type=float, default=ERROR_M, metavar="METRES", help=f"of a height, sd (default {ERROR_M})")
    add("--one-raster", action="store_true", help="for both surveys")
    add("--start", default=defaults()["start"], metavar="NAME", help="default: that of treereg run")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    options = parser.parse_args()
    names = tuple(options.family or FAMILIES_ASKED)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    how = How(options.start, options.error, options.persistence)
    tasks = [(how, name, seed) for seed in seeds for name in names]
    if options.one_raster:
        names, tasks = (ONE_RASTER,), [(how, ONE_RASTER, seed) for seed in seeds]
    outcomes = [outcome for both in spread(trial, tasks, options.jobs) for outcome in both]
    print(report(outcomes, names))
    return 0


def trial(how: How, family: str, seed: int) -> tuple[Outcome, Outcome]:
    """One pair of surveys registered without heights and with them."""
    simulation, told = with_one_raster(seed) if family == ONE_RASTER else with_heights(how, family, seed)
    plain = (simulation.reference, simulation.source)
    reference, source = (s.replace(attributes={NAME: h}) for s, h in zip(plain, told, strict=True))
    case, plan = of_simulation(simulation, family), plan_of(Options(start=how.start))
    outcomes = []
    for heights, surveys in ((False, plain), (True, (reference, source))):
        said = execute(plan, surveys, Clock()).judgement
        outcomes.append(Outcome(family, heights, case.right(said.transform), said.verdict.value == "accepted"))
    return outcomes[0], outcomes[1]


def with_one_raster(seed: int) -> tuple[Simulation, list[FloatArray]]:
    """A simulation, and heights (n,) of both surveys off the raster of its reference."""
    simulation = simulate(ORDINARY, seed)
    with tempfile.TemporaryDirectory() as name:
        folders = [Path(name) / survey for survey in ("reference", "source")]
        write_simulation(simulation, Path(name), rasters=True)
        shutil.copy(folders[0] / "dem_10cm.tif", folders[1] / "dem_10cm.tif")
        surveys = read_surveys(*folders)
    return simulation, [survey.features.attributes[HEIGHT] for survey in surveys]


def with_heights(how: How, family: str, seed: int) -> tuple[Simulation, list[FloatArray]]:
    """A simulation, and heights (n,) of both surveys as rasters would tell them."""
    scene = family_scene(family, seed)
    if how.persistence is not None:
        scene = scene.model_copy(update={"height_persistence": how.persistence})
    simulation, rng = simulate(scene, seed), np.random.default_rng([seed, 7])
    surveys = zip((simulation.reference, simulation.source), simulation.flights, strict=True)
    return simulation, [told_heights(survey, flight, how.error, rng) for survey, flight in surveys]


def told_heights(survey: FeatureSet, flight: Flight, error_m: float, rng: np.random.Generator) -> FloatArray:
    """The heights of features, metres: of the higher of two trees, of a crown around a false detection, or of weeds."""
    n = len(survey)
    standing = np.where(flight.visit.alive, flight.height, 0.0)
    true = np.where(flight.trees >= 0, standing[flight.trees], 0.0).max(axis=1)
    xy = flight.displacement.inverse(survey.xy)
    distance, tree = nearest(cKDTree(flight.orchard.xy), xy, np.inf)
    crown = np.sqrt(flight.orchard.area[tree] / np.pi) * flight.visit.growth
    false = np.where(distance < crown, standing[tree], rng.uniform(0, GROUND_M, n))
    error = error_m * rng.standard_normal(n) * np.where(rng.random(n) < GROSS, 10, 1)
    return np.asarray(np.maximum(np.where(flight.trees[:, 0] >= 0, true, false) + error, 0))


def report(outcomes: Sequence[Outcome], names: Sequence[str]) -> str:
    """The table: right and accepted placements as shares of all trials, with Wilson intervals."""
    rows = []
    for name in names:
        for heights in (False, True):
            mine = [o for o in outcomes if o.family == name and o.heights == heights]
            right, accepted = sum(o.right for o in mine), sum(o.accepted for o in mine)
            silent = sum(o.accepted and not o.right for o in mine)
            cells = (len(mine), right, interval(right, len(mine)), accepted, interval(accepted, len(mine)), silent)
            rows.append((name, "with" if heights else "without", *map(str, cells)))
    return table(HEADER, rows)


def interval(count: int, trials: int) -> str:
    """The Wilson interval of a share."""
    low, high = wilson(count, trials)
    return f"{100 * low:.0f} to {100 * high:.0f} %"


if __name__ == "__main__":
    sys.exit(main())
