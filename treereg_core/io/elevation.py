"""Reading an elevation raster by windows: the top of each canopy, and how low the ground beside canopies lies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

SAMPLE_M = 0.08
"""A raster that is finer is sampled about so far apart."""
CELL_M = 0.8
"""Width of the cells in each of which low elevations are the ground."""
TILE = 64
"""Cells along a side of what is read at once."""
OBLONG = 10.0
"""A raster of which a pixel is so many times longer than wide, or longer, shows no trees."""
LARGEST_M = 30.0
"""What is wider or higher on the map is no tree."""
HIGHEST_M = 20_000.0
"""Elevations further from zero are none."""
TOP = 0.98
"""Quantile of the elevations in a canopy that is its top; the highest may be a fault of the raster."""
LOW = 0.2
"""Quantile of the elevations in a cell that is its ground, with grass and noise on it."""
FEWEST = 4
"""Samples of a canopy."""
SEEN = 0.5
"""Share of a canopy for which the raster must have values, and a quarter of a cell."""

Box = tuple[int, int, int, int]
"""First and last row, first and last column, the last ones not included."""


@dataclass(frozen=True, eq=False)
class Canopies:
    """n canopies in samples of a raster: every `step`-th pixel.

    - `outlines` (n,): columns and rows for x and y; `boxes` (n, 4) are around them.
    - `metres` (2, 2): takes steps in rows and columns to metres of the working frame.
    """

    outlines: NDArray[np.object_]
    boxes: FloatArray
    metres: FloatArray
    step: int

    @classmethod
    def of(cls, polygons: NDArray[np.object_], pixels: Callable[[FloatArray], FloatArray]) -> Canopies | None:
        """Those of polygons (n,) in the working frame, which `pixels` takes to columns and rows of the raster.

        None when the raster's CRS does not reach them or its pixels are far from square.
        """
        import shapely

        centre = shapely.get_coordinates(shapely.centroid(polygons)).mean(axis=0)
        here, east, north = pixels(centre + np.array([[0, 0], [1, 0], [0, 1]]))
        linear = np.column_stack([east - here, north - here])
        if not np.isfinite(linear).all() or np.linalg.cond(linear) >= OBLONG:
            return None
        metres = np.linalg.inv(linear)[:, ::-1]
        step = max(int(SAMPLE_M / math.sqrt(abs(np.linalg.det(metres))) + 1e-6), 1)
        outlines = shapely.transform(polygons, lambda xy: pixels(xy) / step)
        return cls(outlines, shapely.bounds(outlines), metres * step, step)

    @property
    def side(self) -> float:
        """The distance between samples, metres."""
        return math.sqrt(abs(float(np.linalg.det(self.metres))))

    @property
    def middles(self) -> FloatArray:
        """Row and column of the middle of each box, (n, 2)."""
        return np.asarray(self.boxes[:, 1::-1] + self.boxes[:, :1:-1]) / 2

    def within(self, box: Box, reach: float = 0.0) -> IntArray:
        """Which of them, or `reach` samples around them, are in a box."""
        left, top, right, bottom = self.boxes.T
        rows = (bottom + reach > box[0]) & (top - reach < box[1])
        return np.flatnonzero(rows & (right + reach > box[2]) & (left - reach < box[3]) & self.sound)

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Which of them are where the raster's CRS reaches, and of the size of a tree."""
        size = self.boxes[:, 2:] - self.boxes[:, :2]
        return np.asarray(np.isfinite(size).all(axis=1) & (size.max(axis=1) * self.side <= LARGEST_M))


@dataclass(frozen=True, eq=False)
class Elevations:
    """What a raster says about n canopies and the ground between them, metres.

    - `top` (n,): of each canopy; NaN where the raster does not tell.
    - `low` (h, w): of each cell beside the canopies; NaN in canopies and where there are no values.
    - `at` (n, 2): row and column of the middle of each canopy in cells; whole numbers are the middles of cells.
    - `metres` (2, 2): takes steps in rows and columns of cells to metres of the working frame.
    """

    top: FloatArray
    low: FloatArray
    at: FloatArray
    metres: FloatArray


