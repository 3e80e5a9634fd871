"""Ending rows at paths: lanes for vehicles across the rows, where gaps of many neighbouring rows stand in line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from treereg_aco.frames import Frames
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

# A step so many times longer than the in-row spacing is a gap.
GAP = 1.35
# Directions in which a path may run, degrees from straight across the rows.
OBLIQUE = np.radians(np.arange(-12.0, 12.1, 3.0))
# The probability that a row has a gap where a path crosses it: a stranger may stand on the path.
OPEN = 0.93
# How much likelier than chance a path must be, natural logarithm.
CERTAIN = 7.0
# A path is so many times longer than it is wide; a hole in the orchard is not.
LONGER = 3.0
# One row crosses one path once: no cuts nearer than so many steps.
APART = 2
# The farthest from one row to the next, in row spacings; beyond it the orchard ends.
NEXT_ROW = 2.6


@dataclass(frozen=True, eq=False)
class Way:
    """Points along all rows, half an in-row spacing apart, and the steps from tree to tree that they lie on.

    Of the points: `xy`, the row's direction `along` (p, 2), `row` and `step` (p,). Of the steps: `length` (k,), metres,
    `gap` (k,), whether it is one, and `middle` (k, 2).
    """

    xy: FloatArray
    along: FloatArray
    row: IntArray
    step: IntArray
    length: FloatArray
    gap: BoolArray
    middle: FloatArray

    @classmethod
    def of(cls, rows: list[IntArray], xy: FloatArray, frames: Frames) -> Way:
        """The way through all rows; steps are numbered from row to row."""
        first = np.concatenate([row[:-1] for row in rows])
        second = np.concatenate([row[1:] for row in rows])
        row = np.repeat(np.arange(len(rows)), [len(r) - 1 for r in rows])
        length = np.hypot(*(xy[second] - xy[first]).T)
        spacing = np.maximum(frames.spacing[first], frames.spacing[second])
        count = np.maximum(np.round(2 * length / spacing).astype(np.int64), 1)
        step = np.repeat(np.arange(len(first)), count)
        part = (np.arange(len(step)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[step]
        place = xy[first[step]] + part[:, None] * (xy[second[step]] - xy[first[step]])
        middle = (xy[first] + xy[second]) / 2
        return cls(place, frames.along[first[step]], row[step], step, length, length > GAP * spacing, middle)


def ended_at_paths(rows: list[IntArray], xy: FloatArray, frames: Frames) -> list[IntArray]:
    """The rows, cut in two wherever a path crosses them."""
    way = Way.of(rows, xy, frames)
    cut = np.zeros(len(way.length), dtype=np.bool_)
    for _ in range(3):  # gaps that are explained no longer count as chance, which makes further paths plainer
        found = crossed(way, cut, frames)
        if not found.any():
            break
        cut |= found
    after = np.cumsum([len(row) - 1 for row in rows])
    pieces = []
    for row, here in zip(rows, np.split(cut, after[:-1]), strict=True):
        pieces += np.split(row, np.flatnonzero(here) + 1)
    return [piece for piece in pieces if len(piece) > 1]


def crossed(way: Way, cut: BoolArray, frames: Frames) -> BoolArray:
    """Which steps (k,) paths cross that are not cut yet.

    From every gap walkers set out across the rows, in all directions that a path may have. Each row that they come to
    is evidence for a path or against it; how far the evidence adds up best is how far the path goes.
    """
    gap = way.gap & ~cut
    share = float(way.length[gap].sum() / max(way.length[~cut].sum(), 1e-9))
    if not gap.any() or share >= OPEN:
        return np.zeros_like(cut)
    evidence = np.full(len(cut), np.log((1 - OPEN) / (1 - share)))
    evidence[gap] = np.log(OPEN / share)
    seeds = np.repeat(np.flatnonzero(gap), len(OBLIQUE))
    oblique = np.tile(OBLIQUE, np.count_nonzero(gap))
    left, right = (walk(way, evidence, seeds, sense * np.pi / 2 + oblique, frames) for sense in (1.0, -1.0))
    total = evidence[seeds] + left.evidence + right.evidence
    long = np.hypot(*(left.end - right.end).T)
    likely = (total >= CERTAIN + np.log(len(seeds))) & (long >= LONGER * np.median(way.length[gap]))
    worth = np.zeros(len(cut))
    for walker, step in ((np.arange(len(seeds)), seeds), left.passed, right.passed):
        counts = likely[walker] & gap[step]
        np.maximum.at(worth, step[counts], total[walker[counts]])
    return plainest(worth, cut, way)


def plainest(worth: FloatArray, cut: BoolArray, way: Way) -> BoolArray:
    """Of steps of some worth (k,) those with no cut, and no step of more worth, within `APART` steps along the row."""
    chosen = np.zeros(len(cut), dtype=np.bool_)
    row = np.zeros(len(cut), dtype=np.int64)
    row[way.step] = way.row
    for step in np.argsort(-worth, kind="stable")[: np.count_nonzero(worth)]:
        near = np.arange(max(step - APART, 0), min(step + APART + 1, len(cut)))
        chosen[step] = not (chosen[near] | cut[near])[row[near] == row[step]].any()
    return chosen


@dataclass(frozen=True, eq=False)
class Walks:
    """How walkers (w,) fared: the `evidence` where it was greatest, that place `end` (w, 2), and what they `passed` on
    the way there, as numbers of walkers and of steps."""

    evidence: FloatArray
    end: FloatArray
    passed: tuple[IntArray, IntArray]


def walk(way: Way, evidence: FloatArray, seeds: IntArray, angle: FloatArray, frames: Frames) -> Walks:
    """Walk from the middles of steps `seeds` (w,) over row after row, at angles (w,) to the rows, radians."""
    tree = cKDTree(way.xy)
    place = way.middle[seeds].copy()
    start = np.asarray(tree.query(place)[1], dtype=np.int64)
    row, heading = way.row[start].copy(), turned(way.along[start], angle)
    lane, farthest = frames.lane, NEXT_ROW * max(frames.lane, float(np.median(frames.row_spacing)))
    since, gone = np.zeros(len(seeds)), np.zeros(len(seeds))
    now, best, end = np.zeros(len(seeds)), np.zeros(len(seeds)), place.copy()
    history: list[tuple[IntArray, IntArray]] = []
    best_turn = np.zeros(len(seeds), dtype=np.int64)
    alive = np.arange(len(seeds))
    while len(alive):
        place[alive] += lane / 2 * heading[alive]
        since[alive] += lane / 2
        distance, nearest = tree.query(place[alive])
        near = np.asarray(nearest, dtype=np.int64)
        come = (way.row[near] != row[alive]) & (distance <= lane / 2)
        at, near = alive[come], near[come]
        across = turned(way.along[near], np.full(len(at), np.pi / 2))
        place[at] += ((way.xy[near] - place[at]) * across).sum(axis=1)[:, None] * across
        ahead = turned(way.along[near], angle[at])
        heading[at] = ahead * np.where((ahead * heading[at]).sum(axis=1) < 0, -1, 1)[:, None]
        row[at], since[at] = way.row[near], 0
        # where rows meet at angles, a walker could go round in a circle for ever
        far = np.hypot(*(place[at] - way.middle[seeds[at]]).T)
        onward = far > gone[at]
        since[at[~onward]] = np.inf
        at, near = at[onward], near[onward]
        gone[at] = far[onward]
        now[at] += evidence[way.step[near]]
        history.append((at, way.step[near]))
        better = at[now[at] > best[at]]
        best[better], end[better], best_turn[better] = now[better], place[better], len(history)
        alive = alive[(since[alive] <= farthest) & (now[alive] > best[alive] - CERTAIN)]
    turn = np.repeat(np.arange(1, len(history) + 1), [len(at) for at, _ in history])
    walker = np.concatenate([walkers for walkers, _ in history])
    step = np.concatenate([steps for _, steps in history])
    kept = turn <= best_turn[walker]
    return Walks(best, end, (walker[kept], step[kept]))


def turned(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (n, 2) turned by angles, radians, counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])
