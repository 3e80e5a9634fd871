"""A simulation as survey folders, as a drone company would deliver them; those of a pair with their truth."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.errors import UsageError
from treereg_core.features import FeatureSet, IntArray
from treereg_core.simulate.canopy import canopies
from treereg_core.simulate.images import write_images
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.scenery import Scenery
from treereg_core.simulate.series import SeriesSimulation
from treereg_core.simulate.simulation import Simulation
from treereg_core.transform import FloatArray, Rigid

SCHEMA = "treereg/truth/1"
DECIMALS = 9
FIRST_YEAR = 2021
"""The name of the first survey of a series."""
Origin = tuple[float, float]


def write_simulation(
    simulation: Simulation,
    folder: Path,
    crs: str = "EPSG:32734",
    origin: Origin = (343_000.0, 6_306_000.0),
    rasters: bool = False,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> None:
    """Write `folder`/reference, `folder`/source and, last of all, `folder`/truth.json.

    With `rasters` both surveys have their images too, which takes some seconds; `progress` is given the name of a
    survey and the share of its images that is done.

    `crs` is projected and in metres, `origin` the full coordinates, easting and northing, of the orchard's centre; the
    defaults lie among the orchards of Ceres, South Africa. Each file is complete or absent. Raises `UsageError` when
    the folder cannot be written.
    """
    surveys = {"reference": simulation.reference, "source": simulation.source}
    outlines = _outlines(surveys.values(), simulation.seed)
    boundary = _boundary(simulation.scene, simulation.outline)
    _write_surveys(surveys, outlines, boundary, (folder, crs, origin))
    with _writing(folder):
        for which, flight in enumerate(simulation.flights if rasters else ()):
            name = list(surveys)[which]
            scenery = Scenery.of(flight, surveys[name], outlines[which], simulation.seed, which)
            write_images(scenery, folder / name, crs, origin, partial(progress, name))
        _write(folder / "truth.json", _object(_truth(simulation, crs, origin)))


def write_series(
    simulation: SeriesSimulation, folder: Path, crs: str = "EPSG:32734", origin: Origin = (343_000.0, 6_306_000.0)
) -> tuple[Path, ...]:
    """Write a survey folder for each survey of a series, named by years, and give them in order of time.

    The arguments are those of `write_simulation`.
    """
    surveys = {str(FIRST_YEAR + k): capture.features for k, capture in enumerate(simulation.captures)}
    boundary = _boundary(simulation.scene, simulation.lives.orchard.outline)
    _write_surveys(surveys, _outlines(surveys.values(), simulation.seed), boundary, (folder, crs, origin))
    return tuple(folder / name for name in surveys)


def _outlines(surveys: Iterable[FeatureSet], seed: int) -> list[FloatArray]:
    """The canopy outlines of each survey."""
    surveys = list(surveys)
    return [canopies(s, rng) for s, rng in zip(surveys, np.random.default_rng(seed).spawn(len(surveys)), strict=True)]


def _write_surveys(
    surveys: Mapping[str, FeatureSet],
    outlines: Sequence[FloatArray],
    boundary: FloatArray,
    place: tuple[Path, str, Origin],
) -> None:
    """A survey folder for each of these, with one boundary; `place` is the folder above, the CRS and the origin."""
    import pyproj

    folder, crs, origin = place
    degrees_from_crs = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)

    def to_degrees(points: FloatArray) -> FloatArray:
        full = points + np.asarray(origin)
        return np.round(np.stack(degrees_from_crs.transform(full[..., 0], full[..., 1]), axis=-1), DECIMALS)

    outline = _collection([_feature({}, to_degrees(boundary))])
    with _writing(folder):
        for (name, features), rings in zip(surveys.items(), outlines, strict=True):
            (folder / name).mkdir(parents=True, exist_ok=True)
            _write(folder / name / "raw-detections.geojson", _detections(features, to_degrees(rings)))
            _write(folder / name / "boundary.geojson", outline)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UsageError(f"{folder} cannot be written ({error.strerror}); choose another folder.") from error


def _boundary(scene: Scene, outline: FloatArray) -> FloatArray:
    """The outline with half a row's room around it, so that the outermost canopies lie inside: (k, 2) metres."""
    import shapely

    room = max(scene.row_spacing, scene.spacing) / 2
    block = shapely.Polygon(outline).buffer(room, join_style="mitre", mitre_limit=2).simplify(0.01)
    return np.asarray(shapely.get_coordinates(block.normalize().exterior.reverse())[:-1])


def _detections(features: FeatureSet, rings: FloatArray) -> str:
    return _collection(
        _feature({"confidence": confidence}, ring)
        for confidence, ring in zip(features.confidence.tolist(), rings, strict=True)
    )


def _feature(properties: dict[str, Any], ring: FloatArray) -> str:
    corners = ring.tolist()
    geometry = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
    return json.dumps({"type": "Feature", "properties": properties, "geometry": geometry})


def _collection(features: Iterable[str]) -> str:
    """A FeatureCollection with one feature to a line."""
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(features) + "\n]}\n"


def _truth(simulation: Simulation, crs: str, origin: Origin) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "crs": crs,
        "transform": simulation.truth and _transform(simulation.truth, simulation.source, origin),
        "seed": simulation.seed,
        "scene": simulation.scene.model_dump(mode="json"),
        "vertical_offset_m": simulation.vertical_offset(),
        "trees": _trees(simulation, origin),
        "reference_trees": _lists(simulation.reference_trees),
        "source_trees": _lists(simulation.source_trees),
    }


def _transform(truth: Rigid, source: FeatureSet, origin: Origin) -> dict[str, Any]:
    centroid = source.xy.mean(axis=0, keepdims=True)
    return {
        "model": "rigid",
        "matrix": truth.about(-np.asarray(origin)).matrix.tolist(),
        "rotation_deg": truth.rotation_deg,
        "translation_m": (truth(centroid) - centroid)[0].tolist(),
    }


def _trees(simulation: Simulation, origin: Origin) -> list[dict[str, Any]]:
    trees = simulation.trees
    heights = simulation.heights().round(4)
    columns = {
        "xy": (trees.xy + np.asarray(origin)).round(4).tolist(),
        "area": trees.area.round(4).tolist(),
        "row": trees.row.tolist(),
        "height": _or_null(heights[:, 0]),
        "source_height": _or_null(heights[:, 1]),
    }
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _or_null(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _lists(trees: IntArray) -> list[list[int]]:
    return [[tree for tree in pair if tree >= 0] for pair in trees.tolist()]


def _object(values: dict[str, Any]) -> str:
    """A JSON object with one member to a line."""
    return "{\n" + ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in values.items()) + "\n}\n"


def _write(path: Path, text: str) -> None:
    """The whole file, or none: written aside, then renamed."""
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
