"""Grid: the pixels of an image, north up, in the coordinates of a survey."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from treereg_core.simulate.texture import Picture
from treereg_core.transform import FloatArray

CELL = 0.1
"""Width of a pixel, metres."""
NODE = 8
"""Every so many pixels what varies smoothly is worked out; in between it is straight to a few millimetres."""


@dataclass(frozen=True)
class Grid:
    """Pixels from the outer corner (`west`, `north`), metres: `height` rows from north to south, `width` columns."""

    west: float
    north: float
    height: int
    width: int

    @classmethod
    def around(cls, points: FloatArray, origin: tuple[float, float]) -> Grid:
        """The one that holds all points (n, 2), on full coordinates that are whole pixels; `origin` is that of points.

        Its corner is counted about the origin, as the points are.
        """
        low, high = points.min(axis=0) + origin, points.max(axis=0) + origin
        west, north = math.floor(low[0] / CELL), math.ceil(high[1] / CELL)
        width, height = math.ceil(high[0] / CELL) - west, north - math.floor(low[1] / CELL)
        return cls(west * CELL - origin[0], north * CELL - origin[1], height, width)

    @property
    def x(self) -> FloatArray:
        """Of the middle of each column, metres (width,)."""
        return np.asarray(self.west + (np.arange(self.width) + 0.5) * CELL)

    @property
    def y(self) -> FloatArray:
        """Of the middle of each row, metres (height,), falling."""
        return np.asarray(self.north - (np.arange(self.height) + 0.5) * CELL)

    def part(self, row: int, column: int, height: int, width: int) -> Grid:
        """The pixels from this row and column on; they may lie outside."""
        return replace(self, west=self.west + column * CELL, north=self.north - row * CELL, height=height, width=width)

    def tiles(self, side: int) -> Iterator[tuple[int, int, Grid]]:
        """Row, column and pixels of each tile, at most `side` wide and high."""
        for row in range(0, self.height, side):
            for column in range(0, self.width, side):
                height, width = min(side, self.height - row), min(side, self.width - column)
                yield row, column, self.part(row, column, height, width)


@dataclass(frozen=True, eq=False)
class Nodes:
    """Points of a grid, NODE pixels apart, from which smooth functions are spread over all pixels."""

    points: FloatArray
    down: Picture
    across: Picture

    @classmethod
    def of(cls, grid: Grid) -> Nodes:
        """The nodes of a grid; `points` (k, 2) metres."""
        down, across = _weights(grid.height), _weights(grid.width)
        rows = grid.y[0] - np.arange(down.shape[1]) * NODE * CELL
        columns = grid.x[0] + np.arange(across.shape[1]) * NODE * CELL
        x, y = np.meshgrid(columns, rows)
        return cls(np.column_stack([x.ravel(), y.ravel()]), down, across)

    def spread(self, values: FloatArray) -> Picture:
        """Values at the nodes (k,) as a value for every pixel, bilinear."""
        shape = (self.down.shape[1], self.across.shape[1])
        return np.asarray(self.down @ values.reshape(shape).astype(np.float32) @ self.across.T)


def _weights(pixels: int) -> Picture:
    """How much of each node a pixel has, (pixels, nodes)."""
    at = np.arange(pixels) / NODE
    first = np.floor(at).astype(int)
    weights = np.zeros((pixels, first[-1] + 2), dtype=np.float32)
    weights[np.arange(pixels), first] = 1 - (at - first)
    weights[np.arange(pixels), first + 1] = at - first
    return weights
