"""The files of a run: registration.json always, the registered files when the result may be used."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from treereg_core import io
from treereg_core.pipeline import Clock
from treereg_core.result import Result
from treereg_core.survey import Survey
from treereg_core.transform import Affine

REGISTRATION = "registration.json"
DETECTIONS = "detections_registered.geojson"
MATCHES = "tree_matches.geojson"
RUN_FILES = (REGISTRATION, DETECTIONS, MATCHES)


def write_result(result: Result, folder: Path, force: bool = False) -> tuple[str, ...]:
    """Write a result of two surveys into a folder and give the names of the files.

    The registered files are written when the result is accepted or with `force`, and never without a placement.
    """
    clock = Clock(dict(result.timings))
    names: tuple[str, ...] = (REGISTRATION,)
    with clock("write"):
        if result.transform is not None and (result.accepted or force):
            write_registered(result, result.transform, folder)
            names = RUN_FILES
    io.write_json(folder / REGISTRATION, replace(result, timings=clock.seconds).to_json())
    return names


def write_registered(result: Result, transform: Affine, folder: Path) -> None:
    """Write the moved detections and the matched pairs. `TypeError` for trees that come from no file."""
    if not isinstance(result.reference, Survey) or not isinstance(result.source, Survey):
        raise TypeError("only surveys that were read from files can be written")
    surveys, described = (result.reference, result.source), result.described
    io.write_registered(result.source, transform, folder / DETECTIONS, described[1])
    io.write_matches(surveys, transform, result.judgement.matches, folder / MATCHES, described)
