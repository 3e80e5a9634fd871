"""`treereg misregister`: a copy of a survey that lies elsewhere, and the transform that undoes it."""

from __future__ import annotations

import math
from glob import escape
from pathlib import Path
from typing import Annotated, Any

import typer

from treereg_core import io
from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.cli.options import ConfidenceProperty
from treereg_core.errors import UsageError
from treereg_core.io.files import nearest
from treereg_core.io.output import check_place
from treereg_core.misregistration import ROTATION_SD_DEG, TRANSLATION_SD_M, drawn, misregistration
from treereg_core.result import transform_json
from treereg_core.survey import Survey
from treereg_core.survey_copy import survey_copy
from treereg_core.transform import Rigid

SCHEMA = "treereg/misregistration/1"
NAME = "misregistration.json"
Shift = tuple[float, float]


def misregister(
    survey: Annotated[Path, typer.Argument(metavar="SURVEY", help="Survey folder.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help=f"The new survey folder, which gets {NAME} too.")],
    rotation_sd: Annotated[
        float | None,
        typer.Option(min=0, metavar="DEGREES", help=f"A random turn, 1 sd; default: {ROTATION_SD_DEG:g}."),
    ] = None,
    translation_sd: Annotated[
        float | None,
        typer.Option(min=0, metavar="METRES", help=f"A random shift, 1 sd per axis; default: {TRANSLATION_SD_M:g}."),
    ] = None,
    rotation: Annotated[
        float | None, typer.Option(metavar="DEGREES", help="This turn instead, counter-clockwise.")
    ] = None,
    translation: Annotated[
        tuple[float, float] | None, typer.Option(metavar="X Y", help="This shift instead, metres east and north.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same turn and shift.")] = 0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files of the same names, and no others.")
    ] = False,
    confidence_property: ConfidenceProperty = "confidence",
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Copy SURVEY, turned about the centroid of its detections and then shifted; misregistration.json undoes it.

    Vector files move, and GeoTIFFs by their georeference alone, so that no pixel changes. The boundary is copied as it
    is. Other files are left out, with a warning, and folders in SURVEY without one.
    """
    turn, shift = settle((rotation_sd, translation_sd), rotation, translation, seed)
    check_place(out, [survey])
    console.progress(f"read {survey}")
    read = io.read_survey(survey, confidence_property=confidence_property)
    wrong = misregistration(read.features, turn, shift)
    motion = io.Motion(read.frame.crs, wrong.about([-value for value in read.frame.origin]))
    copy = survey_copy(survey, motion, nearest(out))
    for warning in (*read.warnings, *copy.warnings):
        console.warn(warning)
    names = (*copy.names, NAME)
    place = io.OutputFolder(out, inputs=[survey], overwrite=overwrite, names=map(escape, names))
    with place as folder, io.unchanged({**io.stamps(one.path for one in copy.moved), **read.stamps}):
        copy.write(folder, console.progress)
        io.write_json(folder / NAME, record(read, wrong, turn, shift))
    if not console.quiet:
        moved = f"turned {turn:+.4f} deg, shifted {shift[0]:+.3f} m east, {shift[1]:+.3f} m north"
        console.show("\n".join([moved, *(f"  {out / name}" for name in names)]))


def settle(
    spread: tuple[float | None, float | None], rotation: float | None, translation: Shift | None, seed: int
) -> tuple[float, Shift]:
    """The turn, degrees, and the shift, metres: those given, else drawn. `UsageError` for options that cannot be."""
    for name, sd, given in (("rotation", spread[0], rotation), ("translation", spread[1], translation)):
        if sd is not None and given is not None:
            raise UsageError(f"--{name} and --{name}-sd exclude each other; leave one out.")
        values = [sd] if given is None else [given] if isinstance(given, float) else given
        if not all(value is None or math.isfinite(value) for value in values):
            raise UsageError(f"--{name}{'-sd' if given is None else ''} must be finite; give a number.")
    rotation_sd = ROTATION_SD_DEG if spread[0] is None else spread[0]
    translation_sd = TRANSLATION_SD_M if spread[1] is None else spread[1]
    turn, (east, north) = drawn(seed, rotation_sd, translation_sd)
    return turn if rotation is None else rotation, (float(east), float(north)) if translation is None else translation


def record(survey: Survey, wrong: Rigid, turn: float, shift: Shift) -> dict[str, Any]:
    """What misregistration.json holds: the transform that undoes it, and what was done, for people."""
    moved = survey.features.replace(xy=wrong(survey.features.xy))
    return {
        "schema": SCHEMA,
        "crs": survey.frame.crs,
        "transform": transform_json(wrong.inverse(), moved, survey.frame.origin),
        "undoes": {"rotation_deg": turn, "translation_m": list(shift)},
        "survey": str(survey.path),
    }
