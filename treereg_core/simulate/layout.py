"""Where the planting positions are: rows in a block, with paths, headland rows and double rows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from treereg_core.features import IntArray
from treereg_core.simulate.scene import Scene
from treereg_core.transform import FloatArray, Rigid

LARGEST_SLANT_DEG = 6.0
"""How far paths may be turned against the direction straight across the rows."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Planting positions in the rows' own frame: x along the rows, y across, metres; ordered by row and along it.

    - `positions` (m, 2), `row` (m,) and `column` (m,): each position, its row and its place in the row.
    - `outline` (k, 2): points along the block's edge, counter-clockwise, close enough to bend with the rows.
    - `length`: how far the rows reach along x, headlands aside.
    """

    positions: FloatArray
    row: IntArray
    column: IntArray
    outline: FloatArray
    length: float


def lay_out(scene: Scene, rng: np.random.Generator) -> Layout:
    """The layout of a scene, still with straight rows."""
    (own,) = rng.spawn(1)  # so that paths leave everything else as it is
    rectangle = scene.outline == "rectangle"
    positions, row, column, corners = _rectangle(scene, rng) if rectangle else _irregular(scene, rng)
    layout = Layout(positions, row, column, _finely(corners), float(np.ptp(positions[:, 0])) or 1.0)
    if scene.paths:
        layout = _with_paths(layout, scene, own)
    return _with_headlands(layout, scene) if scene.headlands else layout


_Block = tuple[FloatArray, IntArray, IntArray, FloatArray]
"""Positions, row and column of each, and the block's corners."""


def _rectangle(scene: Scene, rng: np.random.Generator) -> _Block:
    """Whole rows of equal length; the field is up to 1.6 times longer than wide, or wider than long."""
    places = scene.trees / scene.rows_together
    length_over_width = math.exp(rng.uniform(-0.5, 0.5))
    rows = max(2, round(math.sqrt(places * scene.spacing / scene.row_spacing / length_over_width)))
    columns = max(2, round(places / rows))
    column, row = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows)))
    size = np.array([columns * scene.spacing, rows * scene.row_spacing])
    positions = np.column_stack([(column + 0.5) * scene.spacing, (row + 0.5) * scene.row_spacing]) - size / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2
    return (*_doubled(positions, row, column, scene), corners)


def _irregular(scene: Scene, rng: np.random.Generator) -> _Block:
    """The part of a lattice inside a random polygon: compact, rarely convex, its sides at any angle to the rows."""
    count = int(rng.integers(8, 14))
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.35, 0.35, count)) / count
    corners = rng.uniform(0.65, 1.1, count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    stretch = np.array([1.0, rng.uniform(1.0, 1.6)])
    corners = Rigid.turn(rng.uniform(0, 360))(corners * stretch)
    places = scene.trees / scene.rows_together
    corners *= math.sqrt(places * scene.row_spacing * scene.spacing / _area(corners))

    spacings = np.array([scene.spacing, scene.row_spacing])
    start, stop = corners.min(axis=0), corners.max(axis=0)
    columns, rows = np.ceil((stop - start) / spacings).astype(int) + 1
    column, row = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows)))
    positions = start - spacings * rng.random(2) + spacings * np.column_stack([column, row])
    positions, row, column = _doubled(positions, row, column, scene)
    inside = _inside_star(positions, corners)
    return positions[inside], row[inside], column[inside], corners


def _doubled(
    positions: FloatArray, row: IntArray, column: IntArray, scene: Scene
) -> tuple[FloatArray, IntArray, IntArray]:
    """Two rows in place of each, the second one set off by half a spacing, where a scene has double rows."""
    if scene.rows_together == 1:
        return positions, row, column
    aside = np.array([scene.spacing / 4, scene.hedgerow / 2])
    both = np.concatenate([positions - aside, positions + aside])
    rows, columns = np.concatenate([2 * row, 2 * row + 1]), np.tile(column, 2)
    order = np.lexsort((columns, rows))
    return both[order], rows[order], columns[order]


