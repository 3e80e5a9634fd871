"""Pieces: a target grid cut into rectangles, in each of which the map to the source's pixels is an affine transform."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from treereg_core.io.grid import PixelMap
from treereg_core.transform import Affine, FloatArray

WORST_ERROR = 0.01
"""How far an affine transform may be from the true map within a piece, source pixels."""
SMALLEST = 16
"""A piece of fewer columns and rows is not cut any more."""
MOST_SOURCE_BYTES = 32 * 2**20
"""A piece that needs more of the source at once is cut."""
_GRID = np.stack(np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 5)), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels: the first column and row, width and height."""

    column: int
    row: int
    width: int
    height: int

    def points(self, share: FloatArray) -> FloatArray:
        """Pixel coordinates of points (n, 2) given as shares of width and height."""
        return np.array([self.column, self.row]) + share * (self.width, self.height)

    def quarters(self) -> Iterator[Window]:
        """The same in up to four parts."""
        across, down = (max(SMALLEST, -(-size // 2)) for size in (self.width, self.height))
        for row in range(0, self.height, down):
            for column in range(0, self.width, across):
                size = min(across, self.width - column), min(down, self.height - row)
                yield Window(self.column + column, self.row + row, *size)


@dataclass(frozen=True)
class Piece:
    """A window of the target, the affine map from its pixels to the source's, and the source's pixels it needs."""

    target: Window
    source: Window
    source_from_target: Affine


def scales(pixels: PixelMap) -> tuple[float, float]:
    """How many source pixels, along the source's columns and rows, one target pixel covers; measured in the middle."""
    middle = Window(0, 0, pixels.target.width, pixels.target.height).points(np.array([[0.5, 0.5]]))
    steps = pixels(middle + np.array([[0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5]]))
    along = np.column_stack([steps[0] - steps[1], steps[2] - steps[3]])
    across, down = np.hypot(*along.T).tolist()
    return across, down


def cut(pixels: PixelMap, tile: int, margins: tuple[int, int], pixel_bytes: int) -> Iterator[Piece]:
    """The pieces of a target grid in the order of its rows of tiles; what shows nothing of the source is left out.

    `tile` is the side of the largest piece, `margins` how many source pixels beyond a piece, along columns and rows, a
    resampling kernel reaches.
    """
    exact = pixels.affine
    for row in range(0, pixels.target.height, tile):
        for column in range(0, pixels.target.width, tile):
            width, height = pixels.target.width - column, pixels.target.height - row
            todo = [Window(column, row, min(tile, width), min(tile, height))]
            while todo:
                window = todo.pop()
                small = max(window.width, window.height) <= SMALLEST
                fitted = exact or _fitted(pixels, window, accept=small)
                needed = fitted and _needed(pixels, window, fitted, margins)
                if fitted is None or (needed and not small and _bytes(needed, pixel_bytes) > MOST_SOURCE_BYTES):
                    todo += [] if small else list(window.quarters())[::-1]
                elif needed:
                    yield Piece(window, needed, fitted)


def _bytes(window: Window, pixel_bytes: int) -> int:
    return window.width * window.height * pixel_bytes


def _fitted(pixels: PixelMap, window: Window, accept: bool) -> Affine | None:
    """The affine transform nearest to the map within a window; None where it is too far from it."""
    there = pixels(window.points(_GRID))
    if not np.isfinite(there).all():
        return None
    centred = _GRID - 0.5
    mean = there.mean(axis=0)
    slopes = centred.T @ (there - mean) / (centred**2).sum(axis=0)[:, None]
    size = np.array([window.width, window.height])
    try:
        linear = slopes.T / size
        fitted = Affine(linear, mean - linear @ window.points(np.array([[0.5, 0.5]]))[0])
    except ValueError:
        return None
    error = np.abs(fitted(window.points(_GRID)) - there).max()
    return fitted if accept or error <= WORST_ERROR else None


def _needed(pixels: PixelMap, window: Window, source_from_target: Affine, margins: tuple[int, int]) -> Window | None:
    """The part of the source that a window shows, with margins; None when it shows nothing of it."""
    corners = source_from_target(window.points(np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])))
    low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    size = (pixels.source.width, pixels.source.height)
    if any(b <= 0 or a >= s for a, b, s in zip(low, high, size, strict=True)):
        return None
    first = [max(0, math.floor(a) - m) for a, m in zip(low, margins, strict=True)]
    last = [min(s, math.ceil(b) + m) for b, m, s in zip(high, margins, size, strict=True)]
    return Window(first[0], first[1], last[0] - first[0], last[1] - first[1])
