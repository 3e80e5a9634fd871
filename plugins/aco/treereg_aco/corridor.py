"""The best row along a given one, in compiled code.

An ant's row shows where a row runs; which trees belong to it is then found exactly, by dynamic programming over all
free trees in the corridor about it. Daemon actions (Dorigo & Stuetzle 2004, doi:10.7551/mitpress/1290.001.0001) is
what such a local search is called in ant colony optimisation.
"""

from __future__ import annotations

import numpy as np

from treereg_aco.compiled import compiled
from treereg_aco.ground import SHORTEST, Ground, step
from treereg_aco.model import RowModel
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

# Trees of the row on either side that say where it runs, and how far they are asked, in in-row spacings.
ASKED = 6
ASKED_REACH = 4.0
# The farthest that a step leads aside, in half widths of a row.
ASIDE = 1.4
# The longest step of a row, in in-row spacings.
REACH = 4.5


@compiled
def best_chain(row: IntArray, ground: Ground, model: RowModel, free: BoolArray) -> tuple[IntArray, float]:
    """The likeliest row of free trees in the corridor about `row` and beyond its ends, and its quality.

    Quality is the natural logarithm of how much likelier the trees are a row than strangers: of each tree, how far it
    stands across from where its neighbours along the row put it and along from their planting positions, and what
    speaks for it being a tree; of each planting position between, that it shows none.
    """
    sense, place = along_row(row, ground)
    trees, from_tree, ahead = in_corridor(row, sense, ground, model, free)
    gain = np.empty(len(trees))
    phase = np.empty(len(trees))
    for k in range(len(trees)):
        gain[k], phase[k] = belonging(trees[k], from_tree[k], row, sense, ground, model)
    position = place[from_tree] + ahead
    kept = np.flatnonzero(gain > -np.inf)
    order = kept[np.argsort(position[kept])]
    best = gain[order].copy()
    before = np.full(len(order), -1)
    none = np.log(1 - model.taken)
    for k in range(len(order)):
        here = order[k]
        spacing = ground.spacing[trees[here]]
        for m in range(k - 1, -1, -1):
            there = order[m]
            gap = position[here] - position[there]
            if gap > (REACH + 0.5) * spacing:
                break
            steps = np.round((gap - phase[here] + phase[there]) / spacing)
            if steps >= 1 and gap > SHORTEST * spacing:
                worth = best[m] + gain[here] + (steps - 1) * none
                # each end may be where its own neighbours want it and yet stand in another row
                if worth > best[k] and abs(step(ground, trees[there], trees[here])[1]) < ASIDE * model.half_width:
                    best[k], before[k] = worth, m
    if len(order) == 0:
        return row[:0], -np.inf
    last = int(np.argmax(best))
    chain = [last]
    while before[chain[-1]] >= 0:
        chain.append(before[chain[-1]])
    return trees[order[np.array(chain[::-1])]], best[last]


@compiled
def along_row(row: IntArray, ground: Ground) -> tuple[FloatArray, FloatArray]:
    """For each tree of a row whether its frame looks along it (1) or back (-1), and how far along it stands, metres."""
    sense, place = np.ones(len(row)), np.zeros(len(row))
    if len(row) > 1 and step(ground, row[0], row[1])[0] < 0:
        sense[0] = -1.0
    for k in range(1, len(row)):
        ahead, _, turn = step(ground, row[k - 1], row[k])
        sense[k] = sense[k - 1] * turn
        place[k] = place[k - 1] + abs(ahead)
    return sense, place


@compiled
def in_corridor(
    row: IntArray, sense: FloatArray, ground: Ground, model: RowModel, free: BoolArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """The free trees near a row: each with the nearest tree of the row, as a place in it, and how far ahead of it."""
    seen = {}
    trees = [np.int64(0) for _ in range(0)]
    from_tree = [np.int64(0) for _ in range(0)]
    ahead = [0.0 for _ in range(0)]
    for k in range(len(row)):
        here = row[k]
        for m in range(-1, ground.near.shape[1]):
            other = here if m < 0 else ground.near[here, m]
            if not free[other]:
                continue
            along, across, _ = step(ground, here, other)
            along *= sense[k]
            if abs(across) > 2 * model.half_width or abs(along) > REACH * ground.spacing[here]:
                continue
            if other not in seen:
                seen[other] = len(trees)
                trees.append(other)
                from_tree.append(np.int64(k))
                ahead.append(along)
            elif abs(along) < abs(ahead[seen[other]]):
                from_tree[seen[other]], ahead[seen[other]] = np.int64(k), along
    return np.array(trees), np.array(from_tree), np.array(ahead)


@compiled
def belonging(
    tree: int, nearest: int, row: IntArray, sense: FloatArray, ground: Ground, model: RowModel
) -> tuple[float, float]:
    """How much likelier a tree belongs to a row than not, natural logarithm, and how far it stands off the row's
    planting positions along it, metres; both as the row's trees about the place `nearest` say."""
    weights = squares = aside = x = y = 0.0
    for k in range(max(0, nearest - ASKED), min(len(row), nearest + ASKED + 1)):
        if row[k] == tree:
            continue
        along, across, _ = step(ground, row[k], tree)
        spacings = sense[k] * along / ground.spacing[row[k]]
        weight = np.exp(-0.5 * (spacings / ASKED_REACH) ** 2) / (1 + (across / (2 * model.across)) ** 2)
        weights += weight
        squares += weight**2
        aside += weight * sense[k] * across
        x += weight * np.cos(2 * np.pi * spacings)
        y += weight * np.sin(2 * np.pi * spacings)
    if weights == 0:
        return -np.inf, 0.0
    aside /= weights
    phase = np.arctan2(y, x) / (2 * np.pi) * ground.spacing[tree]
    if abs(aside) > model.half_width:
        return -np.inf, phase
    spread = 1 + squares / weights**2  # of the tree itself, and of those that were asked
    off = (aside / model.across) ** 2 + (phase / model.along) ** 2
    density = -0.5 * off / spread - np.log(2 * np.pi * spread * model.along * model.across)
    return np.log(model.taken) + density - np.log(model.strangers) + ground.evidence[tree], phase
