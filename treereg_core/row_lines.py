"""Rows as lines: where the rows of a survey run between their trees, and which line is nearest to a point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.features import BoolArray, FeatureSet, IntArray, nearest
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.transform import FloatArray

# A line runs through the local straight fit to so many trees before and after each tree.
SMOOTHING = 3
# Points of a line lie this share of the in-row spacing apart.
STEP = 0.5
# Points of lines are at most so many times as many as the trees.
MOST = 40
# A line still says where its row runs so many in-row spacings beyond its last tree.
BEYOND = 2.0
# So many trees tell how far the rows stand apart, each from so many of its neighbours.
ASKED, NEIGHBOURS = 200, 24


@dataclass(frozen=True, eq=False)
class Feet:
    """The points of lines nearest to n given points.

    Whether one was `found`, the `row` it is of, the `normal` (n, 2) to its line, and how far `across` the line each
    given point stands, metres, positive along the normal.
    """

    found: BoolArray
    row: IntArray
    normal: FloatArray
    across: FloatArray


@dataclass(frozen=True, eq=False)
class RowLines:
    """The rows of one survey as lines, in the survey's own frame, metres.

    - `trees` (n,): positions of the trees of rows in the survey's arrays, row after row, in order along each;
      `row` (n,): the row of each. Rows of fewer than two trees that stand apart are left out.
    - `smooth`, `tangent` (n, 2): where each tree's row runs beside it, and the unit vector along it.
    - `points`, `direction` (m, 2), `of_row` (m,), `ending` (m,): points close together along the lines, bridging gaps
      within rows, and whether a row ends there.
    - `spacing`: the usual distance of consecutive trees; `distance`: of neighbouring rows, or `spacing`
      where there are none.
    """

    trees: IntArray
    row: IntArray
    smooth: FloatArray
    tangent: FloatArray
    points: FloatArray
    direction: FloatArray
    of_row: IntArray
    ending: BoolArray
    spacing: float
    distance: float

    @classmethod
    def of(cls, rows: Rows, features: FeatureSet) -> RowLines:
        """The lines of these rows; without any line when no row has two trees that stand apart."""
        trees, row = trees_of(rows, features)
        xy = features.xy[trees]
        step = np.hypot(*np.diff(xy, axis=0).T) * (np.diff(row) == 0) if len(row) else np.zeros(0)
        long = np.bincount(row[1:], step, len(rows)) > 0
        trees, row, xy = trees[long[row]], row[long[row]], xy[long[row]]
        inner = np.diff(row) == 0
        step = np.hypot(*np.diff(xy, axis=0).T) * inner
        smooth, tangent = _smoothed(xy, row, np.concatenate([[0.0], np.cumsum(step)])[: len(row)])
        spacing = step_along(xy, row)
        points = _points(smooth, tangent, row, STEP * spacing)
        return cls(trees, row, smooth, tangent, *points, spacing, _distance(smooth, tangent, row) or spacing)

    @cached_property
    def tree(self) -> cKDTree:
        """A k-d tree over `points`."""
        return cKDTree(self.points)

    def feet(self, points: FloatArray, tangent: FloatArray, within: float) -> Feet:
        """The nearest line to each of the points (n, 2), metres, that runs within 30 degrees of `tangent` (n, 2).

        The nearest line alone is asked: where it crosses the tangent, or ends more than two trees before the point, or
        is farther than `within`, nothing is found.
        """
        _, foot = nearest(self.tree, points, within)
        near = foot < len(self.points)
        foot = np.where(near, foot, 0)
        t, offset = self.direction[foot], points - self.points[foot]
        normal = np.column_stack([-t[:, 1], t[:, 0]])
        parallel = np.abs((t * tangent).sum(axis=1)) > np.cos(np.radians(30)) * np.hypot(*tangent.T)
        on = ~self.ending[foot] | (np.abs((t * offset).sum(axis=1)) < BEYOND * self.spacing)
        return Feet(near & parallel & on, self.of_row[foot], normal, (normal * offset).sum(axis=1))


def lines_of(pair: Pair) -> tuple[MatchedRows, RowLines, RowLines]:
    """The rows of a pair, and their lines in both surveys. Raises `NoRegistration` when one of them has none."""
    if pair.rows is None:
        raise NoRegistration("no rows were detected, so none can be matched")
    lines = RowLines.of(pair.rows.reference, pair.reference), RowLines.of(pair.rows.source, pair.source)
    for found, survey in zip(lines, ("reference", "source"), strict=True):
        if not len(found.trees):
            raise NoRegistration(f"the {survey} has no row of two trees that stand apart, so no rows can be matched")
    return pair.rows, *lines


def trees_of(rows: Rows, features: FeatureSet) -> tuple[IntArray, IntArray]:
    """Positions (n,) of all trees of rows, row after row, and the row (n,) of each; unknown ids are left out."""
    row = np.repeat(np.arange(len(rows)), [len(trees) for trees in rows.trees])
    at = features.positions(np.concatenate([*rows.trees, np.empty(0, dtype=np.int64)]))
    return at[at >= 0], row[at >= 0]


def step_along(xy: FloatArray, row: IntArray) -> float:
    """The distance of consecutive trees, metres, of rows that stand one after the other in `xy`; 0 when there are none.

    That of the lower third: steps over missing trees are longer.
    """
    step = np.hypot(*np.diff(xy, axis=0).T)[np.diff(row) == 0]
    step = step[step > 0]
    return float(np.quantile(step, 1 / 3)) if len(step) else 0.0


def _smoothed(xy: FloatArray, row: IntArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Straight fits to the trees around each: its value there and its direction, both (n, 2)."""
    if len(row) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    place = np.arange(len(row))
    start, stop = np.searchsorted(row, row, "left"), np.searchsorted(row, row, "right")
    low, high = np.maximum(place - SMOOTHING, start), np.minimum(place + SMOOTHING + 1, stop)
    # Sums count from each row's own first tree, so that no digits are lost to far coordinates.
    t, offset = along - along[start], xy - xy[start]
    columns = np.column_stack([t, t * t, offset, t[:, None] * offset])
    total = np.concatenate([np.zeros((1, 6)), np.cumsum(columns, axis=0)])
    s = (total[high] - total[low]) / (high - low)[:, None]
    spread = s[:, 1] - s[:, 0] ** 2
    slope = (s[:, 4:] - s[:, :1] * s[:, 2:4]) / np.where(spread > 0, spread, 1)[:, None]
    # Several trees at one point say nothing on the direction: the whole row does.
    chord = xy[stop - 1] - xy[start]
    slope = np.where((np.hypot(*slope.T) > 1e-6)[:, None], slope, chord)
    length = np.hypot(*slope.T)
    tangent = np.where((length > 0)[:, None], slope / np.where(length > 0, length, 1)[:, None], (1.0, 0.0))
    return xy[start] + s[:, 2:4] + slope * (t - s[:, 0])[:, None], tangent


