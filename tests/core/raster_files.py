"""Rasters with bright spots at known places, for the tests of moving them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import rasterio
from io_files import CRS, ORIGIN
from rasterio.transform import Affine as Geotransform

from treereg_core.io.grid import Motion, affine_of
from treereg_core.transform import Affine, Rigid

SIZE = 240
PIXEL = 0.2
SPREAD = 0.8
"""A spot's standard deviation, metres."""
SPOTS = np.array([(9.13, 30.71), (24.37, 24.02), (31.58, 8.49), (36.99, 37.21), (11.26, 12.84)])
"""Places (n, 2) about `ORIGIN`, metres."""
TURN = Rigid.turn(7.3, about=(24, 24), shift=(1.37, -0.81))
MOTION = Motion(CRS, TURN.about(-np.array(ORIGIN)))


def north_up(size: int = SIZE, pixel: float = PIXEL) -> Geotransform:
    """A grid of `size` pixels each way whose lower left corner is `ORIGIN`."""
    return Geotransform(pixel, 0, ORIGIN[0], 0, -pixel, ORIGIN[1] + size * pixel)


GRIDS: dict[str, tuple[str, Geotransform]] = {
    "north up": (CRS, north_up()),
    "south up": (CRS, Geotransform(PIXEL, 0, ORIGIN[0], 0, PIXEL, ORIGIN[1])),
    "rotated": (CRS, Geotransform(0.2, 0.15, ORIGIN[0] - 18, 0.15, -0.2, ORIGIN[1] + 30)),
    "oblong": (CRS, Geotransform(0.25, 0, ORIGIN[0] - 2, 0, -PIXEL, ORIGIN[1] + SIZE * PIXEL)),
    "other zone": ("EPSG:32733", Geotransform(0.23, 0, 0, 0, -0.23, 0)),
    "degrees": ("EPSG:4326", Geotransform(2.6e-6, 0, 0, 0, -2.3e-6, 0)),
}


def placed(name: str) -> tuple[str, Geotransform]:
    """A grid by its name; one in another CRS is put where the spots are."""
    crs, transform = GRIDS[name]
    if crs == CRS:
        return crs, transform
    corners = np.array([(0.0, 0.0), (48, 0), (0, 48), (48, 48)]) + ORIGIN
    x, y = pyproj.Transformer.from_crs(CRS, crs, always_xy=True).transform(*corners.T)
    return crs, Geotransform(transform.a, 0, x.min(), 0, transform.e, y.max())


def ground(crs: str, transform: Geotransform, size: int = SIZE) -> np.ndarray:
    """Where the centres of the pixels lie (size, size, 2), metres about `ORIGIN`."""
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    x = transform.a * column + transform.b * row + transform.c
    y = transform.d * column + transform.e * row + transform.f
    if crs != CRS:
        x, y = pyproj.Transformer.from_crs(crs, CRS, always_xy=True).transform(x, y)
    return np.stack([x - ORIGIN[0], y - ORIGIN[1]], axis=-1)


def brightness(crs: str, transform: Geotransform, size: int = SIZE, spots: np.ndarray = SPOTS) -> np.ndarray:
    """The spots' brightness (size, size) from 0 to 1 at the centre of each pixel."""
    here = ground(crs, transform, size)
    away = ((here - spot) for spot in spots)
    return np.asarray(sum(np.exp(-(step**2).sum(axis=-1) / (2 * SPREAD**2)) for step in away))


def write(path: Path, values: np.ndarray, crs: str | None, transform: Geotransform, **more: Any) -> Path:
    """Write values (bands, height, width) as a tiled GeoTIFF; `finish` is called with the open file."""
    finish = more.pop("finish", None)
    profile = {
        "driver": "GTiff",
        "width": values.shape[2],
        "height": values.shape[1],
        "count": values.shape[0],
        "dtype": values.dtype,
        "crs": crs,
        "transform": transform,
        "tiled": True,
        "blockxsize": 64,
        "blockysize": 64,
    }
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "w", **(profile | more)) as file:
        file.write(values)
        if finish:
            finish(file)
    return path


def painted(path: Path, name: str = "north up", dtype: str = "uint8", bands: int = 1, **more: Any) -> Path:
    """A raster whose bands all show the spots on a dim ground."""
    crs, transform = placed(name)
    low, high = (20, 220) if dtype == "uint8" else (200, 30_000) if dtype == "uint16" else (380.0, 395.0)
    values = low + (high - low) * brightness(crs, transform)
    rounded = values if dtype.startswith("float") else np.round(values)
    return write(path, np.repeat(rounded[None], bands, axis=0).astype(dtype), crs, transform, **more)


def misplaced(path: Path, expected: np.ndarray = SPOTS, band: int = 1) -> float:
    """How far the spots of a raster lie from where they should, in its pixels, at worst.

    `expected` are places (n, 2), metres about `ORIGIN`. A spot lies at the centroid of its brightness above the ground.
    """
    with rasterio.open(path) as file:
        values = np.where(file.read_masks(band) > 0, file.read(band), np.nan).astype(float)
        crs, transform = file.crs.to_string(), file.transform
    x, y = (expected + ORIGIN).T
    if crs != CRS:
        x, y = pyproj.Transformer.from_crs(CRS, crs, always_xy=True).transform(x, y)
    worst = 0.0
    for column, row in affine_of(transform).inverse()(np.column_stack([x, y])):
        c, r = round(column), round(row)
        reach = 13
        part = values[r - reach : r + reach, c - reach : c + reach]
        assert part.shape == (2 * reach, 2 * reach)
        weight = part - np.nanmedian(values)
        weight = np.where(np.isfinite(weight) & (weight > 0.05 * np.nanmax(weight)), weight, 0)
        at = np.arange(2 * reach) + 0.5
        found = np.array([(weight.sum(axis=0) * at).sum(), (weight.sum(axis=1) * at).sum()]) / weight.sum()
        worst = max(worst, float(np.hypot(*(found - (column - c + reach, row - r + reach)))))
    return worst


def after(motion: Affine = TURN) -> np.ndarray:
    """Where the spots belong."""
    return motion(SPOTS)
