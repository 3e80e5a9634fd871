"""The whole search: rows among all trees, then among those left over, where some may run another way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from treereg_aco.colony import search
from treereg_aco.field import tree_distance
from treereg_aco.frames import Frames, row_frames
from treereg_aco.ground import Ground, graph_of
from treereg_aco.habits import Habits
from treereg_aco.model import RowModel, evidence, first_model, learned
from treereg_aco.paths import ended_at_paths
from treereg_aco.stitching import stitched
from treereg_core.errors import NoRegistration
from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.transform import FloatArray

# Searches among the trees left over, the first included.
LAYERS = 3
# Least share of the trees in rows where there are rows, within so many tree distances. In a forest, whose trees keep
# apart, chance gives up to half; an orchard with a third missed and a third false two thirds.
LEAST_SHARE, HERE = 0.5, 1.2
# Rows that run another way have so many trees at least, this share of them in no other row, and steps not much longer
# than other rows': among strangers there are rows by chance, and the loose ends of rows stand in line.
LONG, STRANGE, CLOSE = 6, 0.5, 1.5
# A step so many times longer than the row's usual one sets the trees beyond it apart, up to so many.
WIDE, LOOSE = 1.4, 3
# So many standard deviations of what errors of planting and detection make of a straight row are a turn of the row; the
# sharpest turns that are always and ever allowed, degrees.
TURN = 4.0
TURNS = (30.0, 90.0)


def all_rows(features: FeatureSet, habits: Habits, rng: Callable[[int], np.random.Generator]) -> list[IntArray]:
    """The rows of a survey, each as the ids of its trees in order; `rng` gives the random numbers of a layer.

    Raises `NoRegistration` where the trees stand in no rows.
    """
    trees = upright(features)
    side = tree_distance(trees)
    rows, free = layer_of(trees, side, habits, rng(0))
    share = share_in_rows(trees, free)
    if share < LEAST_SHARE:
        raise NoRegistration(f"rows would hold only {share:.0%} of the trees about them, as they may by chance")
    usual = float(np.median([usual_step(row, trees.xy) for row in rows]))
    for layer in range(1, LAYERS):
        loose = free.copy()
        for row in rows:
            first, after = without_loose_ends(row, trees.xy)
            loose[row[:first]] = loose[row[after:]] = True
        at = np.flatnonzero(loose)
        try:
            found, _ = layer_of(trees.take(at), side, habits, rng(layer))
        except NoRegistration:
            break
        found = [at[row] for row in found if len(row) >= LONG]
        found = [row for row in found if free[row].mean() >= STRANGE and usual_step(row, trees.xy) <= CLOSE * usual]
        if not found:
            break
        taken = np.isin(np.arange(len(trees)), np.concatenate(found))
        rows = [row for row in (row[~taken[row]] for row in rows) if len(row) > 1] + found
        free = ~np.isin(np.arange(len(trees)), np.concatenate(rows))
    return [trees.ids[row] for row in rows]


def upright(features: FeatureSet) -> FeatureSet:
    """The same trees about their centre, their longest extent along x, in the order of x.

    So neither the order of trees in their file matters to what is found, nor how the survey lies on the map.
    """
    centred = features.xy - features.xy.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    axis *= -1 if ((centred @ axis) ** 3).sum() < 0 else 1
    xy = centred @ np.array([[axis[0], -axis[1]], [axis[1], axis[0]]])
    return features.replace(xy=xy).take(np.lexsort((features.ids, xy[:, 1], xy[:, 0])))


def layer_of(
    trees: FeatureSet, side: float, habits: Habits, rng: np.random.Generator
) -> tuple[list[IntArray], BoolArray]:
    """Rows as positions of trees in order, and which trees are left over (n,). Raises `NoRegistration` for no rows."""
    frames = row_frames(trees, side)
    model = first_model(trees, frames)
    ground = Ground(trees.xy, frames.along, frames.spacing, frames.near, np.zeros(len(trees)))
    graph = graph_of(ground, habits.reach, 1.6 * model.half_width, model.across)
    if np.isnan(habits.angle_limit):
        habits = habits._replace(angle_limit=angle_limit(model, frames))
    rows, left = search(ground, graph, model, habits, rng)
    # what the first search has shown of rows and strangers teaches the second
    model = learned(model, frames, rows, trees.xy)
    ground = ground._replace(evidence=evidence(trees, ~left))
    rows, _ = search(ground, graph, model, habits, rng)
    if rows:
        rows = ended_at_paths(stitched(rows, trees.xy, frames, habits.stitching_reach), trees.xy, frames)
    if not rows:
        raise NoRegistration(f"the {len(trees)} trees stand in no rows that can be told from chance")
    return rows, ~np.isin(np.arange(len(trees)), np.concatenate(rows))


def angle_limit(model: RowModel, frames: Frames) -> float:
    """The sharpest angle of a row that errors of planting and detection explain, degrees: sharper in dense rows."""
    turn = TURN * np.degrees(np.sqrt(6) * model.across / np.median(frames.spacing))
    return 180 - float(np.clip(turn, *TURNS))


def share_in_rows(trees: FeatureSet, free: BoolArray) -> float:
    """The share of trees in rows among all that stand where there are rows."""
    here = cKDTree(trees.xy[~free]).query(trees.xy)[0] < HERE * tree_distance(trees)
    return float(np.count_nonzero(~free) / np.count_nonzero(here))


def usual_step(row: IntArray, xy: FloatArray) -> float:
    """The median step of a row, metres."""
    return float(np.median(np.hypot(*np.diff(xy[row], axis=0).T)))


def without_loose_ends(row: IntArray, xy: FloatArray) -> tuple[int, int]:
    """Where a row begins and where it has ended without the few trees at its ends that stand apart from the others.

    They may belong to rows across its end. A very short row may stand across others as a whole.
    """
    if len(row) <= LOOSE:
        return len(row), len(row)
    steps = np.hypot(*np.diff(xy[row], axis=0).T)
    wide = np.flatnonzero(steps > WIDE * usual_step(row, xy))
    head, tail = wide[wide < LOOSE], wide[wide >= max(len(steps) - LOOSE, LOOSE)]
    return (int(head[-1]) + 1 if len(head) else 0), (int(tail[0]) + 1 if len(tail) else len(row))
