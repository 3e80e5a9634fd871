"""Writing what methods give: moved features, matches, rows, JSON. Every file is complete or absent."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.io import geojson
from treereg_core.io.complete import complete_file
from treereg_core.io.crs import WGS84, crs_name, from_frame, to_frame
from treereg_core.io.feature_pieces import T, Use, check_pieces, in_pieces
from treereg_core.io.files import DETECTIONS, SUFFIXES, collector_paused, reason
from treereg_core.io.geojson_writing import feature_lines, write_columns, write_features, write_lines
from treereg_core.io.jsontext import readable
from treereg_core.io.staging import settle_left
from treereg_core.io.tables import read_table, table_of
from treereg_core.judgement import Matches
from treereg_core.method import Described
from treereg_core.pair import Rows
from treereg_core.survey import Survey
from treereg_core.transform import Affine, FloatArray


def write_registered(
    source: Survey, transform: Affine, path: Path, described: Mapping[str, FloatArray] | None = None
) -> None:
    """Write the source's features moved into the reference, as GeoJSON in WGS 84 with 9 decimals.

    `transform` is `reference_from_source` in the working frame. All features are written in their order, unusable ones
    too, with all their properties as they stand in the source's file. `described` has a number for each usable tree, by
    name: a further property, with 6 decimals, null for an unusable feature; one of that name in the file is replaced.
    Raises `InputError` when that file changed beyond reading, or `path` cannot be written.
    """

    first: list[FloatArray] = []  # of all positions: where it lies says which longitudes run on beyond 180 degrees

    def moved(xy: FloatArray) -> FloatArray:
        first[:] = first or [xy[:1]]
        there = transform(to_frame(np.concatenate([first[0], xy]), crs, source.frame))
        return from_frame(there, source.frame)[1:]

    def written(features: list[dict[str, Any]], number: int) -> bytes:
        geojson.move(features, moved, source.detections)
        for name, values in known.items():
            _add_property(features, number, name, values)
        return feature_lines(features, path)

    ids = source.features.ids.tolist()
    known = {name: dict(zip(ids, _rounded(values), strict=True)) for name, values in (described or {}).items()}
    with collector_paused():
        members, crs, each = source_features(source)
        write_lines(each(written), path, members)


def source_features(source: Survey) -> tuple[dict[str, Any], str, Callable[[Use[T]], list[T]]]:
    """Further members of a survey's file, its CRS, and what gives its features, in that CRS, to a use of them."""
    path = source.detections
    if source.table is not None or path.suffix != ".geojson":
        table = read_table(path) if source.table is None else table_of(source.table, path)
        return {}, crs_name(table.crs) if table.crs else WGS84, table.in_pieces
    document = check_pieces(path)
    outdated = {"type", "features", "crs", "bbox"}
    members = {key: item for key, item in document.items() if key not in outdated}
    collection = document["type"] == "FeatureCollection"
    crs = crs_name(geojson.crs_of(document, path))
    return members if collection else {}, crs, lambda use: in_pieces(path, use)[1]


def _add_property(features: list[dict[str, Any]], first: int, name: str, values: Mapping[int, float]) -> None:
    """Give every feature a property, in place: the value of its number, null where there is none."""
    for number, feature in enumerate(features, first):
        own = feature.get("properties")
        feature["properties"] = {**(own if isinstance(own, dict) else {}), name: values.get(number)}


def _rounded(values: FloatArray) -> list[float]:
    return [round(value, 6) for value in values.tolist()]


def write_matches(
    surveys: tuple[Survey, Survey],
    transform: Affine,
    matches: Matches,
    path: Path,
    described: Described = ({}, {}),
) -> None:
    """Write one LineString per matched pair, from the moved source centroid to the reference's, as GeoJSON in WGS 84.

    `surveys` are reference and source, `transform` is `reference_from_source` in the working frame that both share.
    Properties: `reference` and `source` (indices of the features in their files), `residual_m`, and for each name in
    `described` the number of the tree, with `reference_` or `source_` before it. Raises `ValueError` for an unknown id.
    """
    trees = surveys[0].features, surveys[1].features
    columns, lines = matched(trees, transform, matches, described)
    lonlat = np.round(from_frame(lines.reshape(-1, 2), surveys[0].frame), 9)
    write_columns(columns, "LineString", lonlat.reshape(lines.shape), path)


def matched(
    trees: tuple[FeatureSet, FeatureSet], transform: Affine, matches: Matches, described: Described
) -> tuple[dict[str, list[Any]], FloatArray]:
    """The properties of the matched pairs by name, and their lines (k, 2, 2) in the working frame, metres."""
    reference, source = trees
    at_reference = reference.positions(matches.pairs[:, 0])
    at_source = source.positions(matches.pairs[:, 1])
    if (at_reference < 0).any() or (at_source < 0).any():
        raise ValueError("a match names a tree that is not in its survey")
    starts = transform(source.xy[at_source])
    ends = reference.xy[at_reference]
    columns: dict[str, list[Any]] = {
        "reference": matches.pairs[:, 0].tolist(),
        "source": matches.pairs[:, 1].tolist(),
        "residual_m": _rounded(matches.residual),
    }
    for side, at, known in zip(("reference", "source"), (at_reference, at_source), described, strict=True):
        columns |= {f"{side}_{name}": _rounded(values[at]) for name, values in known.items()}
    return columns, np.stack([starts, ends], axis=1)


def write_rows(survey: Survey, rows: Rows, path: Path, plugins: Mapping[str, str]) -> None:
    """Write one LineString per row through the centroids of its trees, as GeoJSON in WGS 84.

    `plugins` names the distribution of each method that found them; it becomes a member of the collection.

    Rows are of two trees or more, in the order and sense in which they are to be counted. Properties: `row` and
    `tree_numbers`, counted from 1, `trees` (indices of the features in the survey's file) and `length_m`, along the
    line. The folder of `path` is made where there is none. Raises `ValueError` for an unknown id, `InputError` when
    `path` cannot be written.
    """
    features = []
    for number, row in enumerate(rows.trees, start=1):
        at = survey.features.positions(row)
        if (at < 0).any():
            raise ValueError("a row holds a tree that is not in its survey")
        xy = survey.features.xy[at]
        properties = {
            "row": number,
            "trees": row.tolist(),
            "tree_numbers": list(range(1, len(row) + 1)),
            "length_m": round(float(np.hypot(*np.diff(xy, axis=0).T).sum()), 3),
        }
        lonlat = np.round(from_frame(xy, survey.frame), 9).tolist()
        geometry = {"type": "LineString", "coordinates": lonlat}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({reason(error)}); choose another place.") from error
    settle_left(path.parent)
    write_features(features, path, {"plugins": dict(plugins)})


def is_survey_file(name: str) -> bool:
    """Whether a file of this name, in a survey folder, would be read as its detections or its boundary."""
    return name in {stem + suffix for stem in (*DETECTIONS, "boundary") for suffix in SUFFIXES}


def write_json(path: Path, value: Any) -> None:
    """Write a JSON value for people to read: indented, short parts and rows of matrices on one line each.

    Raises `ValueError` for NaN or infinity, `InputError` when `path` cannot be written.
    """
    text = readable(value) + "\n"
    with complete_file(path) as file:
        file.write(text.encode(errors="backslashreplace"))  # half surrogates, as in odd names of folders


def write_text(path: Path, text: str) -> None:
    """Write a text. `InputError` when `path` cannot be written."""
    with complete_file(path) as file:
        file.write(text.encode(errors="backslashreplace"))
