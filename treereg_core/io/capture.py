"""Capture: one survey folder as read and checked, not yet in a working frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import geocentric
from treereg_core.io.files import SurveyFiles, find_files
from treereg_core.io.layer import Layer, layer_of, read_layer
from treereg_core.io.polygons import polygonal
from treereg_core.io.unchanged import stamps, unchanged
from treereg_core.survey import Stamp
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

FEWEST_TREES = 3
FARTHEST_TREE_M = 25_000.0


@dataclass(frozen=True, eq=False)
class Capture:
    """A survey as read, not yet in a working frame; `points` (k, 3): its trees, geocentric, metres.

    `table` is what it was given as, where it comes from no folder; else `stamps` are of its files.
    """

    files: SurveyFiles
    layer: Layer
    boundary: Layer | None
    confidence: FloatArray
    points: FloatArray
    warnings: tuple[str, ...]
    table: GeoDataFrame | None = None
    stamps: Mapping[Path, Stamp] = field(default_factory=dict)


def capture_of(folder: Path, confidence_property: str) -> Capture:
    """Read and check a survey folder; a wrong one raises `InputError`."""
    files = find_files(Path(folder))
    before = stamps(files.present)
    with unchanged(before):
        read = _checked(files, read_layer(files.detections, confidence_property), confidence_property)
    return replace(read, stamps=before)


def capture_of_table(table: GeoDataFrame, name: Path, confidence_property: str) -> Capture:
    """Check a survey that is given as a GeoDataFrame, `name` in errors; a wrong one raises `InputError`."""
    files = SurveyFiles(name, name, None, None, None)
    return replace(_checked(files, layer_of(table, name, confidence_property), confidence_property), table=table)


def _checked(files: SurveyFiles, layer: Layer, confidence_property: str) -> Capture:
    path = files.detections
    if len(layer.geometry) == 0:
        raise InputError(f"{path} holds no features; give it a polygon for each tree.")
    _check_polygons(layer)
    confidence, warnings = _confidences(layer.values, confidence_property, path)
    where = np.flatnonzero(np.isfinite(layer.lonlat).all(axis=1))
    if len(where) < FEWEST_TREES:
        raise too_few(path, len(where), len(layer.geometry))
    points = geocentric(layer.lonlat[where])
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    far = np.flatnonzero(distance > FARTHEST_TREE_M)
    if len(far):
        raise InputError(
            f"{path}: feature {where[far[0]]} (counted from 0) lies {distance[far[0]] / 1000:.0f} km from the middle "
            "of the survey; correct its coordinates or remove it."
        )
    boundary = read_layer(files.boundary) if files.boundary else None
    return Capture(files, layer, boundary, confidence, points, layer.warnings + warnings)


def _check_polygons(layer: Layer) -> None:
    """Every feature must hold something polygonal, or nothing."""
    import shapely

    kinds = shapely.get_type_id(layer.geometry)
    for i in np.flatnonzero((kinds >= 0) & ~np.isin(kinds, (3, 6))):
        geometry = layer.geometry[i]
        if not geometry.is_empty and polygonal(geometry).is_empty:
            raise InputError(
                f"{layer.path}: feature {i} (counted from 0) is a {geometry.geom_type}, but trees are canopy polygons; "
                "export outlines as Polygon or MultiPolygon."
            )


def _confidences(values: list[Any], name: str, path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """The confidences (n,), all 1 with a warning when there are none at all."""
    missing = [i for i, value in enumerate(values) if value is None]
    if len(missing) == len(values):
        return np.ones(len(values)), (f"{path}: no feature has the property {name!r}; every confidence is taken as 1.",)
    if missing:
        raise InputError(
            f"{path}: {len(missing)} of {len(values)} features have no {name!r}, the first is feature {missing[0]} "
            "(counted from 0); give it to all features or to none."
        )
    wrong = [
        i for i, v in enumerate(values) if isinstance(v, bool) or not isinstance(v, int | float) or not 0 <= v <= 1
    ]
    if wrong:
        raise InputError(
            f"{path}: {len(wrong)} of {len(values)} features have a {name!r} that is not a number from 0 to 1, the "
            f"first is feature {wrong[0]} (counted from 0) with {values[wrong[0]]!r:.40}; correct them, or read "
            "another property with --confidence-property."
        )
    return np.array(values, dtype=np.float64), ()


def too_few(path: Path, usable: int, count: int) -> InputError:
    """The error of a survey with fewer trees than can be registered."""
    trees = "tree" if usable == 1 else "trees"
    return InputError(
        f"{path} has {usable} usable {trees} among {count} features, but at least {FEWEST_TREES} are needed; "
        "give it more polygons."
    )
