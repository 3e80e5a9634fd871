"""Registration of one survey onto another, in Python."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Union

import numpy as np

from treereg_core import io
from treereg_core.description import describe
from treereg_core.errors import InputError, NoRegistration, UsageError
from treereg_core.features import FeatureSet
from treereg_core.method import Context, silent
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.recall import Recall, memory_named
from treereg_core.registry import installed
from treereg_core.result import Result, points_of, trees
from treereg_core.settings import record
from treereg_core.survey import Survey
from treereg_core.transform import FloatArray, Model

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

Trees = Union[str, Path, "GeoDataFrame", FloatArray, FeatureSet, Survey]
FEWEST_TREES = 3
CLOSEST_M = 0.01
"""Trees that stand closer are in degrees, not in metres."""


def register(
    reference: Trees,
    source: Trees,
    *,
    method: str | None = None,
    start: str | Path | None = None,
    model: Model | str = Model.RIGID,
    georeference_sd: float | None = None,
    max_failure: float = 0.001,
    memory: str | Path | None = None,
    settings: Mapping[str, Mapping[str, object]] | None = None,
    seed: int = 0,
    threads: int | None = None,
    confidence_property: str = "confidence",
) -> Result:
    """Register `source` onto `reference`: the same as `treereg run`, as an object, and no file of a run is written.

    Each is a survey folder or a GeoDataFrame of canopy polygons (any CRS; confidences in the column
    `confidence_property`); or both are arrays (n, 2) in one frame, metres, or `FeatureSet.of(xy, confidence, area)`; or
    both are `Survey` objects in one frame. The more is known of the trees, the surer the answer: give areas if you can.
    `method` and `start` default to the best measured; `settings` are by stage and parameter; `memory` is the folder of
    what earlier surveys of this orchard taught, which an accepted registration adds to; the rest is as in
    `treereg run --help`. Raises `InputError` for surveys and `UsageError` for options that cannot be used.
    """
    given = {
        "method": method,
        "start": None if start is None else str(start),
        "model": model,
        "georeference_sd": georeference_sd,
        "max_failure": max_failure,
        "memory": memory,
        "settings": {stage: dict(values) for stage, values in (settings or {}).items()},
        "seed": seed,
        "threads": threads,
    }
    options = record(Options, {name: value for name, value in given.items() if value is not None}, str)
    plan = plan_for(options, installed())
    clock = Clock()
    with clock("read"):
        surveys = read(reference, source, plan, confidence_property)
    return execute(plan, surveys, clock)


def read(
    reference: Trees, source: Trees, plan: Plan, confidence_property: str
) -> tuple[Survey, Survey] | tuple[FeatureSet, FeatureSet]:
    """Both as surveys, or both as trees, in one frame."""
    if isinstance(reference, FeatureSet | np.ndarray) and isinstance(source, FeatureSet | np.ndarray):
        return checked(reference, "reference"), checked(source, "source")
    if isinstance(reference, Survey) and isinstance(source, Survey):
        if reference.frame != source.frame:
            raise UsageError(
                "the two surveys are not in one frame; read them together with treereg_core.io.read_surveys"
            )
        return reference, source
    given = [Path(one) if isinstance(one, str) else one for one in (reference, source)]
    if all(isinstance(one, Path) or io.is_geoframe(one) for one in given):
        same_place = plan.start_file is None
        return io.read_surveys(*given, confidence_property=confidence_property, same_place=same_place)
    raise UsageError(
        "give each survey as a folder or a GeoDataFrame, or both as arrays (n, 2) or FeatureSet objects in one frame, "
        "or both as Survey objects"
    )


def checked(given: FeatureSet | FloatArray, role: str) -> FeatureSet:
    """Trees that were given as arrays. `InputError` for those that cannot be trees."""
    trees = given if isinstance(given, FeatureSet) else FeatureSet.of(points_of(given, f"trees of the {role}"))
    if len(trees) < FEWEST_TREES:
        raise InputError(f"the {role} has {len(trees)} trees, but at least {FEWEST_TREES} are needed.")
    if not (trees.area > 0).all() or not ((trees.confidence >= 0) & (trees.confidence <= 1)).all():
        raise InputError(
            f"the {role} has an area that is not positive or a confidence beyond 0 to 1; mend or remove it."
        )
    if 0 < trees.spacing < CLOSEST_M:
        raise InputError(
            f"the trees of the {role} stand {trees.spacing:.2g} m apart, so these are not metres; give longitude and "
            "latitude as a GeoDataFrame with its CRS."
        )
    return trees


def execute(
    plan: Plan,
    surveys: tuple[Survey, Survey] | tuple[FeatureSet, FeatureSet],
    clock: Clock,
    progress: Callable[[str], None] = silent,
) -> Result:
    """Carry out a plan: the starts, the stages from each, and the judge over all that comes out.

    Where the plan has a memory, the stages know it, and an accepted registration is learned from. The filters say what
    they know of all trees at the placement that is found. `InputError` for the memory of another orchard.
    """
    options = plan.options
    threads = min(options.threads, os.cpu_count() or 1)
    context = Context(options.model, options.seed, threads, options.georeference_sd, progress)
    recall = Recall.of(options.memory, *surveys) if options.memory else None
    if recall:
        context = recall.inform(context, plan)
    pair = Pair(trees(surveys[0]), trees(surveys[1]))
    with clock("start"):
        begins = starts(plan, pair, surveys[0], context)
    progress(f"match: {options.method}, starts: {len(begins)}")
    with memory_named(options.memory):
        candidates, why = plan.pipeline.candidates(begins, context, clock)
    progress("judge")
    with clock("judge"):
        judgement = plan.judge.judge(pair, [c.registration for c in candidates], context, options.max_failure)
    if why and not candidates:
        judgement = replace(judgement, reason=f"{judgement.reason.rstrip('.')}: {why.rstrip('.')}.")
    result = Result(plan, surveys[0], surveys[1], judgement, dict(clock.seconds))
    if judgement.transform is None:
        return result
    rows = next((c.rows for c in candidates if c.registration.transform == judgement.transform), None)
    placed = replace(pair, reference_from_source=judgement.transform, rows=rows)
    described, warnings = describe(plan.pipeline.stages, placed, context, clock)
    if recall and result.accepted:
        with clock("learn"):
            warnings += recall.learn(plan, placed, judgement.matches.pairs, progress)
    return replace(result, timings=dict(clock.seconds), warnings=warnings, described=described, rows=rows)


def starts(plan: Plan, pair: Pair, reference: Survey | FeatureSet, context: Context) -> tuple[Pair, ...]:
    """The placements from which the stages begin; none when the coarse aligner finds nothing."""
    context.progress(f"start: {plan.options.start}")
    if plan.aligner:
        try:
            return plan.aligner.propose(pair, context)
        except NoRegistration as reason:
            context.progress(f"{plan.aligner.name} found no start: {reason}")
            return ()
    if plan.start_file is None:
        return (pair,)
    if not isinstance(reference, Survey):
        raise UsageError(f"start {str(plan.start_file)!r}: a start from a file needs surveys that have a CRS")
    return (pair.at(io.read_transform(plan.start_file, reference.frame)),)
