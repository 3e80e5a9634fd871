"""Checkpoints: points that a person found in two surveys, independent of any registration."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import WGS84, to_frame
from treereg_core.io.files import reading
from treereg_core.survey import Frame
from treereg_core.transform import FloatArray

PROJECTED = ("reference_x", "reference_y", "source_x", "source_y")
DEGREES = ("reference_lon", "reference_lat", "source_lon", "source_lat")


def read_checkpoints(path: Path, frame: Frame) -> tuple[FloatArray, FloatArray]:
    """The same points in the reference and in the source (k, 2), metres in the working frame.

    The file is CSV with the columns `reference_x, reference_y, source_x, source_y`, full coordinates of the working
    CRS, or `reference_lon, reference_lat, source_lon, source_lat`, WGS 84 degrees; others are left aside. Raises
    `InputError` for a file that cannot be read, holds no point, or something that is no number.
    """
    with reading(path, "a table of checkpoints"), path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.DictReader(file)
        columns = next((names for names in (PROJECTED, DEGREES) if set(names) <= set(rows.fieldnames or ())), None)
        if columns is None:
            raise InputError(f"{path} has no columns {', '.join(PROJECTED)} (or {', '.join(DEGREES)}); name them so.")
        values = []
        for number, row in enumerate(rows, 1):
            try:
                values.append([float(row[name]) for name in columns])
            except (TypeError, ValueError):
                raise InputError(f"{path}: point {number} holds something that is no number; correct it.") from None
    if not values:
        raise InputError(f"{path} holds no point; give it one at least.")
    table = np.array(values)
    if columns is DEGREES:
        points = to_frame(table[:, :2], WGS84, frame), to_frame(table[:, 2:], WGS84, frame)
    else:
        points = table[:, :2] - frame.origin, table[:, 2:] - frame.origin
    if not np.isfinite(points).all():
        raise InputError(f"{path} holds a point that {frame.crs:.40} cannot reach; correct it.")
    return points
