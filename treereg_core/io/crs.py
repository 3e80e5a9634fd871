"""Coordinate reference systems: naming them, choosing the working one, and going from one to another.

All coordinates are east (or longitude) before north, whatever axis order a CRS declares.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from treereg_core.errors import InputError
from treereg_core.survey import Frame
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

WGS84 = "OGC:CRS84"
MAX_SCALE_ERROR = 0.01
"""A projected unit that is further than this from a true metre at the place (Web Mercator's, say) is not a metre."""

NAMES_A_FILE = re.compile(
    r"grids\s*=(?!\s*@null(?:[\s\"'<]|$))|PARAMETERFILE|(?:^|:)(?>[^:]*?\binit\s*=)[^:/\\.]*[/\\.]", re.IGNORECASE
)
"""What stands in the definition of a CRS that PROJ would open files for; the first `init` between two colons tells."""

_A, _E2 = 6378137.0, 0.00669437999014


def parse_crs(name: str, path: Path) -> CRS:
    """The CRS of this name or text, without its vertical part.

    `InputError`, which names the file, for one that is unknown, or that would have other files read.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    check_no_files(str(name), path)
    try:
        crs = CRS.from_user_input(name).to_2d()
        check_no_files(crs.to_wkt(), path)
    except (CRSError, ValueError) as error:  # half a surrogate pair is a ValueError
        raise InputError(
            f"{path} names an unknown CRS ({name!a:.80}); name a known one, such as EPSG:32734."
        ) from error
    return crs


def check_no_files(text: str, path: Path) -> None:
    """Refuse a CRS whose definition names a file: a grid, or one of definitions."""
    if NAMES_A_FILE.search(text):
        raise InputError(f"{path} has a CRS that names another file; name one by its code, such as EPSG:32734.")


def crs_name(crs: CRS) -> str:
    """Its authority code where there is one, else WKT 2."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else crs.to_wkt()


@lru_cache(maxsize=32)
def is_geographic(name: str) -> bool:
    """Whether coordinates in the CRS of this name are degrees."""
    from pyproj import CRS

    return bool(CRS.from_user_input(name).is_geographic)


def is_true_metres(crs: CRS, lonlat: FloatArray) -> bool:
    """Whether a CRS is projected, east before north, with units that are true metres at this place."""
    from pyproj import Proj

    axes = crs.axis_info[:2]
    if not crs.is_projected or {axis.direction for axis in axes} != {"east", "north"}:
        return False
    if any(abs(axis.unit_conversion_factor - 1) > 1e-9 for axis in axes):
        return False
    factors = Proj(crs).get_factors(float(lonlat[0]), float(lonlat[1]))
    scales = (factors.meridional_scale, factors.parallel_scale)
    return all(abs(scale - 1) <= MAX_SCALE_ERROR for scale in scales)


def zone_crs(lonlat: FloatArray) -> str:
    """The UTM zone at a place, or beyond its limits (84 N, 80 S) the polar stereographic CRS in its stead."""
    lon, lat = float(lonlat[0]), float(lonlat[1])
    if lat >= 84:
        return "EPSG:5041"
    if lat <= -80:
        return "EPSG:5042"
    zone = int((lon + 180) // 6) % 60 + 1
    return f"EPSG:{32600 + zone if lat >= 0 else 32700 + zone}"


@lru_cache(maxsize=32)
def converter(source: str, target: str) -> Callable[[FloatArray], FloatArray]:
    """A function that takes coordinates (n, 2) in one CRS to another; those out of reach become infinite.

    `InputError` where there is no way from one to the other, as with a local CRS.
    """
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    if CRS.from_user_input(source).equals(target, ignore_axis_order=True):
        return np.array  # PROJ would swap UPS (N,E) and (E,N), though it gives and takes both east first
    try:
        transformer = Transformer.from_crs(source, target, always_xy=True)
    except ProjError as error:
        raise InputError(
            f"there is no way from the CRS {source!a:.60} to {target!a:.60}; name a known one in the file, such as "
            "EPSG:32734."
        ) from error

    def convert(xy: FloatArray) -> FloatArray:
        if len(xy) == 0:
            return np.empty((0, 2))
        x, y = transformer.transform(xy[:, 0], xy[:, 1])
        return np.column_stack([x, y]).astype(np.float64)

    return convert


def to_frame(xy: FloatArray, crs: str, frame: Frame) -> FloatArray:
    """Coordinates in `crs` to the working frame, metres; infinite where the frame's CRS does not reach."""
    return np.asarray(converter(crs, frame.crs)(xy) - np.array(frame.origin))


def full_coordinates(xy: FloatArray, frame: Frame, crs: str) -> FloatArray:
    """Working coordinates (n, 2), metres, to full ones in `crs`; infinite where that does not reach."""
    full = xy + np.array(frame.origin)
    return full if crs == frame.crs else converter(frame.crs, crs)(full)


def from_frame(xy: FloatArray, frame: Frame) -> FloatArray:
    """Working coordinates, metres, to WGS 84 longitude and latitude, degrees.

    Longitudes run on beyond 180 degrees where a field crosses the antimeridian, so that its polygons stay whole.
    """
    lonlat: FloatArray = converter(frame.crs, WGS84)(xy + np.array(frame.origin))
    if len(lonlat) and abs(lonlat[0, 0]) > 179:
        side = math.copysign(1, lonlat[0, 0])
        lonlat[lonlat[:, 0] * side < -179, 0] += 360 * side
    return lonlat


def geocentric(lonlat: FloatArray) -> FloatArray:
    """Longitude and latitude, degrees (n, 2), to geocentric coordinates on the WGS 84 ellipsoid, metres (n, 3)."""
    lon, lat = np.radians(lonlat).T
    radius = _A / np.sqrt(1 - _E2 * np.sin(lat) ** 2)
    return np.column_stack(
        [radius * np.cos(lat) * np.cos(lon), radius * np.cos(lat) * np.sin(lon), radius * (1 - _E2) * np.sin(lat)]
    )


def place_of(points: FloatArray) -> FloatArray:
    """Longitude and latitude, degrees (2,), of the median of geocentric points, metres (n, 3)."""
    x, y, z = np.median(points, axis=0)
    return np.degrees([math.atan2(y, x), math.atan2(z, (1 - _E2) * math.hypot(x, y))])
