"""`treereg series`: register the surveys of one orchard onto the first, and follow every tree through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from treereg_core import io
from treereg_core.cli.columns import GAP, hanging, in_columns
from treereg_core.cli.config import Config, given
from treereg_core.cli.console import Quiet, Verbose, console, width
from treereg_core.cli.options import (
    DEFAULTS,
    ConfidenceProperty,
    GeoreferenceSd,
    MaxFailure,
    Method,
    ModelName,
    Out,
    Overwrite,
    Rasters,
    Seed,
    Set,
    StartName,
    Threads,
    raster_options,
)
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.cli.run import settle
from treereg_core.errors import UsageError
from treereg_core.io.output import DEFAULT_OUT
from treereg_core.series.files import (
    FILES,
    MEMORY,
    RESERVED,
    SERIES,
    counted,
    names_of_earlier,
    write_series,
)
from treereg_core.series.history import State
from treereg_core.series.page import PAGE
from treereg_core.series.registering import Member, Series, carry_out, check_folders, name_of


def series(
    context: typer.Context,
    surveys: Annotated[
        list[Path],
        typer.Argument(metavar="SURVEY...", help="Survey folders in the order of time."),
    ],
    method: Method = DEFAULTS["series"],
    out: Out = DEFAULT_OUT,
    overwrite: Overwrite = False,
    start: StartName = DEFAULTS["start"],
    georeference_sd: GeoreferenceSd = None,
    model: ModelName = "rigid",
    max_failure: MaxFailure = 0.001,
    set_: Set = None,
    config: Config = None,
    plugin: Plugin = None,
    rasters: Rasters = "cog",
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write series.html, a page to look at.")] = True,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print series.json instead of a summary.")] = False,
    confidence_property: ConfidenceProperty = "confidence",
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> int:
    """Register the surveys of one orchard onto the first of them, and follow every tree through time."""
    use_plugins(context, plugin)
    check_folders(surveys)
    taken = next((folder for folder in surveys if name_of(folder) in RESERVED), None)
    if taken is not None:
        raise UsageError(f"{taken} has a name that a file of the results has; rename it.")
    if start.lower().endswith(".json"):
        raise UsageError(f"--start {start}: one transform is no start for several surveys; give a coarse aligner.")
    plan = settle(given(context), config)
    moved = raster_options((rasters, "auto", "reference"), (False, False), plan.options.threads)

    place = io.OutputFolder(out, inputs=surveys, overwrite=overwrite, names=names_of_earlier)
    with place as folder:
        remembering = replace(plan, options=plan.options.model_copy(update={"memory": folder / MEMORY}))
        console.items = len(surveys)
        found = carry_out(remembering, surveys, confidence_property, console.progress, tell)
        for warning in write_series(found, folder, moved, console.share, report):
            console.warn(warning)
        text = (folder / SERIES).read_bytes()
    if as_json:
        console.hand_over(text)
    else:
        console.show(summary(found, out, (*FILES, *([PAGE] if report else []))))
    return 0 if len(found.accepted) == len(found.members) else 3


def tell(member: Member) -> None:
    """What a user should know of a survey as soon as it is done."""
    console.finished += 1
    for found in (member.survey, member.result):
        for warning in found.warnings if found else ():
            console.warn(f"{member.name}: {warning}")
    if member.transform is None:
        reason = member.result.judgement.reason if member.result else member.problem
        console.warn(f"{member.name} adds no trees ({member.word}): {reason}")


def summary(found: Series, out: Path, names: Sequence[str]) -> str:
    """What came of each survey, the states of its probable trees, and where the files are."""
    counts, states = counted(found), [state.word for state in State]
    lines = [["survey", "verdict", *states, "expected error"]]
    for member in found.members:
        of = counts.get(member.name)
        said = member.result.judgement.expected_error if member.result and of else None
        numbers = [str(of[state]) if of else "" for state in states]
        lines.append([member.name, member.word, *numbers, f"{said.rms:.3f} m" if said else ""])
    accepted, others = len(found.accepted) - 1, len(found.members) - 1
    registered = f"{accepted} of {others} surveys registered onto {found.members[0].name}"
    table = [f"  {line}" for line in in_columns(lines, flush_left=2, width=width(GAP))]
    trees = f"{int(found.history.probable.sum())} trees in {found.places.rows} rows"
    files = hanging("  files  ", [str(out / name) for name in names], width())
    return "\n".join([registered, *table, trees, *files])
