"""One trial of row detection: the rows of a simulated survey and how they compare with the true ones."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from functools import cache

import numpy as np

from benchmarks.edges import Edges, compare, truths, whole_trees
from treereg_core.detection import RowOptions, RowPlan, carry_out, row_plan
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.pair import Rows
from treereg_core.registry import installed
from treereg_core.simulate import Scene, Simulation, simulate, simulate_family


@dataclass(frozen=True)
class RowTrial:
    """What was found in the reference survey of one simulation.

    `right`, `wrong` and `missed` count edges (`benchmarks.edges`); `in_rows` is the share of whole true trees that
    stand in a row, `false_in_rows` the share of false detections that do, NaN where there are none; `seconds` of
    detection. `fault` is the sentence of a crash.
    """

    family: str
    seed: int
    trees: int
    right: int = 0
    wrong: int = 0
    missed: int = 0
    in_rows: float = 0.0
    false_in_rows: float = 0.0
    seconds: float = math.nan
    fault: str = ""

    @property
    def iou(self) -> float:
        """Right edges among all that were detected or should have been; 0 when there are none."""
        return self.right / max(self.right + self.wrong + self.missed, 1)


def run_row_trial(method: str, family: str, seed: int) -> RowTrial:
    """Simulate, detect, compare. A fault of the code under test makes a trial that says so."""
    simulation = simulate_family(family, seed)
    survey = simulation.reference
    try:
        rows, seconds = timed(method, survey)
    except Exception as fault:
        print(f"{family} seed {seed}: {type(fault).__name__}: {fault}", file=sys.stderr, flush=True)
        return RowTrial(family, seed, len(survey), fault=f"{type(fault).__name__}: {fault}")
    edges = best_edges(rows, simulation)
    inside = np.isin(survey.ids, np.concatenate([[-1], *rows.trees]))
    shown = simulation.reference_trees
    real, false = whole_trees(shown) >= 0, shown[:, 0] < 0
    return RowTrial(
        family,
        seed,
        len(survey),
        right=len(edges.right),
        wrong=len(edges.wrong),
        missed=len(edges.missed),
        in_rows=float(inside[real].mean()),
        false_in_rows=float(inside[false].mean()) if false.any() else math.nan,
        seconds=seconds,
    )


def best_edges(rows: Rows, simulation: Simulation) -> Edges:
    """The edges of the reference's rows against the truth, or against the columns where these are as good a truth."""
    found = [compare(rows, truth, truth.reference) for truth in truths(simulation)]
    return max(found, key=lambda edges: edges.iou)


def timed(method: str, survey: FeatureSet) -> tuple[Rows, float]:
    """The numbered rows of a survey, none where the method finds none, and the seconds that it took once compiled."""
    plan = ready(method)
    begin = time.perf_counter()
    try:
        rows = carry_out(plan, survey)
    except NoRegistration:
        rows = Rows(())
    return rows, time.perf_counter() - begin


@cache
def ready(method: str) -> RowPlan:
    """The plan of a method on one thread, after a first run in this process, in which code is compiled."""
    plan = row_plan(RowOptions(method=method, threads=1), installed())
    carry_out(plan, simulate(Scene(trees=300), seed=0).reference)
    return plan
