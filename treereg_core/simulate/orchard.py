"""The orchard itself: where trees stand, how large they are and how plainly they show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import UsageError
from treereg_core.features import IntArray
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.smooth import SmoothField
from treereg_core.transform import FloatArray, Rigid

LARGEST_MEDIAN_CROWN_M2 = 25.0


@dataclass(frozen=True, eq=False)
class Orchard:
    """The trees of an orchard, ordered by row and along it, about a local origin in its centre.

    - `xy` (n, 2): where each tree stands, metres.
    - `row`, `column` (n,): its row, from 0 across the field, and its planting position in the row. Two trees of a row
      are neighbours when their columns follow on each other; a missing number is a gap.
    - `area` (n,): crown area that lasts, at the time of the reference, square metres.
    - `plainness` (n,): standard normal; what a tree's confidences have in common.
    - `positions` (m, 2): all planting positions, gaps included, metres.
    - `outline` (k, 2): points along the block's edge, metres, counter-clockwise, first one not repeated.
    """

    xy: FloatArray
    row: IntArray
    column: IntArray
    area: FloatArray
    plainness: FloatArray
    positions: FloatArray
    outline: FloatArray


@dataclass(frozen=True, eq=False)
class _Layout:
    """Planting positions in the rows' own frame: x along the rows, y across, metres."""

    positions: FloatArray
    row: IntArray
    column: IntArray
    outline: FloatArray


def plant(scene: Scene, rng: np.random.Generator) -> Orchard:
    """Plant a scene's orchard. Raises `UsageError` when gaps and holes leave fewer than 3 trees."""
    layout = _rectangle(scene, rng) if scene.outline == "rectangle" else _irregular(scene, rng)
    heading_deg = rng.uniform(0, 360)
    extent = float(np.ptp(layout.positions[:, 0])) or 1.0

    def place(points: FloatArray) -> FloatArray:
        bow = scene.curve * (1 - (2 * points[:, 0] / extent) ** 2)
        return Rigid.turn(heading_deg)(points + np.column_stack([np.zeros(len(points)), bow]))

    positions = place(layout.positions)
    centre = positions.mean(axis=0)
    positions = positions - centre
    standing = (rng.random(len(positions)) >= scene.gaps) & ~_in_holes(positions, scene, rng)
    if np.count_nonzero(standing) < 3:
        raise UsageError("The scene leaves fewer than 3 trees: ask for more trees, or for fewer gaps and holes.")
    xy = positions[standing] + scene.planting_jitter * rng.standard_normal((np.count_nonzero(standing), 2))
    individual = scene.area_variation * math.sqrt(scene.area_persistence) * rng.standard_normal(len(xy))
    median = min(scene.crown_cover * scene.row_spacing * scene.spacing, LARGEST_MEDIAN_CROWN_M2)
    return Orchard(
        xy=xy,
        row=np.unique(layout.row[standing], return_inverse=True)[1].astype(np.int64),
        column=layout.column[standing],
        area=median * np.exp(scene.vigour * SmoothField.over(positions, rng)(xy) + individual),
        plainness=rng.standard_normal(len(xy)),
        positions=positions,
        outline=place(_finely(layout.outline)) - centre,
    )


def _rectangle(scene: Scene, rng: np.random.Generator) -> _Layout:
    """Whole rows of equal length; the field is up to 1.6 times longer than wide, or wider than long."""
    length_over_width = math.exp(rng.uniform(-0.5, 0.5))
    rows = max(2, round(math.sqrt(scene.trees * scene.spacing / scene.row_spacing / length_over_width)))
    columns = max(2, round(scene.trees / rows))
    column, row = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows)))
    size = np.array([columns * scene.spacing, rows * scene.row_spacing])
    positions = np.column_stack([(column + 0.5) * scene.spacing, (row + 0.5) * scene.row_spacing]) - size / 2
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2
    return _Layout(positions, row, column, corners)


def _irregular(scene: Scene, rng: np.random.Generator) -> _Layout:
    """The part of a lattice inside a random polygon: compact, rarely convex, its sides at any angle to the rows."""
    count = int(rng.integers(8, 14))
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.35, 0.35, count)) / count
    corners = rng.uniform(0.65, 1.1, count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    stretch = np.array([1.0, rng.uniform(1.0, 1.6)])
    corners = Rigid.turn(rng.uniform(0, 360))(corners * stretch)
    corners *= math.sqrt(scene.trees * scene.row_spacing * scene.spacing / _area(corners))

    spacings = np.array([scene.spacing, scene.row_spacing])
    start, stop = corners.min(axis=0), corners.max(axis=0)
    columns, rows = np.ceil((stop - start) / spacings).astype(int) + 1
    column, row = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows)))
    positions = start - spacings * rng.random(2) + spacings * np.column_stack([column, row])
    inside = _inside_star(positions, corners)
    return _Layout(positions[inside], row[inside], column[inside], corners)


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


def _in_holes(positions: FloatArray, scene: Scene, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which positions lie in one of the scene's holes: discs of 0.5 to 2 % of the orchard's area."""
    inside = np.zeros(len(positions), dtype=bool)
    for share in rng.uniform(0.005, 0.02, scene.holes):
        centre = positions[rng.integers(len(positions))]
        radius = math.sqrt(share * len(positions) * scene.row_spacing * scene.spacing / math.pi)
        inside |= ((positions - centre) ** 2).sum(axis=1) < radius**2
    return inside
