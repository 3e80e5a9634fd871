"""`treereg run`: register one survey folder onto another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from treereg_core import io
from treereg_core.api import execute
from treereg_core.cli.completion import starts
from treereg_core.cli.config import Config, given, read_from
from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.cli.demonstration import DEMONSTRATION, made_at, make_orchard, true_error
from treereg_core.cli.help import MATCHING
from treereg_core.cli.options import (
    DEFAULTS,
    ConfidenceProperty,
    ExtentName,
    Force,
    GcpPoints,
    GeoreferenceSd,
    MaxFailure,
    Method,
    ModelName,
    Out,
    Overwrite,
    Rasters,
    ResamplingName,
    Seed,
    Set,
    Threads,
    WorldFile,
    raster_options,
)
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.cli.summary import summary
from treereg_core.errors import UsageError
from treereg_core.io.output import DEFAULT_OUT
from treereg_core.options import Options
from treereg_core.outputs import REGISTRATION, write_result
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.registry import installed
from treereg_core.report import DATA, PAGE, write_report
from treereg_core.settings import record
from treereg_core.survey import Survey
from treereg_core.survey_rasters import raster_plan


def run(
    context: typer.Context,
    reference: Annotated[
        Path | None, typer.Argument(metavar="REFERENCE", help="Survey folder that stays where it is.")
    ] = None,
    source: Annotated[Path | None, typer.Argument(metavar="SOURCE", help="Survey folder that is laid over it.")] = None,
    method: Method = DEFAULTS["method"],
    out: Out = DEFAULT_OUT,
    overwrite: Overwrite = False,
    start: Annotated[
        str,
        typer.Option(
            metavar="NAME|identity|FILE",
            autocompletion=starts,
            rich_help_panel=MATCHING,
            help="A coarse aligner, the files' own georeference, or the transform in a .json file.",
        ),
    ] = DEFAULTS["start"],
    georeference_sd: GeoreferenceSd = None,
    model: ModelName = "rigid",
    max_failure: MaxFailure = 0.001,
    set_: Set = None,
    config: Config = None,
    plugin: Plugin = None,
    memory: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            rich_help_panel=MATCHING,
            help="What earlier surveys of this orchard taught; read, and updated when the result is accepted.",
        ),
    ] = None,
    rasters: Rasters = "cog",
    resampling: ResamplingName = "auto",
    extent: ExtentName = "reference",
    world_file: WorldFile = False,
    gcp_points: GcpPoints = False,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Write report.html, a page to look at, and its data.")
    ] = True,
    force: Force = False,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print registration.json instead of a summary.")] = False,
    confidence_property: ConfidenceProperty = "confidence",
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> int:
    """Register SOURCE onto REFERENCE, two survey folders; without them a demonstration orchard."""
    use_plugins(context, plugin)
    if (reference is None) != (source is None):
        raise UsageError("one survey folder alone cannot be registered; give REFERENCE and SOURCE, or neither.")
    plan = settle(given(context), config)
    beside = raster_options((rasters, resampling, extent), (world_file, gcp_points), plan.options.threads)
    inputs = [folder for folder in (reference, source) if folder]
    with io.OutputFolder(out, inputs=inputs, overwrite=overwrite) as folder:
        truth = None
        if not inputs:
            console.progress("make a demonstration orchard")
            truth = make_orchard(folder / DEMONSTRATION, seed, rasters=beside is not None)
            inputs = [truth.parent / "reference", truth.parent / "source"]
        clock = Clock()
        surveys = read(inputs, plan, confidence_property, clock)
        if truth:
            places = (out / DEMONSTRATION / "reference", out / DEMONSTRATION / "source")
            surveys = made_at(places[0], surveys[0]), made_at(places[1], surveys[1])
        for warning in (*surveys[0].warnings, *surveys[1].warnings):
            console.warn(warning)
        moving = raster_plan(surveys, beside, folder) if beside else None
        for warning in moving.warnings if moving else ():
            console.warn(warning)
        result = execute(plan, surveys, clock, console.progress)
        for warning in result.warnings:
            console.warn(warning)
        written = write_result(result, folder, force, moving, console.share)
        for warning in written.warnings:
            console.warn(warning)
        for warning in write_report(result, folder) if report else ():
            console.warn(warning)
        error_m = true_error(result, truth) if truth else None
        text = (folder / REGISTRATION).read_bytes()
    if as_json:
        console.hand_over(text)
        if error_m is not None:
            console.note(f"true error {error_m:.3f} m")
    else:
        console.show(summary(result, out, (*written.names, *((PAGE, DATA) if report else ())), error_m))
    return 0 if result.accepted else 3


def settle(values: Mapping[str, object], config: Path | None) -> Plan:
    """The plan of these options."""
    with read_from(config):
        return plan_for(record(Options, values, option_name), installed())


def option_name(field: str) -> str:
    """The long option of a field of the options."""
    return "--" + field.replace("_", "-")


def read(folders: Sequence[Path], plan: Plan, confidence_property: str, clock: Clock) -> tuple[Survey, Survey]:
    """The two surveys in one frame."""
    console.progress("read")
    with clock("read"):
        return io.read_surveys(
            folders[0], folders[1], confidence_property=confidence_property, same_place=plan.start_file is None
        )