@dataclass(frozen=True, eq=False)
class _Paths:
    """Parallel strips without trees: they open at x = `at` + `slope` y and push apart what lies on both sides."""

    at: FloatArray
    slope: float
    width: float

    def before(self, points: FloatArray) -> IntArray:
        """How many paths lie between each point and the left end of the rows."""
        return np.searchsorted(self.at, points[:, 0] - self.slope * points[:, 1])

    def push(self, points: FloatArray, before: IntArray) -> FloatArray:
        """The points where they stand once that many of the paths have opened on their left."""
        shift = self.width * (before - len(self.at) / 2)
        return points + np.column_stack([shift, np.zeros(len(points))])

    def opened(self, ring: FloatArray) -> FloatArray:
        """A ring pushed apart, with a corner more on both sides wherever it crosses a path."""
        points, sides = [ring[:0]], [np.zeros(0, dtype=np.int64)]
        before = self.before(ring)
        for a, b, first, last in zip(ring, np.roll(ring, -1, axis=0), before, np.roll(before, -1), strict=True):
            crossed = range(first, last) if first < last else range(first - 1, last - 1, -1)
            points.append(a[None])
            sides.append(np.array([first]))
            for path in crossed:
                start, stop = (point[0] - self.slope * point[1] for point in (a, b))
                place = a + (self.at[path] - start) / (stop - start) * (b - a)
                points.append(np.array([place, place]))
                sides.append(np.array([path, path + 1] if first < last else [path + 1, path]))
        return self.push(np.concatenate(points), np.concatenate(sides))


def _with_paths(layout: Layout, scene: Scene, rng: np.random.Generator) -> Layout:
    """The same with paths at roughly equal distances; both sides of a path become rows of their own."""
    share = (np.arange(1, scene.paths + 1) + rng.uniform(-0.25, 0.25, scene.paths)) / (scene.paths + 1)
    slant = math.radians(rng.uniform(-LARGEST_SLANT_DEG, LARGEST_SLANT_DEG))
    at = layout.positions[:, 0].min() + share * layout.length
    paths = _Paths(at, math.tan(slant), scene.path_width / math.cos(slant))
    before = paths.before(layout.positions)
    positions = paths.push(layout.positions, before)
    row = layout.row * (scene.paths + 1) + before
    length = float(np.ptp(positions[:, 0]))
    return Layout(positions, row, layout.column, paths.opened(layout.outline), length)


def _with_headlands(layout: Layout, scene: Scene) -> Layout:
    """The same with straight rows across beyond both ends of the longest rows; its outline is the box around all."""
    (left, bottom), (right, top) = layout.positions.min(axis=0), layout.positions.max(axis=0)
    count = int((top - bottom) / scene.spacing) + 1
    across = (bottom + top) / 2 + scene.spacing * (np.arange(count) - (count - 1) / 2)
    beyond = scene.row_spacing * np.arange(1, scene.headlands + 1)
    rows = np.concatenate([left - beyond, right + beyond])
    positions = np.column_stack([np.repeat(rows, count), np.tile(across, len(rows))])
    room = np.array([scene.spacing, scene.row_spacing]) / 2
    low, high = np.array([rows.min(), bottom]) - room, np.array([rows.max(), top]) + room
    return Layout(
        np.concatenate([layout.positions, positions]),
        np.concatenate([layout.row, layout.row.max() + 1 + np.repeat(np.arange(len(rows)), count)]),
        np.concatenate([layout.column, np.tile(np.arange(count), len(rows))]),
        _finely(np.array([low, [high[0], low[1]], high, [low[0], high[1]]])),
        layout.length,
    )


def _area(corners: FloatArray) -> float:
    x, y = corners.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2


def _inside_star(points: FloatArray, corners: FloatArray) -> NDArray[np.bool_]:
    """Which points lie in a polygon that is star-shaped about (0, 0), counter-clockwise."""
    corner_angle = np.arctan2(corners[:, 1], corners[:, 0])
    corners = corners[np.argsort(corner_angle)]
    sector = np.searchsorted(np.sort(corner_angle), np.arctan2(points[:, 1], points[:, 0]))
    a, b = corners[sector - 1], corners[sector % len(corners)]
    edge, offset = b - a, points - a
    return np.asarray(edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0] > 0)


def _finely(corners: FloatArray) -> FloatArray:
    """The same ring with 32 points to a side, so that it can bend with the rows."""
    step = np.linspace(0, 1, 32, endpoint=False)[:, None]
    return np.asarray((corners[:, None] + step * (np.roll(corners, -1, axis=0) - corners)[:, None]).reshape(-1, 2))
