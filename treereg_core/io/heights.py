"""Heights of trees from an elevation raster: the top of each canopy less the ground around it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from treereg_core.features import IntArray
from treereg_core.heights import Heights
from treereg_core.io.crs import converter, crs_name, parse_crs
from treereg_core.io.elevation import Canopies, Elevations, read_elevations
from treereg_core.io.raster import open_raster
from treereg_core.survey import Frame
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

AROUND_M = 4.5
"""Ground is looked for so far from the middle of a canopy."""
FEWEST_CELLS = 4
QUANTILE = 0.3
"""The ground is laid so that this share of the cells lies below it; above it stand trees that no canopy tells of."""
ROUNDS = 15
ROUGH_M = 0.03
"""Cells that are off by less count as much as one another."""
FLAT = 40.0
"""Where the cells leave it open the ground slopes as the whole field does; that weighs as much as cells would whose
squared distances come to so many square metres."""
AT_ONCE = 20_000
"""Trees whose ground is laid at once, some 500 MB."""


def read_heights(path: Path, polygons: NDArray[np.object_], frame: Frame) -> tuple[Heights, tuple[str, ...]]:
    """The heights of canopies (n,), shapely polygons in the working frame, and a warning for a raster of no use.

    The raster may have any CRS and lie at any angle, cover a part only, and have nodata. Raises `InputError` for one
    that cannot be read.
    """
    unknown = np.full(len(polygons), np.nan)
    with open_raster(path) as dataset:
        if dataset.crs is None:
            told = f"{path} names no CRS, so heights are not taken from it; export it with its CRS."
            return Heights(unknown, unknown), (told,)
        crs = crs_name(parse_crs(dataset.crs.to_wkt(), path))
        canopies = Canopies.of(polygons, _pixels_from_frame(dataset, crs, frame))
        found = None if canopies is None else read_elevations(dataset, canopies, AROUND_M)
    ground = unknown if found is None else ground_at(found)
    height = unknown if found is None else np.maximum(found.top - ground, 0)
    if not np.isfinite(height).any():
        told = f"{path} shows no tree with ground around it, so there are no heights; replace it or remove it."
        return Heights(unknown, unknown), (told,)
    return Heights(height, np.where(np.isfinite(height), ground, np.nan)), ()


def _pixels_from_frame(dataset: DatasetReader, crs: str, frame: Frame) -> Callable[[FloatArray], FloatArray]:
    """Takes working coordinates (n, 2), metres, to columns and rows; infinite where the raster's CRS does not reach."""
    inverse = ~dataset.transform
    linear = np.array([[inverse.a, inverse.b], [inverse.d, inverse.e]])
    move = converter(frame.crs, crs)

    def pixels(xy: FloatArray) -> FloatArray:
        full = xy + np.array(frame.origin)
        return np.asarray((full if crs == frame.crs else move(full)) @ linear.T + [inverse.c, inverse.f])

    return pixels


def ground_at(found: Elevations) -> FloatArray:
    """The elevation of the ground under each canopy (n,), metres; NaN where the raster shows none around it.

    A plane through the low elevations around, of which most may belong to crowns that no canopy tells of.
    """
    ground = np.full(len(found.top), np.nan)
    for trees in np.array_split(np.arange(len(ground)), -(-len(ground) // AT_ONCE)):
        offset, level = _cells_around(found, trees)
        known = np.isfinite(level)
        enough = known.sum(axis=1) >= FEWEST_CELLS
        ground[trees[enough]] = _laid(offset[enough], np.where(known, level, 0)[enough], known[enough])
    return ground


def _cells_around(found: Elevations, trees: IntArray) -> tuple[FloatArray, FloatArray]:
    """Where the cells around these trees lie, (m, k, 2) metres from the tree, and how low they are, NaN: unknown."""
    reach = int(np.ceil(AROUND_M / np.abs(np.linalg.svd(found.metres, compute_uv=False)).min()))
    steps = np.arange(-reach, reach + 1)
    around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    at = np.nan_to_num(found.at[trees], nan=-1e6, posinf=-1e6, neginf=-1e6)
    cells = np.rint(at).astype(np.int64)[:, None] + around
    offset = (cells - at[:, None]) @ found.metres.T
    shape = np.array(found.low.shape)
    inside = ((cells >= 0) & (cells < shape)).all(axis=2) & (np.hypot(*np.moveaxis(offset, 2, 0)) <= AROUND_M)
    row, column = np.moveaxis(np.where(inside[..., None], cells, 0), 2, 0)
    level = found.low[row, column] if found.low.size else np.full(inside.shape, np.nan)
    return offset, np.where(inside, level, np.nan)


def _laid(offset: FloatArray, level: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """The plane through the cells around each tree, by quantile regression, at the tree (m,)."""
    design = np.concatenate([np.ones((*level.shape, 1)), offset], axis=2)
    plane = np.zeros((len(level), 3, 1))
    if not len(level):
        return plane[:, 0, 0]
    plane[:, 0, 0] = np.nanquantile(np.where(known, level, np.nan), QUANTILE, axis=1)
    slope = np.zeros((2, 1))
    for _ in range(ROUNDS):
        off = level - (design @ plane)[..., 0]
        weight = known * np.where(off < 0, 1 - QUANTILE, QUANTILE) / np.maximum(np.abs(off), ROUGH_M)
        weighted = np.swapaxes(design * weight[..., None], 1, 2)
        normal, right = weighted @ design, weighted @ level[..., None]
        held = FLAT * np.median(weight[known])
        normal[:, [1, 2], [1, 2]] += held
        right[:, 1:] += held * slope
        plane = np.linalg.solve(normal, right)
        slope = np.median(plane[:, 1:], axis=0)
    return np.asarray(plane[:, 0, 0])
