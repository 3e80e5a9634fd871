"""Joining rows that were found in pieces."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from treereg_aco.frames import Frames, between
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

# Trees at an end of a row that say where it goes on.
ASKED = 6
# Ends that are nearer, in in-row spacings, lie beside each other; joining them would make a triangle.
BESIDE = 0.6
# Cosine of the angle by which the rows may turn from one piece to the next.
SAME_WAY = 0.8
# Share of a lane by which two pieces of one row may be off each other.
OFF = 0.25


def stitched(rows: list[IntArray], xy: FloatArray, frames: Frames, reach: float) -> list[IntArray]:
    """The rows, those joined of which one goes on where the other ends, within `reach` in-row spacings.

    The nearest ends are joined first.
    """
    if len(rows) < 2:
        return rows
    # ends 2k and 2k+1 are head and tail of row k; each with its last trees, outermost first
    last = np.array([sided[np.minimum(np.arange(ASKED), len(row) - 1)] for row in rows for sided in (row, row[::-1])])
    spacing = float(np.median(frames.spacing))
    outward = xy[last[:, 0]] - xy[last[:, -1]]
    a, b = cKDTree(xy[last[:, 0]]).query_pairs(reach * spacing, output_type="ndarray").T
    forward, across = between(xy, frames.along, last[a][:, :, None], last[b][:, None, :])
    gap = xy[last[b, 0]] - xy[last[a, 0]]
    off = np.abs(across.mean(axis=(1, 2)))
    far = np.abs(forward[:, 0, 0])
    facing = ((gap * outward[a]).sum(axis=1) > 0) & ((gap * outward[b]).sum(axis=1) < 0)
    turn = np.abs((frames.along[last[a, 0]] * frames.along[last[b, 0]]).sum(axis=1))
    facing &= turn > SAME_WAY
    good = (a // 2 != b // 2) & facing & (far >= BESIDE * spacing) & (off <= OFF * frames.lane)
    joined: dict[int, int] = {}
    group = list(range(len(rows)))
    for k in np.flatnonzero(good)[np.argsort(far[good], kind="stable")]:
        first, second = int(a[k]), int(b[k])
        whole, other = found_in(group, first // 2), found_in(group, second // 2)
        if first in joined or second in joined or whole == other:
            continue
        joined[first], joined[second] = second, first
        group[other] = whole
    return chains(rows, joined)


def found_in(group: list[int], row: int) -> int:
    """The group of a row, in a forest where each points to one further up; paths are halved on the way."""
    while group[row] != row:
        group[row] = group[group[row]]
        row = group[row]
    return row


def chains(rows: list[IntArray], joined: dict[int, int]) -> list[IntArray]:
    """The rows linked through their joined ends, 2k the head and 2k + 1 the tail of row k."""
    done: set[int] = set()
    whole: list[IntArray] = []
    for end in range(2 * len(rows)):
        if end in joined or end // 2 in done:
            continue
        pieces: list[IntArray] = []
        here: int | None = end
        while here is not None:
            row = rows[here // 2]
            pieces.append(row if here % 2 == 0 else row[::-1])
            done.add(here // 2)
            here = joined.get(here ^ 1)
        whole.append(np.concatenate(pieces))
    return whole
