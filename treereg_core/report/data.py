"""The data of a report: everything that the page shows, as plain values."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from treereg_core.io import Preview
from treereg_core.report.canopies import canopies
from treereg_core.report.placements import placements
from treereg_core.report.rows import rows_json
from treereg_core.report.words import chance, headline, sentence
from treereg_core.result import Result, trees
from treereg_core.survey import Survey

SCHEMA = "treereg/report/1"
TIMINGS = "timings_s"
BOUNDARY_STEP_M = 0.5


def report_data(
    result: Result,
    registration: Mapping[str, Any],
    previews: tuple[Preview | None, Preview | None] = (None, None),
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """What the page of a run is drawn from; only `timings_s` differs when the same run is repeated.

    `registration` is the content of registration.json, `previews` are pictures of reference and source. Lengths are
    metres in the working frame about `origin` (full coordinates, easting and northing), those of trees centimetres.
    """
    reference, source = canopies(result)
    images = [_image(preview) for preview in previews]
    return {
        "schema": SCHEMA,
        "headline": headline(result.judgement),
        "sentence": sentence(result.judgement),
        "chance_wrong": chance(result.judgement.failure_probability),
        "registration": {name: value for name, value in registration.items() if name != TIMINGS},
        TIMINGS: registration[TIMINGS],
        "warnings": list(warnings),
        "origin": list(result.frame.origin) if result.frame else [0.0, 0.0],
        "spacing_m": round(trees(result.reference).spacing, 3),
        "reference": {**reference, "image": images[0]},
        "source": {**source, "image": images[1]},
        "placements": placements(result),
        "rows": rows_json(result),
        "boundary": _boundary(result),
    }


def _image(preview: Preview | None) -> dict[str, Any] | None:
    if preview is None:
        return None
    place = preview.frame_from_pixel
    return {
        "url": f"data:image/{preview.kind};base64,{base64.b64encode(preview.image).decode()}",
        "width": preview.width,
        "height": preview.height,
        "matrix": np.column_stack([place.linear, place.shift]).tolist(),
    }


def _boundary(result: Result) -> list[list[list[int]]]:
    """The rings of the orchard's outline, centimetres."""
    if not isinstance(result.reference, Survey) or result.reference.boundary is None:
        return []
    import shapely

    outline = shapely.simplify(result.reference.boundary, BOUNDARY_STEP_M)
    rings = shapely.get_rings(shapely.get_parts(outline))
    return [np.round(100 * shapely.get_coordinates(ring)).astype(int).tolist() for ring in rings]
