"""Plan: what a run will do, settled and checked before any survey is read."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treereg_core import io
from treereg_core.errors import InputError, UsageError
from treereg_core.expression import parse
from treereg_core.judge import Judge
from treereg_core.learning import Learner
from treereg_core.memory import check_methods, load
from treereg_core.method import CoarseAligner, Method
from treereg_core.options import Options
from treereg_core.pipeline import Pipeline
from treereg_core.registry import Registry
from treereg_core.settings import check_used, merge, record

IDENTITY = "identity"


@dataclass(frozen=True)
class Plan:
    """The stages, the start and the judge of a run, each with its settings.

    `aligner` is None when the run starts from the identity or from a file. `plugins` names the distribution of each
    method, and of each recipe.
    """

    options: Options
    pipeline: Pipeline
    aligner: CoarseAligner | None
    judge: Judge
    plugins: Mapping[str, str]

    @property
    def start_file(self) -> Path | None:
        """The file that holds the start, where there is one."""
        return None if self.aligner or self.options.start == IDENTITY else Path(self.options.start)

    @property
    def learners(self) -> dict[str, Learner]:
        """The methods that learn from an accepted registration, by name."""
        return {stage.name: stage for stage in self._stages if isinstance(stage, Learner)}

    @property
    def _stages(self) -> list[Method]:
        return [*([self.aligner] if self.aligner else []), *self.pipeline.stages]

    @property
    def settings(self) -> dict[str, Any]:
        """Every effective value of every stage, by stage."""
        values = {stage.name: stage.model_dump(mode="json") for stage in self._stages if stage.name in self.plugins}
        return {**values, "judge": self.judge.model_dump(mode="json")}


def plan_for(options: Options, registry: Registry) -> Plan:
    """Settle a run. `UsageError` for an expression, start, model or setting that is not right.

    `InputError` for a start or a memory that cannot be used.
    """
    expression = parse(options.method, registry)
    aligner = aligner_named(options.start, registry)
    classes = {stage.name: stage for stage in (*([aligner] if aligner else []), *expression.stages)}
    for name, stage in classes.items():
        if options.model not in stage.models:
            able = ", ".join(model.value for model in type(options.model) if model in stage.models)
            raise UsageError(f"{name} cannot fit the model {options.model.value!r}; it can fit: {able}")
    check_used(options.settings, [*classes, "judge"])
    chosen = merge(expression.settings, options.settings)

    def made(name: str) -> Any:
        return record(classes[name], chosen.get(name, {}), lambda field: f"{name}.{field}")

    plugins = registry.origins(options.method, classes)
    if options.memory:
        check_memory(options.memory, plugins)
    return Plan(
        options=options,
        pipeline=Pipeline.of([made(stage.name) for stage in expression.stages]),
        aligner=made(aligner.name) if aligner else None,
        judge=record(Judge, chosen.get("judge", {}), lambda field: f"judge.{field}"),
        plugins=plugins,
    )


def check_memory(folder: Path, plugins: Mapping[str, str]) -> None:
    """Refuse a memory that cannot be read or written, or was taught to other methods of the same names."""
    io.check_memory_folder(folder)
    memory = load(folder)
    if memory:
        check_methods(folder, memory, plugins)


def aligner_named(start: str, registry: Registry) -> type[CoarseAligner] | None:
    """The coarse aligner of this name; None for the identity or a file."""
    if start == IDENTITY:
        return None
    if start.endswith(".json"):
        if not os.path.isfile(start):
            raise InputError(f"start {start}: there is no such file; give one that holds a transform.")
        return None
    try:
        offer = registry.entry(start, (CoarseAligner,)).offer
    except UsageError as error:
        hint = "" if str(error).endswith("?") else f", or give {IDENTITY!r} or a .json file"
        raise UsageError(f"start {start!r}: {error}{hint}") from None
    if isinstance(offer, type) and issubclass(offer, CoarseAligner):
        return offer
    known = ", ".join([*registry.names(CoarseAligner), IDENTITY])
    raise UsageError(f"start {start!r}: it is not a coarse aligner; give one of {known}, or a .json file")
