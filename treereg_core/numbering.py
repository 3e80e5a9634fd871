"""Numbers for rows: the order and sense in which people count them, from the north-west corner of the block."""

from __future__ import annotations

import heapq
from collections.abc import Sequence

import numpy as np

from treereg_core.course import Course, continued
from treereg_core.features import FeatureSet, IntArray
from treereg_core.pair import Rows
from treereg_core.transform import FloatArray

ROUNDING_M = 1e-6
"""What lies less apart, metres, lies so by rounding."""
DIAGONAL = 1e-6
"""Cosine below which a direction counts as square to the north-west."""
LEAST_COSINE = 0.5
"""A row that heads further than 60 degrees from the common direction, such as a windbreak along the rows' ends, is
counted with those of its own kind, after the others."""
LEAST_LENGTH = 2.0
"""A row that is shorter, in distances between trees, has no direction to speak of."""
BAND = 0.37
"""Lines of rows that lie less apart across, in distances of rows, count as one; not a share that a layout has."""


def numbered(rows: Rows, features: FeatureSet) -> Rows:
    """The same rows as people count them: row 1 is `trees[0]`, its tree 1 is `trees[0][0]`, at the north-west corner.

    Use it wherever a row or a tree gets a number. `features` holds the trees of the rows; `xy` is east and north.

    - The corner is one of the four of the block in the rows' own frame, the one towards the north-west by direction
      alone, whatever the block's shape; of two that are equally so, the northern. So numbers survive any shift, and
      turns unless these take the rows across a diagonal (a heading of 45 or 135 degrees).
    - Each row runs away from that corner, by its ends.
    - Rows are counted across, away from the corner. Of two rows that stand opposite each other the nearer one comes
      first, however they bend. Rows that are pieces of one line, as on both sides of a path, follow each other along
      it.
    - Rows across the common direction (further than 60 degrees from it) come after the others, counted likewise.

    The result does not depend on the order and sense in which rows are given, nor on the order of the trees in
    `features`. Rows that cross or overlap are counted in some order of this kind; rows without trees come last. Takes
    time in proportion to n log n. Raises `ValueError` for a tree that is not in `features`.
    """
    given = [row.tolist() for row in rows.trees if len(row)]
    rest = [np.array(row, dtype=np.int64) for row in sorted(min(row, row[::-1]) for row in given)]
    if rest and (features.positions(np.concatenate(rest)) < 0).any():
        raise ValueError("a row holds a tree that is not in its survey")
    done: list[IntArray] = []
    while rest:
        alike, rest = _of_one_direction(rest, features)
        done += _counted(alike, features)
    return Rows((*done, *(row for row in rows.trees if not len(row))))


def _of_one_direction(rows: list[IntArray], features: FeatureSet) -> tuple[list[IntArray], list[IntArray]]:
    """The rows that head in the common direction, at least one, and the others."""
    direction = common_direction(rows, features)
    chord = _chords(rows, features)
    length = np.hypot(*chord.T)
    alike = np.abs(chord @ direction) >= LEAST_COSINE * length
    if alike.all() or not alike.any():
        return rows, []
    alike |= length < LEAST_LENGTH * np.median(_steps(rows, features)[1])
    return [rows[i] for i in np.flatnonzero(alike)], [rows[i] for i in np.flatnonzero(~alike)]


def _chords(rows: list[IntArray], features: FeatureSet) -> FloatArray:
    """From the first to the last tree of each row, metres (rows, 2)."""
    ends = features.positions([[row[0], row[-1]] for row in rows])
    return np.asarray(features.xy[ends[:, 1]] - features.xy[ends[:, 0]])


def common_direction(rows: Sequence[IntArray], features: FeatureSet) -> FloatArray:
    """The mean direction of rows, a unit vector (2,) with no sense: steps from tree to tree, weighted by their length.

    East where the rows have no direction in common. None of the rows may be empty.
    """
    step, length = _steps(rows, features)
    doubled = np.sum((step[:, 0] + 1j * step[:, 1]) ** 2 / length)
    if abs(doubled) <= 1e-9 * length.sum():
        return np.array([1.0, 0.0])
    angle = np.angle(doubled) / 2
    return np.array([np.cos(angle), np.sin(angle)])