def _points(
    smooth: FloatArray, tangent: FloatArray, row: IntArray, step: float
) -> tuple[FloatArray, FloatArray, IntArray, BoolArray]:
    """Points along the lines at most `step` metres apart, with directions and rows, and whether a row ends there."""
    if step <= 0:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
    last = np.append(np.diff(row) != 0, True)
    first = np.append(True, last[:-1])
    way = np.roll(smooth, -1, axis=0) - smooth
    length = np.hypot(*way.T) * ~last
    step = max(step, float(length.sum()) / (MOST * len(row)))  # rows with a few huge steps must not fill the memory
    count = np.where(last, 1, np.maximum(np.ceil(length / step), 1)).astype(np.int64)
    at = np.repeat(np.arange(len(row)), count)
    begin = np.cumsum(count) - count
    part = ((np.arange(len(at)) - begin[at]) / count[at])[:, None]
    direction = (1 - part) * tangent[at] + part * np.roll(tangent, -1, axis=0)[at]
    length = np.hypot(*direction.T)[:, None]
    direction = np.where(length > 0.1, direction / np.where(length > 0.1, length, 1), tangent[at])
    ending = (part[:, 0] == 0) & (first | last)[at]
    return smooth[at] + part * way[at], direction, row[at], ending


def _distance(smooth: FloatArray, tangent: FloatArray, row: IntArray) -> float:
    """Median distance from a row to the nearest other one beside it, metres; 0 when there is none."""
    if len(row) < 2:
        return 0.0
    asked = np.unique(np.linspace(0, len(row) - 1, ASKED).astype(np.int64))
    _, near = cKDTree(smooth).query(smooth[asked], k=np.arange(2, min(NEIGHBOURS, len(row)) + 1))
    offset = smooth[near] - smooth[asked][:, None]
    along = np.abs((offset * tangent[asked][:, None]).sum(axis=2))
    across = np.abs(offset[..., 0] * tangent[asked][:, 1:] - offset[..., 1] * tangent[asked][:, :1])
    beside = np.where((row[near] != row[asked][:, None]) & (along < across), across, np.inf).min(axis=1)
    beside = beside[np.isfinite(beside)]
    return float(np.median(beside)) if len(beside) else 0.0
