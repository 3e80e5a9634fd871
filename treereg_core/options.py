"""Options of a run, as the command line, a configuration file or Python give them."""

from __future__ import annotations

import os
import tomllib
from functools import cache
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from treereg_core.transform import Model


@cache
def defaults() -> dict[str, str]:
    """The default `method` and `start`, and those of `treereg rows` and `treereg series`; from `defaults.toml`."""
    return tomllib.loads(Path(__file__).with_name("defaults.toml").read_text(encoding="utf-8"))


class Options(BaseModel):
    """What a run is to do, apart from the surveys themselves."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: str = Field(default_factory=lambda: defaults()["method"], description="the method expression")
    start: str = Field(
        default_factory=lambda: defaults()["start"],
        description="where matching begins: a coarse aligner, `identity`, or a .json file with a transform",
    )
    model: Model = Field(Model.RIGID, description="the kind of transform to fit")
    georeference_sd: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="how far the files' own georeference may be off, 1 sd per axis; none: unknown",
        json_schema_extra={"unit": "m"},
    )
    max_failure: float = Field(0.001, ge=0, le=1, description="accepted only at a failure probability of at most this")
    memory: Path | None = Field(None, description="the folder of what earlier surveys of this orchard taught")
    settings: dict[str, dict[str, object]] = Field({}, description="by stage and parameter")
    seed: int = Field(0, ge=0, description="everything random derives from it")
    threads: int = Field(
        default_factory=lambda: os.cpu_count() or 1,
        ge=1,
        description="how many threads a stage may use; results do not depend on it",
    )
