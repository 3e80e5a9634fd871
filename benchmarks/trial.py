"""One trial: a simulated pair of surveys registered and compared with its truth, and the CSV row it makes."""

from __future__ import annotations

import argparse
import csv
import math
import sys
import zlib
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.starts import brought_near, is_near, row_ends
from treereg_core.api import execute
from treereg_core.errors import UsageError
from treereg_core.options import Options
from treereg_core.pipeline import Clock
from treereg_core.plan import IDENTITY, Plan, plan_for
from treereg_core.registry import installed
from treereg_core.simulate import Simulation, simulate_family
from treereg_core.transform import Rigid

NONE = math.nan
CRASHED = "crashed"
IN_PLACE = Rigid.identity()
RIGHT_M = 0.5
RIGHT_FACTOR = 1.25
NEAR = "near"
"""The start from the files' own georeference, once that was made near."""


@dataclass(frozen=True)
class Conditions:
    """What all trials of one run have in common. `georeference_sd` in metres, infinite when it is unknown.

    `start` as in `treereg run`, or `near`: the identity, after the source was laid anew (`benchmarks.starts`).
    """

    method: str
    start: str
    georeference_sd: float


@dataclass(frozen=True)
class Trial(Conditions):
    """One row. Errors in metres, RMS over the source's true trees; NaN where there is none.

    `right`: the error is below 0.5 m or 1.25 times that of the fit with the true pairs. Both errors then count the
    distortion that no rigid transform can undo (`bend`); in the columns they do not. Without a truth nothing is right.
    `near_start`: the files' own georeference puts all row ends near their true places (`benchmarks.starts.is_near`).
    """

    family: str
    seed: int
    trees: int
    near_start: bool
    verdict: str
    matched: int = 0
    right: bool = False
    failure_probability: float = 1.0
    error: float = NONE
    fit_error: float = NONE
    bend: float = NONE
    expected_rms: float = NONE
    ci_low: float = NONE
    ci_high: float = NONE
    rival_log_odds: float = NONE
    start_s: float = NONE
    match_s: float = NONE
    judge_s: float = NONE

    @property
    def accepted(self) -> bool:
        """Whether the judge accepted the placement."""
        return self.verdict == "accepted"

    @property
    def seconds(self) -> float:
        """All the work, reading aside."""
        return self.start_s + self.match_s + self.judge_s


@cache
def plan(conditions: Conditions) -> Plan:
    """The plan of these conditions, with one thread."""
    sd = None if math.isinf(conditions.georeference_sd) else conditions.georeference_sd
    start = IDENTITY if conditions.start == NEAR else conditions.start
    options = Options(method=conditions.method, start=start, georeference_sd=sd, threads=1)
    return plan_for(options, installed())


def run_trial(conditions: Conditions, family: str, seed: int) -> Trial:
    """Simulate, register, compare. A fault of the code under test makes a trial with the verdict `crashed`."""
    simulation = simulate_family(family, seed)
    if conditions.start == NEAR:
        simulation = brought_near(simulation, np.random.default_rng([zlib.crc32(family.encode()), seed, 1]))
    about = {**vars(conditions), "family": family, "seed": seed, "trees": len(simulation.source)}
    about["near_start"] = simulation.truth is not None and is_near(row_ends(simulation), simulation.scene, IN_PLACE)
    clock = Clock()
    try:
        result = execute(plan(conditions), (simulation.reference, simulation.source), clock)
    except Exception as fault:
        print(f"{family} seed {seed}: {type(fault).__name__}: {fault}", file=sys.stderr, flush=True)
        return Trial(**about, verdict=CRASHED)
    said = result.judgement
    expected = said.expected_error
    error = NONE if simulation.truth is None or said.transform is None else simulation.error(said.transform)
    fit_error = best_error(simulation)
    start_s, judge_s = clock.seconds["start"], clock.seconds["judge"]
    return Trial(
        **about,
        verdict=said.verdict.value,
        matched=len(said.matches.pairs),
        right=is_right(error, fit_error, simulation.bend),
        failure_probability=said.failure_probability,
        error=error,
        fit_error=fit_error,
        bend=simulation.bend,
        expected_rms=expected.rms if expected else NONE,
        ci_low=expected.ci95[0] if expected else NONE,
        ci_high=expected.ci95[1] if expected else NONE,
        rival_log_odds=said.rivals[0].log_odds if said.rivals else NONE,
        start_s=start_s,
        match_s=sum(clock.seconds.values()) - start_s - judge_s,
        judge_s=judge_s,
    )


def best_error(simulation: Simulation) -> float:
    """The error of the fit with the true pairs; NaN where there are too few."""
    try:
        return simulation.error(simulation.true_fit())
    except ValueError:
        return NONE


def is_right(error: float, fit_error: float, bend: float) -> bool:
    """Whether an error counts as right; never where there is none."""
    limit = RIGHT_M if math.isnan(fit_error) else max(RIGHT_M, RIGHT_FACTOR * math.hypot(fit_error, bend))
    return math.hypot(error, bend) < limit


COLUMNS = [field.name for field in fields(Trial)]
READERS: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
PARSERS = {field.name: READERS[str(field.type)] for field in fields(Trial)}


def write_header(path: Path) -> None:
    """Begin a file of trials, unless it is there."""
    if not path.exists() or not path.stat().st_size:
        path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")


def append(path: Path, trial: Trial) -> None:
    """Add one row, so that an interrupted run loses nothing."""
    with path.open("a", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(astuple(trial))


def read_trials(paths: Iterable[Path]) -> list[Trial]:
    """All trials in these files. `UsageError` for a file that cannot be read or holds something else."""
    trials: list[Trial] = []
    for path in paths:
        try:
            with path.open(encoding="utf-8", newline="") as file:
                rows = csv.DictReader(file)
                if rows.fieldnames != COLUMNS:
                    raise UsageError(f"{path}: not a file of trials of this version; give one from accuracy --out.")
                trials += [Trial(**{name: PARSERS[name](row[name]) for name in COLUMNS}) for row in rows]
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}; give a file of trials from accuracy --out.") from None
    return trials


def trials_given(program: str, description: str | None) -> list[Trial]:
    """The trials in the files on the command line of a benchmark; leaves with code 2 when one cannot be read."""
    parser = argparse.ArgumentParser(
        program, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.csv", help="trials from benchmarks.accuracy --out")
    try:
        return read_trials(parser.parse_args().files)
    except UsageError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
