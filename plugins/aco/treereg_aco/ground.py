"""The trees as the ants see them, in compiled code: steps in the rows' own frame, and where a step can lead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from treereg_aco.compiled import compiled
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

# Steps kept for each tree and side.
STEPS = 8
# A step is at least this long, in in-row spacings: nearer trees are two detections of one.
SHORTEST = 0.35
# Length of the sum of two unit vectors along rows that turn by 37 degrees; and farther aside, metres, than any row
# reaches.
ONE_WAY, FAR = 1.897, 1e6
# So many standard deviations across the rows are as far as one in-row spacing along them.
ACROSS = 3.0


class Ground(NamedTuple):
    """Trees: places `xy` and row directions `along` (n, 2), in-row `spacing` (n,), trees `near` each (n, k), and the
    `evidence` (n,) that each is a tree, natural log-odds. Metres."""

    xy: FloatArray
    along: FloatArray
    spacing: FloatArray
    near: IntArray
    evidence: FloatArray


class Graph(NamedTuple):
    """For each tree and side (0 ahead, 1 behind) the trees `to` (n, 2, STEPS) that a step can lead to, -1 for none, and
    how far they are in the rows' metric, `distance` likewise, nearest first."""

    to: IntArray
    distance: FloatArray


@compiled
def step(ground: Ground, i: int, j: int) -> tuple[float, float, float]:
    """From tree i to tree j: metres along and across the rows (left positive) in the mean frame of both.

    Also 1, or -1 where their frames look opposite ways. Where rows turn too much from one to the other, as from block
    to block, the one is as far aside as can be.
    """
    # number by number: slices of arrays would each take longer than all of this
    xi, yi = ground.along[i, 0], ground.along[i, 1]
    xj, yj = ground.along[j, 0], ground.along[j, 1]
    sense = 1.0 if xi * xj + yi * yj >= 0 else -1.0
    x, y = xi + sense * xj, yi + sense * yj
    length = np.hypot(x, y)
    if length < ONE_WAY:
        return 0.0, FAR, sense
    dx, dy = ground.xy[j, 0] - ground.xy[i, 0], ground.xy[j, 1] - ground.xy[i, 1]
    return (dx * x + dy * y) / length, (dy * x - dx * y) / length, sense


@compiled
def graph_of(ground: Ground, reach: float, width: float, across: float) -> Graph:
    """Where steps can lead: up to `reach` in-row spacings along and `width` metres across.

    The metric counts one in-row spacing along as 1, and `ACROSS` times `across` metres likewise.
    """
    n = len(ground.xy)
    to = np.full((n, 2, STEPS), -1, np.int64)
    distance = np.full((n, 2, STEPS), np.inf)
    for i in range(n):
        for j in ground.near[i]:
            ahead, aside, _ = step(ground, i, j)
            spacings = abs(ahead) / (0.5 * (ground.spacing[i] + ground.spacing[j]))
            if spacings < SHORTEST or spacings > reach or abs(aside) > width:
                continue
            far = np.hypot(spacings, aside / (ACROSS * across))
            side = 0 if ahead > 0 else 1
            place = STEPS
            while place > 0 and distance[i, side, place - 1] > far:
                place -= 1
            if place < STEPS:
                distance[i, side, place + 1 :] = distance[i, side, place:-1].copy()
                to[i, side, place + 1 :] = to[i, side, place:-1].copy()
                distance[i, side, place], to[i, side, place] = far, j
    return Graph(to, distance)
