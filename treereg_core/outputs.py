"""The files of a run: registration.json always, the registered files when the result may be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from treereg_core import io
from treereg_core.pipeline import Clock
from treereg_core.survey import Survey
from treereg_core.survey_rasters import RasterPlan
from treereg_core.transform import Affine

if TYPE_CHECKING:
    from treereg_core.result import Result

REGISTRATION = "registration.json"
DETECTIONS = "detections_registered.geojson"
MATCHES = "tree_matches.geojson"
RUN_FILES = (REGISTRATION, DETECTIONS, MATCHES)


@dataclass(frozen=True)
class Written:
    """The names of the files that were written, and sentences for people."""

    names: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def write_result(
    result: Result,
    folder: Path,
    force: bool = False,
    rasters: RasterPlan | None = None,
    progress: Callable[[str, float], None] = lambda kind, share: None,
) -> Written:
    """Write a result of two surveys into a folder, its rasters too where there is a plan of them.

    The registered files are written when the result is accepted or with `force`, and never without a placement.
    `progress` is given the kind of a raster and how much of it is done. Raises `InputError` for surveys whose files are
    no longer those that were read.
    """
    with io.unchanged(result.stamps):
        return _write(result, folder, force, rasters, progress)


def _write(
    result: Result,
    folder: Path,
    force: bool,
    rasters: RasterPlan | None,
    progress: Callable[[str, float], None],
) -> Written:
    clock = Clock(dict(result.timings))
    names: tuple[str, ...] = (REGISTRATION,)
    more: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    if result.transform is not None and (result.accepted or force):
        with clock("write"):
            write_registered(result, result.transform, folder)
            names = RUN_FILES
        if rasters and rasters.rasters and result.frame:
            motion = io.Motion(result.frame.crs, result.full_coordinates(result.transform))
            with clock("rasters"):
                more, warnings = rasters.write(motion, folder, progress)
    else:
        clock.seconds.setdefault("write", 0.0)
    io.write_json(folder / REGISTRATION, replace(result, timings=clock.seconds).to_json())
    return Written(names + more, warnings)


def write_registered(result: Result, transform: Affine, folder: Path) -> None:
    """Write the moved detections and the matched pairs. `TypeError` for trees that come from no file."""
    if not isinstance(result.reference, Survey) or not isinstance(result.source, Survey):
        raise TypeError("only surveys that were read from files can be written")
    surveys, described = (result.reference, result.source), result.described
    io.write_registered(result.source, transform, folder / DETECTIONS, described[1])
    io.write_matches(surveys, transform, result.judgement.matches, folder / MATCHES, described)