def read_elevations(dataset: DatasetReader, canopies: Canopies, around: float) -> Elevations:
    """What the first band of a raster says about canopies and the ground `around` them, metres."""
    cell = max(round(CELL_M / canopies.side), 1)
    reach = around / canopies.side
    top = np.full(len(canopies.boxes), np.nan)
    row, last_row, column, last_column = _all(dataset, canopies, reach)
    height, width = -(-max(last_row - row, 0) // cell), -(-max(last_column - column, 0) // cell)
    low = np.full((height, width), np.nan)
    for i in range(0, height, TILE):
        for j in range(0, width, TILE):
            bottom, right = min(row + (i + TILE) * cell, last_row), min(column + (j + TILE) * cell, last_column)
            tile = row + i * cell, bottom, column + j * cell, right
            if not len(canopies.within(tile, reach)):
                continue
            near = canopies.within(tile)
            mine = near[_holds(tile, canopies.middles[near])]
            window = _around(tile, canopies.boxes[mine], dataset, canopies)
            values, shown = _values(dataset, window, canopies.step), _shown(canopies, window)
            top[mine] = _tops(values, shown, canopies, mine)
            core = np.s_[tile[0] - window[0] : tile[1] - window[0], tile[2] - window[2] : tile[3] - window[2]]
            lows = _lows(np.where(shown[core] < 0, values[core], np.nan), cell)
            low[i : i + lows.shape[0], j : j + lows.shape[1]] = lows
    at = (canopies.middles - [row, column]) / cell - 0.5
    return Elevations(top, low, at, canopies.metres * cell)


def _all(dataset: DatasetReader, canopies: Canopies, reach: float) -> Box:
    """The box of all canopies with what is around them, inside the raster."""
    boxes = canopies.boxes[canopies.sound]
    if not len(boxes):
        return 0, 0, 0, 0
    left, top = np.floor(boxes[:, :2].min(axis=0) - reach).astype(int).tolist()
    right, bottom = np.ceil(boxes[:, 2:].max(axis=0) + reach).astype(int).tolist()
    return _clipped((top, bottom, left, right), dataset, canopies)


def _clipped(box: Box, dataset: DatasetReader, canopies: Canopies) -> Box:
    """The part of a box that the raster has samples of."""
    rows, columns = dataset.height // canopies.step, dataset.width // canopies.step
    limits = (rows, rows, columns, columns)
    first, last, left, right = (min(max(at, 0), limit) for at, limit in zip(box, limits, strict=True))
    return first, last, left, right


def _holds(box: Box, points: FloatArray) -> NDArray[np.bool_]:
    """Which points (n, 2), rows and columns, are in a box."""
    rows, columns = points.T
    return np.asarray((rows >= box[0]) & (rows < box[1]) & (columns >= box[2]) & (columns < box[3]))


def _around(tile: Box, boxes: FloatArray, dataset: DatasetReader, canopies: Canopies) -> Box:
    """A tile with all of the boxes (n, 4) that belong to it."""
    both = np.vstack([boxes, [tile[2], tile[0], tile[3], tile[1]]])
    left, top = np.floor(both[:, :2].min(axis=0)).astype(int).tolist()
    right, bottom = np.ceil(both[:, 2:].max(axis=0)).astype(int).tolist()
    return _clipped((top, bottom, left, right), dataset, canopies)


def _values(dataset: DatasetReader, box: Box, step: int) -> FloatArray:
    """The samples in a box, metres, NaN where there are none."""
    from rasterio.windows import Window

    rows, columns = box[1] - box[0], box[3] - box[2]
    window = Window(box[2] * step, box[0] * step, columns * step, rows * step)
    read = dataset.read(1, window=window, out_shape=(rows, columns), masked=True)
    values = read.filled(0).astype(np.float64) * dataset.scales[0] + dataset.offsets[0]
    values[np.ma.getmaskarray(read)] = np.nan
    values[~(np.abs(values) <= HIGHEST_M)] = np.nan
    return np.asarray(values)


def _shown(canopies: Canopies, box: Box) -> IntArray:
    """Which canopy each sample in a box shows, -1 for none; of two that overlap the smaller."""
    import shapely
    from rasterio import Affine
    from rasterio.features import rasterize

    here = canopies.within(box)
    here = here[np.argsort(-shapely.area(canopies.outlines[here]), kind="stable")]
    shape = box[1] - box[0], box[3] - box[2]
    if not len(here) or not min(shape):
        return np.full(shape, -1)
    shapes = zip(canopies.outlines[here], here.tolist(), strict=True)
    shown = rasterize(shapes, out_shape=shape, fill=-1, transform=Affine.translation(box[2], box[0]), dtype="int32")
    return np.asarray(shown, dtype=np.int64)


def _tops(values: FloatArray, shown: IntArray, canopies: Canopies, mine: IntArray) -> FloatArray:
    """The top of each of these canopies."""
    import shapely

    inside = (shown >= 0) & np.isfinite(values)
    which, level = shown[inside], values[inside]
    order = np.lexsort((level, which))
    which, level = which[order], level[order]
    first, last = np.searchsorted(which, mine), np.searchsorted(which, mine, side="right")
    count = last - first
    enough = count >= np.maximum(SEEN * shapely.area(canopies.outlines[mine]), FEWEST)
    top = np.full(len(mine), np.nan)
    top[enough] = level[(first + TOP * (count - 1)).astype(int)[enough]]
    return top


def _lows(values: FloatArray, cell: int) -> FloatArray:
    """The low elevation of each cell; NaN where less than a quarter of it is known."""
    height, width = (-(-length // cell) for length in values.shape)
    padded = np.full((height * cell, width * cell), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    cells = np.sort(padded.reshape(height, cell, width, cell).swapaxes(1, 2).reshape(height, width, cell**2))
    count = np.isfinite(cells).sum(axis=2)
    index = (LOW * np.maximum(count - 1, 0)).astype(int)
    low = np.take_along_axis(cells, index[..., None], axis=2)[..., 0]
    return np.where(count >= max(cell**2 / 4, 1), low, np.nan)
