"""Detection of the rows of one survey, in Python."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from treereg_core import io
from treereg_core.errors import NoRegistration, UsageError
from treereg_core.expression import Expression, parse
from treereg_core.features import FeatureSet
from treereg_core.method import Context, FeatureFilter, Method, RowDetector, silent
from treereg_core.numbering import numbered
from treereg_core.options import defaults
from treereg_core.pair import Pair, Rows
from treereg_core.registry import STAGES, Registry, installed
from treereg_core.settings import check_used, merge, record
from treereg_core.survey import Survey


class RowOptions(BaseModel):
    """How rows are to be detected, apart from the survey itself."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: str = Field(default_factory=lambda: defaults()["rows"], description="filters, then one row detector")
    settings: dict[str, dict[str, object]] = Field({}, description="by stage and parameter")
    seed: int = Field(0, ge=0, description="everything random derives from it")
    threads: int = Field(
        default_factory=lambda: os.cpu_count() or 1, ge=1, description="how many threads a stage may use"
    )


@dataclass(frozen=True)
class RowPlan:
    """The filters and the detector of a run, each with its settings; `plugins` names the distribution of each."""

    options: RowOptions
    filters: tuple[FeatureFilter, ...]
    detector: RowDetector
    plugins: Mapping[str, str]


def detect_rows(
    survey: str | Path | Survey | FeatureSet,
    *,
    method: str | None = None,
    settings: Mapping[str, Mapping[str, object]] | None = None,
    seed: int = 0,
    threads: int | None = None,
) -> Rows:
    """The rows of one survey as people count them: the same as `treereg rows`, and nothing is written.

    `survey` is a survey folder, a `Survey`, or a `FeatureSet` in metres with `xy` east and north. `method` is a row
    detector with filters before it that need no second survey; the default is in `defaults.toml`. `settings` are by
    stage and parameter. In the result row 1 is `trees[0]` and its tree 1 `trees[0][0]`, at the north-west corner
    (`treereg_core.numbering`); each row holds the ids of two trees or more.

    Raises `InputError` for a survey and `UsageError` for options that cannot be used, `NoRegistration` when there are
    no rows.
    """
    given = {
        "method": method,
        "settings": {stage: dict(values) for stage, values in (settings or {}).items()},
        "seed": seed,
        "threads": threads,
    }
    options = record(RowOptions, {name: value for name, value in given.items() if value is not None}, str)
    plan = row_plan(options, installed())
    read = io.read_survey(Path(survey)) if isinstance(survey, str | Path) else survey
    return carry_out(plan, read.features if isinstance(read, Survey) else read)


def row_plan(options: RowOptions, registry: Registry) -> RowPlan:
    """Settle what detects the rows. `UsageError` for an expression or a setting that is not right."""
    expression = row_expression(options.method, registry)
    check_used(options.settings, [stage.name for stage in expression.stages])
    chosen = merge(expression.settings, options.settings)

    def made(stage: type[Method]) -> Method:
        return record(stage, chosen.get(stage.name, {}), lambda field: f"{stage.name}.{field}")

    stages = [made(stage) for stage in expression.stages]
    filters = tuple(stage for stage in stages if isinstance(stage, FeatureFilter))
    (detector,) = (stage for stage in stages if isinstance(stage, RowDetector))
    return RowPlan(options, filters, detector, registry.origins(options.method, (stage.name for stage in stages)))


def carry_out(plan: RowPlan, features: FeatureSet, progress: Callable[[str], None] = silent) -> Rows:
    """The numbered rows of two trees or more. `NoRegistration` when there are none."""
    options = plan.options
    context = Context(seed=options.seed, threads=min(options.threads, os.cpu_count() or 1), progress=progress)
    progress(f"detect: {options.method}")
    pair = Pair(features, features)
    for stage in plan.filters:
        pair = stage.select(pair, context)
    found = plan.detector.detect(pair.reference, context)
    rows = Rows(tuple(row for row in found.trees if len(row) > 1))
    if not len(rows):
        raise NoRegistration(f"{plan.detector.name} finds no rows")
    return numbered(rows, features)


def row_expression(text: str, registry: Registry) -> Expression:
    """Read an expression for one survey: filters, then a row detector. `UsageError` with the nearest right one."""
    stages: Sequence[type[Method]] = ()
    try:
        expression = parse(text, registry)
        stages = expression.stages
        flaw = flaw_for_one(stages)
        if not flaw:
            return expression
    except UsageError as error:
        flaw = str(error).removeprefix(f"method {text!r}: ").partition("; the nearest right")[0]
    near = nearest_for_one([stage.name for stage in stages] or text.split("+"), registry)
    if near:
        flaw = f"{flaw.partition('; did you mean')[0]}; the nearest expression that detects rows is {near!r}"
    raise UsageError(f"method {text!r}: {flaw}")


def flaw_for_one(stages: Sequence[type[Method]]) -> str | None:
    """Why a right expression does not detect the rows of one survey; None when it does."""
    for stage in stages:
        if issubclass(stage, FeatureFilter) and not stage.needs_pair:
            continue
        if not issubclass(stage, RowDetector):
            return f"{stage.name} ({stage.role}) needs two surveys, and here is one"
    return None


def nearest_for_one(names: Sequence[str], registry: Registry) -> str | None:
    """The expression nearest to these names that detects the rows of one survey; None without a row detector."""
    default, detectors = defaults()["rows"], registry.names(RowDetector)
    if not detectors:
        return None
    known = registry.names(*STAGES)
    names = [near for name in names for near in difflib.get_close_matches(name.strip().lower(), known, n=1)]
    detector = next((name for name in names if name in detectors), default if default in detectors else detectors[0])
    stages = [registry.method(name) for name in dict.fromkeys(names)]
    filters = [stage.name for stage in stages if issubclass(stage, FeatureFilter) and not stage.needs_pair]
    return "+".join([*filters, detector])
