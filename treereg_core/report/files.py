"""The files of a report, for a finished run and again from its data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from treereg_core import io
from treereg_core.errors import InputError
from treereg_core.outputs import REGISTRATION
from treereg_core.report.data import SCHEMA, report_data
from treereg_core.report.page import page
from treereg_core.result import Result
from treereg_core.survey import Survey

DATA = "report-data.json"
PAGE = "report.html"
NEEDED = {"headline", "sentence", "registration", "reference", "source", "placements", "timings_s"}


def write_report(result: Result, folder: Path) -> tuple[str, ...]:
    """Write report-data.json and report.html beside the registration.json in `folder`; gives sentences for people.

    Whatever the verdict. An orthomosaic of which no preview can be made is left out, and a sentence says why. Raises
    `InputError` when a file cannot be written, and for surveys whose files are no longer those that were read.
    """
    with io.unchanged(result.stamps):
        previews, warnings = _previews(result)
    registration = io.read_json(folder / REGISTRATION)
    data = report_data(result, registration, previews, (*result.warnings, *warnings))
    io.write_text(folder / DATA, _lines(data))
    io.write_text(folder / PAGE, page(data))
    return warnings


def write_page(folder: Path) -> Path:
    """Make report.html in `folder` again from report-data.json; gives its path.

    Raises `InputError` when that is not the data of a report.
    """
    path = folder / DATA
    io.settle_left(folder)
    data = io.read_json(path)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or not data.keys() >= NEEDED:
        raise InputError(f"{path} is not the data of a report ({SCHEMA}); write it again with treereg run.")
    try:
        text = page(data)
    except ValueError as error:
        raise InputError(f"{path} holds a number that is not finite; write it again with treereg run.") from error
    io.write_text(folder / PAGE, text)
    return folder / PAGE


def _previews(result: Result) -> tuple[tuple[io.Preview | None, io.Preview | None], tuple[str, ...]]:
    """Previews of both orthomosaics, and why one is missing."""
    found: list[io.Preview | None] = []
    warnings: list[str] = []
    for survey in (result.reference, result.source):
        found.append(None)
        try:
            if isinstance(survey, Survey):
                found[-1] = io.read_preview(survey)
        except InputError as error:
            warnings.append(f"{error} The report does without it.")
    return (found[0], found[1]), tuple(warnings)


def _lines(data: Mapping[str, Any]) -> str:
    """JSON with a line for each member."""
    members = (
        f"{json.dumps(name)}: {json.dumps(value, allow_nan=False, separators=(',', ':'))}"
        for name, value in data.items()
    )
    return "{\n" + ",\n".join(members) + "\n}\n"
