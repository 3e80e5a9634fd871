"""Grids: where the pixels of a raster lie, and which pixel of one raster shows the ground under a pixel of another.

Pixel coordinates are (column, row), counted from the outer corner of the first pixel, so that its centre is (0.5, 0.5).
Coordinates of the ground are full ones, east before north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import converter, is_geographic
from treereg_core.transform import Affine, FloatArray

SLACK = 1e-3
"""A grid that falls short of covering something by less, in pixels, is not made larger for it."""
MOST_PIXELS = 2**31 - 1
"""The most columns or rows that a GeoTIFF can have."""


@dataclass(frozen=True)
class Motion:
    """How the source survey moves: `reference_from_source`, full coordinates in `crs`, projected, metres."""

    crs: str
    reference_from_source: Affine


@dataclass(frozen=True)
class Grid:
    """The pixels of a raster.

    - `map_from_pixel`: takes pixel coordinates to those of `crs`.
    - `crs`: an authority code where there is one, else WKT 2, without a vertical part; `wkt`: the same as the raster's
      file has it, to be written again.
    """

    map_from_pixel: Affine
    width: int
    height: int
    crs: str
    wkt: str

    @property
    def pixel_size(self) -> tuple[float, float]:
        """Width and height of a pixel, units of the CRS, positive."""
        across, down = np.hypot(*self.map_from_pixel.linear).tolist()
        return across, down

    def outline(self, steps: int = 32) -> FloatArray:
        """Points along the outer edge, pixel coordinates (4 * steps, 2)."""
        t = np.linspace(0, 1, steps, endpoint=False)
        zero, one = np.zeros(steps), np.ones(steps)
        sides = [(t, zero), (one, t), (1 - t, one), (zero, 1 - t)]
        return np.concatenate([np.column_stack(side) for side in sides]) * (self.width, self.height)

    def geotransform(self) -> Any:
        """The same as `map_from_pixel`, as rasterio has it."""
        from rasterio.transform import Affine as Geotransform

        (a, b), (d, e) = self.map_from_pixel.linear.tolist()
        c, f = self.map_from_pixel.shift.tolist()
        return Geotransform(a, b, c, d, e, f)


def affine_of(geotransform: Any) -> Affine:
    """A transform of rasterio's as one of ours. `ValueError` for one that cannot be inverted."""
    a, b, c, d, e, f = tuple(geotransform)[:6]
    return Affine([[a, b], [d, e]], (c, f))


@dataclass(frozen=True)
class PixelMap:
    """From pixels of the target grid to pixels of the source grid, through both CRSs and the motion between them."""

    target: Grid
    source: Grid
    motion: Motion

    def __call__(self, points: FloatArray) -> FloatArray:
        """Pixel coordinates (n, 2) of the target to those of the source; not finite where a CRS does not reach."""
        ground = self.target.map_from_pixel(points)
        return self._source_pixel(self._moved_back(ground))

    def forward(self, points: FloatArray) -> FloatArray:
        """Pixel coordinates (n, 2) of the source to coordinates in the target's CRS."""
        return moved(self.source.map_from_pixel(points), self.source.crs, self.motion, self.target.crs)

    @property
    def affine(self) -> Affine | None:
        """The map as one affine transform, exactly; None where the CRSs differ."""
        if not self.target.crs == self.source.crs == self.motion.crs:
            return None
        back = self.motion.reference_from_source.inverse()
        full = self.source.map_from_pixel.inverse() @ Affine(back.linear, back.shift) @ self.target.map_from_pixel
        return Affine(full.linear, full.shift)

    def _moved_back(self, ground: FloatArray) -> FloatArray:
        working = converted(ground, self.target.crs, self.motion.crs)
        back = self.motion.reference_from_source.inverse()(working)
        return converted(back, self.motion.crs, self.source.crs)

    def _source_pixel(self, ground: FloatArray) -> FloatArray:
        return self.source.map_from_pixel.inverse()(ground)


def converted(xy: FloatArray, source: str, target: str) -> FloatArray:
    """Coordinates (n, 2) of one CRS in another; not finite where that does not reach."""
    return xy if source == target else converter(source, target)(xy)


def moved(xy: FloatArray, crs: str, motion: Motion, target: str) -> FloatArray:
    """Coordinates (n, 2) of the source survey in `crs` to those of the reference in `target`.

    In degrees longitudes stay on the side of the antimeridian on which they were, so that what crosses it stays whole.
    """
    working = converted(xy, crs, motion.crs)
    with np.errstate(invalid="ignore"):
        there = converted(motion.reference_from_source(working), motion.crs, target)
        if crs == target and is_geographic(crs):
            there[:, 0] += 360 * np.round((xy[:, 0] - there[:, 0]) / 360)
    return there


def covering(source: Grid, motion: Motion, path: Path) -> Grid:
    """A north-up grid in the source's CRS with its pixel size that covers all of the moved source."""
    size = source.pixel_size
    across, down = size
    ground = moved(source.map_from_pixel(source.outline()), source.crs, motion, source.crs)
    low, high = _bounds(ground, path)
    north_up = Grid(Affine([[across, 0], [0, -down]], (low[0], high[1])), 1, 1, source.crs, source.wkt)
    width, height = (math.ceil((b - a) / s - SLACK) for a, b, s in zip(low, high, size, strict=True))
    return _sized(north_up, (0, 0), (width, height), path)


def extended(grid: Grid, source: Grid, motion: Motion, path: Path) -> Grid:
    """The pixels of `grid`, continued or cut off so that they cover all of the moved source and no more."""
    ground = moved(source.map_from_pixel(source.outline()), source.crs, motion, grid.crs)
    low, high = _bounds(grid.map_from_pixel.inverse()(ground), path)
    first = tuple(math.floor(value + SLACK) for value in low)
    last = tuple(math.ceil(value - SLACK) for value in high)
    return _sized(grid, (first[0], first[1]), (last[0], last[1]), path)


def _bounds(points: FloatArray, path: Path) -> tuple[FloatArray, FloatArray]:
    if not np.isfinite(points).all():
        raise InputError(f"{path} lies where the transform's CRS does not reach; correct the CRS of one of them.")
    return points.min(axis=0), points.max(axis=0)


def _sized(grid: Grid, first: tuple[int, int], last: tuple[int, int], path: Path) -> Grid:
    """The grid of the same pixels from column and row `first` up to `last`."""
    width, height = (max(1, b - a) for a, b in zip(first, last, strict=True))
    if max(width, height) > MOST_PIXELS:
        raise InputError(f"{path} would become {width} x {height} pixels; correct the transform or the pixel size.")
    corner = grid.map_from_pixel(np.array([first], dtype=np.float64))[0]
    return Grid(Affine(grid.map_from_pixel.linear, corner), width, height, grid.crs, grid.wkt)
