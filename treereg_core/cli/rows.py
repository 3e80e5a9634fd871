"""`treereg rows`: the planting rows of one survey, numbered."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from treereg_core import io
from treereg_core.cli.columns import labelled
from treereg_core.cli.completion import row_expressions
from treereg_core.cli.config import Config, given, read_from
from treereg_core.cli.console import Quiet, Verbose, console, width
from treereg_core.cli.options import DEFAULTS, ConfidenceProperty, Seed, Set, Threads
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.detection import RowOptions, RowPlan, carry_out, row_plan
from treereg_core.errors import InputError, NoRegistration, UsageError
from treereg_core.io.files import check_writable, reason
from treereg_core.pair import Rows
from treereg_core.registry import installed
from treereg_core.settings import record
from treereg_core.survey import Survey

DEFAULT_OUT = Path("rows.geojson")


def rows(
    context: typer.Context,
    survey: Annotated[Path, typer.Argument(metavar="SURVEY", help="Survey folder.")],
    method: Annotated[
        str,
        typer.Option(metavar="EXPR", autocompletion=row_expressions, help="Filters, then a row detector, joined by +."),
    ] = DEFAULTS["rows"],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The GeoJSON file to write.")] = DEFAULT_OUT,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file where there is one.")] = False,
    set_: Set = None,
    config: Config = None,
    plugin: Plugin = None,
    seed: Seed = 0,
    threads: Threads = None,
    confidence_property: ConfidenceProperty = "confidence",
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Find the planting rows of one survey; row 1, tree 1 is at the north-west corner."""
    use_plugins(context, plugin)
    with read_from(config):
        plan = row_plan(record(RowOptions, given(context), lambda field: f"--{field}"), installed())
    check_place(out, overwrite)
    console.progress("read")
    read = io.read_survey(survey, confidence_property=confidence_property)
    for warning in read.warnings:
        console.warn(warning)
    try:
        found = carry_out(plan, read.features, console.progress)
    except NoRegistration as reason:
        raise InputError(
            f"{read.detections} shows no rows ({reason}); give a survey of an orchard that is planted in rows, or "
            "another --method."
        ) from reason
    io.write_rows(read, found, out, plan.plugins)
    if not console.quiet:
        console.show(summary(read, found, plan, out))


def check_place(out: Path, overwrite: bool) -> None:
    """Refuse a place that is no GeoJSON file, that is taken, or where a survey would be read from."""
    if out.suffix != ".geojson":
        raise UsageError(f"--out {out}: rows are written as GeoJSON; give a file whose name ends in .geojson.")
    if io.is_survey_file(out.name):
        raise UsageError(f"--out {out} would be read as a file of a survey; give it another name.")
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder; give the name of a file.")
    if not overwrite and (out.exists() or out.is_symlink()):
        raise UsageError(f"{out} is there already; give another file with --out, or replace it with --overwrite.")
    try:
        check_writable(out.parent)
    except OSError as error:
        raise InputError(f"{out} cannot be written ({reason(error)}); choose another place.") from error


def summary(survey: Survey, found: Rows, plan: RowPlan, out: Path) -> str:
    """How many rows and trees, how long and how far apart, and where the file is."""
    steps = [np.hypot(*np.diff(survey.features.xy[survey.features.positions(row)], axis=0).T) for row in found.trees]
    lengths = [step.sum() for step in steps]
    inside = sum(map(len, found.trees))
    lines: dict[str, str | Sequence[str]] = {
        "method": f"{plan.options.method} ({', '.join(dict.fromkeys(plan.plugins.values()))})",
        "trees in rows": f"{inside} of {len(survey.features)} ({len(survey.features) - inside} in none)",
        "length of a row": f"{np.median(lengths):.1f} m (median; {min(lengths):.1f} to {max(lengths):.1f} m)",
        "tree to tree": f"{np.median(np.concatenate(steps)):.2f} m (median)",
        "file": [str(out)],
    }
    head = f"{len(found)} {'row' if len(found) == 1 else 'rows'}"
    return "\n".join([head, *labelled(lines, width())])
