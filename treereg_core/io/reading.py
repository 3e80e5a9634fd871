"""Reading surveys: from the files of a folder to trees in one working frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.capture import Capture, capture_of, capture_of_table
from treereg_core.io.crs import WGS84, crs_name, geocentric, is_true_metres, parse_crs, place_of, to_frame, zone_crs
from treereg_core.io.place import place
from treereg_core.io.raster import open_raster
from treereg_core.io.unchanged import unchanged
from treereg_core.survey import Frame, Survey
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

FARTHEST_SURVEY_M = 2_000.0


def read_survey(folder: Path, *, frame: Frame | None = None, confidence_property: str = "confidence") -> Survey:
    """Read a survey folder into a working frame; without one, into the survey's own.

    The working CRS is that of the survey's rasters where it is projected and in true metres, else the UTM zone of its
    trees. Unusable features are dropped with a warning. Raises `InputError` for anything that cannot be used, or that
    changes meanwhile.
    """
    capture = capture_of(folder, confidence_property)
    with unchanged(capture.stamps):
        return place(capture, frame or own_frame(capture))


def read_surveys(
    reference: Path | GeoDataFrame,
    source: Path | GeoDataFrame,
    *,
    confidence_property: str = "confidence",
    same_place: bool = True,
) -> tuple[Survey, Survey]:
    """Read two surveys, each a folder or a GeoDataFrame of canopies, both into the reference's working frame.

    Raises `InputError` as `read_survey` does, and, with `same_place`, when they lie more than 2 km apart.
    """
    fixed, moving = (
        capture_of(Path(given), confidence_property)
        if isinstance(given, str | Path)
        else capture_of_table(given, Path(name), confidence_property)
        for name, given in (("reference", reference), ("source", source))
    )
    if same_place:
        _check_same_place(fixed, moving)
    with unchanged({**fixed.stamps, **moving.stamps}):
        frame = own_frame(fixed)
        return place(fixed, frame), place(moving, frame)


def read_series(folders: Sequence[Path], *, confidence_property: str = "confidence") -> Iterator[Survey | InputError]:
    """Read survey folders one by one, all into the working frame of the first.

    For one that cannot be used, or lies more than 2 km from the first, its error is given in its stead; that of the
    first is raised.
    """
    first = capture_of(folders[0], confidence_property)
    with unchanged(first.stamps):
        frame = own_frame(first)
        survey = place(first, frame)
    yield survey
    for folder in folders[1:]:
        try:
            capture = capture_of(folder, confidence_property)
            _check_same_place(first, capture)
            with unchanged(capture.stamps):
                survey = place(capture, frame)
            yield survey
        except InputError as error:
            yield error


def _check_same_place(reference: Capture, source: Capture) -> None:
    apart = _apart(reference.points, source.points)
    if apart <= FARTHEST_SURVEY_M:
        return
    both = f"{reference.files.detections} and {source.files.detections}"
    swapped = source.layer.lonlat[np.isfinite(source.layer.lonlat).all(axis=1), ::-1]
    swappable = source.layer.geographic and (np.abs(swapped[:, 1]) <= 90).all()
    if swappable and _apart(reference.points, geocentric(swapped)) <= FARTHEST_SURVEY_M:
        raise InputError(
            f"{both} agree only when longitude and latitude are swapped in one of them; write longitude first in both."
        )
    raise InputError(
        f"{both} are in different places, {apart / 1000:,.1f} km apart; give two surveys of one orchard, or "
        "correct the CRS of the wrong one."
    )


def _apart(points: FloatArray, others: FloatArray) -> float:
    """The least distance between two sets of geocentric points, metres."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(points).query(others)
    return float(np.min(distance))


def own_frame(capture: Capture) -> Frame:
    """The working frame that a survey brings along when it is the reference."""
    centre = place_of(capture.points)
    crs = zone_crs(centre)
    for path in (capture.files.visible, capture.files.dem):
        raster = _raster_crs(path, centre) if path else None
        if raster:
            crs = raster
            break
    xy = to_frame(centre[None, :], WGS84, Frame(crs, (0.0, 0.0)))[0]
    return Frame(crs, (float(round(xy[0])), float(round(xy[1]))))


def _raster_crs(path: Path, lonlat: FloatArray) -> str | None:
    """The name of a raster's CRS if it can be the working one."""
    with open_raster(path) as dataset:
        wkt = dataset.crs.to_wkt() if dataset.crs else None
    if not wkt:
        return None
    crs = parse_crs(wkt, path)
    return crs_name(crs) if is_true_metres(crs, lonlat) else None