def _steps(rows: Sequence[IntArray], features: FeatureSet) -> tuple[FloatArray, FloatArray]:
    """The steps (k, 2) from tree to tree along rows and their lengths (k,), metres; those of no length left out."""
    xy = features.xy[features.positions(np.concatenate(rows))]
    row = np.repeat(np.arange(len(rows)), [len(trees) for trees in rows])
    step = np.diff(xy, axis=0)[row[1:] == row[:-1]]
    length = np.hypot(*step.T)
    return step[length > ROUNDING_M], length[length > ROUNDING_M]


def _away_from_north_west(axis: FloatArray) -> FloatArray:
    """The sense of an axis that leads away from the north-west, or from the north where both senses are equal."""
    towards = (axis[1] - axis[0]) / np.sqrt(2)
    return np.asarray(-axis * np.sign(towards if abs(towards) > DIAGONAL else axis[1]))


def _counted(rows: list[IntArray], features: FeatureSet) -> list[IntArray]:
    """Rows of one direction in their order and sense."""
    direction = common_direction(rows, features)
    along = _away_from_north_west(direction)
    across = _away_from_north_west(np.array([-direction[1], direction[0]]))
    chord = _chords(rows, features) @ np.column_stack([along, across])
    first = np.where(np.abs(chord[:, 0]) > ROUNDING_M, chord[:, 0], chord[:, 1])
    rows = [row[::-1] if back else row for row, back in zip(rows, first < -ROUNDING_M, strict=True)]
    xy = features.xy[features.positions(np.concatenate(rows))] @ np.column_stack([along, across])
    course = Course.of(xy, np.array([len(row) for row in rows]))
    if course is None:
        return rows
    lines = continued(course)
    return [rows[piece] for line in _in_order(course, lines) for piece in lines[line]]


def _in_order(course: Course, lines: list[list[int]]) -> list[int]:
    """The lines by what stands before what; where nothing does, by where they lie across, then along."""
    label = np.empty(len(course.first), dtype=np.int64)
    for number, line in enumerate(lines):
        label[line] = number
    label = label[course.row]
    middle = np.bincount(label, course.level) / np.bincount(label)
    begin = np.array([course.first[line[0]] for line in lines])
    rank = np.empty(len(lines), dtype=np.int64)
    rank[np.lexsort((middle, begin, _bands(middle, BAND * course.apart)))] = np.arange(len(lines))
    return _sorted(_before(course, label), rank)


def _bands(values: FloatArray, width: float) -> IntArray:
    """For each value its band, counted upwards; a band begins at its least value and is so wide."""
    order = np.argsort(values, kind="stable")
    band = np.empty(len(values), dtype=np.int64)
    number, begin = -1, -np.inf
    for place in order:
        if values[place] > begin + width:
            number, begin = number + 1, values[place]
        band[place] = number
    return band


def _before(course: Course, label: IntArray) -> IntArray:
    """Pairs (k, 2) of lines that stand opposite each other as neighbours, the first the nearer to the corner."""
    near, far = course.opposite
    a, b, apart = label[near], label[far], course.across[far] - course.across[near]
    a, b, apart = a[a != b], b[a != b], apart[a != b]
    count = int(label.max()) + 1
    pair, where = np.unique(np.minimum(a, b) * count + np.maximum(a, b), return_inverse=True)
    net = np.bincount(where, np.where(a < b, apart, -apart), minlength=len(pair))
    lower, upper = np.divmod(pair, count)
    told = np.abs(net) > ROUNDING_M
    pairs = np.column_stack([np.where(net > 0, lower, upper), np.where(net > 0, upper, lower)])
    return np.asarray(pairs[told])


def _sorted(before: IntArray, rank: IntArray) -> list[int]:
    """A topological order that takes, of all that are free, the one of the lowest rank; of a circle too."""
    after: list[list[int]] = [[] for _ in rank]
    waits = np.bincount(before[:, 1], minlength=len(rank)).tolist()
    for a, b in before.tolist():
        after[a].append(b)
    free = [(place, line) for line, place in enumerate(rank.tolist()) if not waits[line]]
    heapq.heapify(free)
    by_rank = iter(np.argsort(rank).tolist())
    order: list[int] = []
    taken = [False] * len(rank)
    while len(order) < len(rank):
        # when none is free, lines go round in a circle, and the next by rank breaks it
        line = heapq.heappop(free)[1] if free else next(line for line in by_rank if not taken[line])
        if taken[line]:
            continue
        taken[line] = True
        order.append(line)
        for other in after[line]:
            waits[other] -= 1
            if not waits[other]:
                heapq.heappush(free, (int(rank[other]), other))
    return order
