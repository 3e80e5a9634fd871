"""One series of surveys registered in order, with and without a memory; and surveys that are there to spoil it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from treereg_bn_landmarks import Landmarks
from treereg_bn_landmarks.landmarks import probabilities

from benchmarks.landmarks import BINS, chosen, true_landmarks
from benchmarks.series_pairs import pair_of
from treereg_core.api import execute
from treereg_core.evaluation.case import of_simulation
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import IDENTITY, plan_for
from treereg_core.recall import Recall
from treereg_core.registry import installed
from treereg_core.simulate import Scene, Seasons, SeriesSimulation, Simulation, family_scene, simulate_series
from treereg_core.testing.scenes import heading, near
from treereg_core.transform import Affine, FloatArray, Rigid

METHOD = "bn_landmarks+icp"
FAMILIES = ("shift_3", "curved", "square_any", "paths", "contour")
NOISE = (0.2, 0.35)
"""Shares of missed and of false trees, each drawn anew for every orchard."""
USUALLY = {"jitter": 0.35, "confidence_information": 0.5, "overlap": 1.0}
SURVEYS, FIRST, SPOILT = 6, 1, 3
"""How many surveys; the first that is registered, and the one that is hostile or astray where one is, from 0."""
SEASONS = Seasons(surveys=SURVEYS, persistence=0.3)
USUAL = Options().max_failure
KINDS = ("none", "memory", "hostile", "astray")


@dataclass(frozen=True, eq=False)
class Measured:
    """What came of one survey laid on the first.

    - `precision`: of the chosen trees; `brier`: of the probabilities of all trees.
    - `bins` (BINS, 3): for the calibration error: trees, the sum of their probabilities, and true landmarks, by
      probability.
    - `error`: RMS metres over the source's true trees, infinite for none; `best`: that of the fit with the true pairs.
    - `accepted`: whether the judge would accept it at the usual chance of a failure.
    """

    precision: float
    brier: float
    bins: FloatArray
    error: float
    best: float
    accepted: bool
    right: bool


@dataclass(frozen=True, eq=False)
class Trial:
    """One orchard: `found` has for each kind of series what came of each survey that was registered, by its number.

    `none` knows no memory, `memory` that of all before; in `hostile` and `astray` the survey `SPOILT` is such a one,
    and only it and those after it are there.
    """

    seed: int
    found: Mapping[str, Mapping[int, Measured]]


def run(seed: int, dead: float) -> Trial:
    """One orchard, of which this share of the trees dies from each survey to the next.

    Hostile and astray surveys are accepted whatever the judge says, and learned from.
    """
    series = simulate_series(scene(seed, dead), seed, SEASONS)
    surveys = {k: begun(series, k) for k in range(FIRST, SURVEYS)}
    found: dict[str, dict[int, Measured]] = {kind: {} for kind in KINDS}
    with TemporaryDirectory() as folder:
        clean, memory = Path(folder, "memory"), Path(folder, "spoilt")
        for k, survey in surveys.items():
            found["none"][k] = measured(survey, None)
            if k == SPOILT:
                shutil.copytree(clean, memory)
            found["memory"][k] = measured(survey, clean)
        for kind, spoilt in (("hostile", hostile(surveys[SPOILT])), ("astray", astray(surveys[SPOILT]))):
            spoiling = Path(folder, kind)
            shutil.copytree(memory, spoiling)
            found[kind][SPOILT] = measured(spoilt, spoiling, max_failure=1.0)
            for k in range(SPOILT + 1, SURVEYS):
                found[kind][k] = measured(surveys[k], spoiling)
    return Trial(seed, found)


def scene(seed: int, dead: float) -> Scene:
    """The orchard of this seed: of the families in turn, in noise that leaves something to learn."""
    missed, false = np.random.default_rng([seed, 1]).uniform(*NOISE, 2)
    return family_scene(FAMILIES[seed % len(FAMILIES)], seed).model_copy(
        update={**USUALLY, "missed": missed, "false": false, "dead": dead}
    )


def begun(series: SeriesSimulation, survey: int) -> Simulation:
    """One survey of a series beside the first, laid near its true place."""
    pair = pair_of(series, survey)
    return laid(pair, near(pair, series.seed + survey).reference_from_source)


def laid(pair: Simulation, motion: Affine) -> Simulation:
    """The same pair with the source moved."""
    assert pair.truth is not None
    source = pair.source.replace(xy=motion(pair.source.xy))
    return replace(pair, source=source, truth=Rigid.from_matrix((pair.truth @ motion.inverse()).matrix))


def astray(pair: Simulation) -> Simulation:
    """The same pair with the source a row off, so that a local method stays there."""
    _, across = heading(pair)
    return laid(pair, Rigid(np.eye(2), pair.scene.row_spacing * across))


def hostile(pair: Simulation) -> Simulation:
    """The pair with a source that misleads, and lies where it should all the same.

    Half of its trees are missing. It has something confident half way between the trees of each row where it shows
    them, and where the reference has false detections. The surest trees are the least confident, and crowns are dealt
    out anew.
    """
    assert pair.truth is not None
    rng = np.random.default_rng([pair.seed, 2])
    true = np.flatnonzero(pair.source_trees[:, 0] >= 0)
    kept = rng.permutation(true)[: len(true) // 2]
    along, _ = heading(pair)
    middle = pair.trees.xy[pair.source_trees[kept, 0]] + along * pair.scene.spacing / 2
    repeated = pair.reference.xy[pair.reference_trees[:, 0] < 0]
    false = pair.truth.inverse()(np.concatenate([middle, repeated]))
    xy = np.concatenate([pair.source.xy[kept], false])
    confidence = np.concatenate([1 - pair.source.confidence[kept], rng.uniform(0.7, 1, len(false))])
    area = rng.choice(pair.source.area, len(xy))
    trees = np.concatenate([pair.source_trees[kept], np.full((len(false), 2), -1)])
    return replace(pair, source=FeatureSet.of(xy, confidence, area), source_trees=trees)


def measured(pair: Simulation, memory: Path | None, max_failure: float = USUAL) -> Measured:
    """Register a pair with what the memory in this folder knows, and teach it what is accepted."""
    surveys = pair.reference, pair.source
    plan = plan_for(
        Options(method=METHOD, start=IDENTITY, threads=1, memory=memory, max_failure=max_failure), installed()
    )
    context = Recall.of(memory, *surveys).inform(Context(), plan) if memory else Context()
    here = Pair(*surveys)
    truth = np.concatenate(true_landmarks(pair))
    probability = np.concatenate(probabilities(here, context))
    kept = chosen(Landmarks(), here, context)
    said = execute(plan, surveys, Clock()).judgement
    case = of_simulation(pair, METHOD)
    at = np.minimum((probability * BINS).astype(int), BINS - 1)
    return Measured(
        precision=float(truth[kept].mean()),
        brier=float(((probability - truth) ** 2).mean()),
        bins=np.column_stack([np.bincount(at, what, BINS) for what in (np.ones(len(at)), probability, truth)]),
        error=case.error(said.transform) if said.transform else math.inf,
        best=case.fit_error,
        accepted=said.failure_probability <= USUAL,
        right=case.right(said.transform),
    )
