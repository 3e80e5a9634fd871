"""Course: rows that run side by side, seen at common stations, and which of them are pieces of one line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

FIRST_STATION = 0.37
"""How far the first station lies behind the first tree, in distances between stations. Like the shares below, it is one
that a planted lattice has nowhere, so that rounding decides nothing.
"""
REACH = (0.37, 8.3)
"""The narrowest and the widest path that a line of rows goes on across, in distances between trees."""
TOLERANCE = 0.47
"""How far to the side a row may go on beyond a path, in distances between rows."""
TREES_AT_END = 5
"""Trees that say where a row is heading at its end."""
ENDS_AROUND = 9
"""Row ends, itself included, that say where a row is heading besides its own trees."""
LEVER = 4.0
"""How much the others weigh in that: as trees would, so far from the middle of its own, in distances between trees."""
CANDIDATES = 16
"""Rows that are looked at as the continuation of another."""


@dataclass(frozen=True, eq=False)
class Course:
    """Rows in their own frame: `along` the common direction, `across` it, metres.

    - `step`: the median distance between trees of a row. `first`, `last` (rows,): where each begins and ends along.
    - `row`, `station`, `across` (s,): the rows as they cross stations half a step apart; each crosses one at least.
    - `level` (s,): `across` less the bend that all rows have in common.
    - `at_ends`: of each row (rows, 2, 3) at its begin and end: a place along, the level there, and its slope.
    """

    step: float
    first: FloatArray
    last: FloatArray
    row: IntArray
    station: IntArray
    across: FloatArray
    level: FloatArray
    at_ends: FloatArray

    @classmethod
    def of(cls, xy: FloatArray, sizes: IntArray) -> Course | None:
        """Rows of so many trees each, one after the other in `xy` (n, 2), along and across; None if all at one spot."""
        row = np.repeat(np.arange(len(sizes)), sizes)
        step = np.hypot(*np.diff(xy, axis=0)[row[1:] == row[:-1]].T)
        step = step[step > 1e-6]
        if not len(step):
            return None
        u, v = (xy - xy[0]).T
        u = u - u.min()
        order = np.lexsort((u, row))
        u, v = u[order], v[order]
        end = np.cumsum(sizes)
        first, last = u[end - sizes], u[end - 1]
        # so many stations that each step has two, yet never many more than there are trees
        spacing = max(float(np.median(step)) / 2, float(np.sum(last - first)) / (4 * len(u)))
        u, first, last = (along + FIRST_STATION * spacing for along in (u, first, last))
        low, high = np.ceil(first / spacing).astype(int), np.floor(last / spacing).astype(int)
        missed = high < low
        low[missed] = high[missed] = np.round((first + last)[missed] / 2 / spacing).astype(int)
        count = high - low + 1
        crossing = np.repeat(np.arange(len(sizes)), count)
        station = np.arange(len(crossing)) - np.repeat(np.cumsum(count) - count - low, count)
        apart = u.max() + 1  # rows one after the other on one axis, so that one call interpolates them all
        place = np.clip(station * spacing, first[crossing], last[crossing])
        across = np.interp(crossing * apart + place, row * apart + u, v)
        stations, station = np.unique(station, return_inverse=True)
        bend = _common_bend(crossing, station, across, stations * spacing)
        level = v - np.interp(u, stations * spacing, bend)
        return cls(
            step=float(np.median(step)),
            first=first,
            last=last,
            row=crossing,
            station=station.astype(np.int64),
            across=across,
            level=across - bend[station],
            at_ends=_heading(u, level, sizes, float(np.median(step))),
        )

    @cached_property
    def opposite(self) -> tuple[IntArray, IntArray]:
        """Crossings of one station that are neighbours there: the nearer to the corner, and the farther."""
        order = np.lexsort((self.across, self.station))
        same = self.station[order[1:]] == self.station[order[:-1]]
        return order[:-1][same], order[1:][same]

    @cached_property
    def apart(self) -> float:
        """The usual distance from row to nearest row, metres; that between trees where no two rows are opposite.

        A quartile, because rows whose neighbours end early lie opposite others that are farther off.
        """
        near, far = self.opposite
        gap = np.full((2, len(self.row)), np.inf)
        gap[0, far] = gap[1, near] = self.across[far] - self.across[near]
        nearest = gap.min(axis=0)
        nearest = nearest[np.isfinite(nearest) & (nearest > 0)]
        return float(np.quantile(nearest, 0.25)) if len(nearest) else self.step


def _common_bend(row: IntArray, station: IntArray, across: FloatArray, along: FloatArray) -> FloatArray:
    """How far all rows together have gone across, metres, at each station: their mean slope, summed up.

    `along` says where each station is. The slope is a running mean, carried on over what no row crosses.
    """
    if len(along) < 2:
        return np.zeros(len(along))
    on = np.flatnonzero(row[1:] == row[:-1])
    width = np.diff(along)
    window = np.ones(2 * TREES_AT_END + 1)
    run = np.convolve(np.bincount(station[on], minlength=len(width)) * width, window)[TREES_AT_END:-TREES_AT_END]
    climb = np.bincount(station[on], np.diff(across)[on], minlength=len(width))
    rise = np.convolve(climb, window)[TREES_AT_END:-TREES_AT_END]
    middle, known = (along[1:] + along[:-1]) / 2, run > 0
    slope = np.interp(middle, middle[known], rise[known] / run[known]) if known.any() else np.zeros(len(width))
    return np.concatenate([[0.0], np.cumsum(slope * width)])


def _heading(u: FloatArray, level: FloatArray, sizes: IntArray, step: float) -> FloatArray:
    """For each row (rows, 2, 3), of its first and of its last trees: mean place along, mean level, slope.

    A few trees tell little of where they head, so the slope is drawn towards that of the row ends around.
    """
    end = np.cumsum(sizes)
    offset = np.arange(TREES_AT_END)
    index = np.stack([(end - sizes)[:, None] + offset, (end - 1)[:, None] - offset], axis=1)
    inside = np.broadcast_to((offset < sizes[:, None])[:, None], index.shape)
    index = np.where(inside, index, 0)
    many = inside.sum(axis=2)
    x, y = np.where(inside, u[index], 0), np.where(inside, level[index], 0)
    middle, height = x.sum(axis=2) / many, y.sum(axis=2) / many
    lever = np.where(inside, x - middle[..., None], 0)
    moment, inertia = (lever * y).sum(axis=2), (lever**2).sum(axis=2)
    slope = np.empty_like(moment)
    for side in (0, 1):
        at = np.column_stack([middle[:, side], height[:, side]])
        around = np.asarray(cKDTree(at).query(at, k=np.arange(1, min(ENDS_AROUND, len(at)) + 1))[1])
        stiffness = (LEVER * step) ** 2
        general = moment[around, side].sum(axis=1) / (inertia[around, side].sum(axis=1) + stiffness)
        slope[:, side] = (moment[:, side] + stiffness * general) / (inertia[:, side] + stiffness)
    return np.stack([middle, height, slope], axis=2)


def continued(course: Course) -> list[list[int]]:
    """The lines: each a list of rows that follow on each other along it, mostly of one row alone.

    A row goes on in another when that begins beyond a path of moderate width, where the first was heading, and each is
    the other's best.
    """
    follows = dict(_continuations(course).tolist())
    later = set(follows.values())
    lines = []
    for row in range(len(course.first)):
        if row not in later:
            lines.append([row])
            while lines[-1][-1] in follows:
                lines[-1].append(follows[lines[-1][-1]])
    return lines


def _continuations(course: Course) -> IntArray:
    """Pairs (k, 2) of a row and the one in which it goes on; each row stands on each side once at most."""
    least, reach = (share * course.step for share in REACH)
    tolerance = TOLERANCE * course.apart
    start, stop = course.at_ends[:, 0], course.at_ends[:, 1]

    def level(ends: FloatArray, along: FloatArray) -> FloatArray:
        return np.asarray(ends[:, 1] + ends[:, 2] * (along - ends[:, 0]))

    # a box ahead of each end: as long as the widest path, and to the side what a slope of a fifth adds to the tolerance
    box = np.array([reach / 2, tolerance + reach / 5])
    starts = np.column_stack([course.first, level(start, course.first)]) / box
    ahead = np.column_stack([course.last + reach / 2, level(stop, course.last)]) / box
    many = min(CANDIDATES, len(starts))
    near = cKDTree(starts).query(ahead, k=np.arange(1, many + 1), p=np.inf, distance_upper_bound=1.0)
    found = np.asarray(near[1])
    a, rank = np.nonzero(found < len(starts))
    b = found[a, rank]
    gap = course.first[b] - course.last[a]
    half_way = (course.first[b] + course.last[a]) / 2
    aside = np.abs(level(stop[a], half_way) - level(start[b], half_way))
    fits = (gap > least) & (aside < tolerance)
    a, b, cost = a[fits], b[fits], gap[fits] / reach + aside[fits] / tolerance
    order = np.lexsort((b, a, np.round(cost, 6)))  # rounding must not choose between two that are equally good
    a, b = a[order], b[order]
    best = np.intersect1d(np.unique(a, return_index=True)[1], np.unique(b, return_index=True)[1])
    return np.column_stack([a[best], b[best]]).astype(np.int64)
