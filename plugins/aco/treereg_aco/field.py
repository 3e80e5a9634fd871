"""A field of row directions grown from windows, so that rows may bend and blocks may differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from treereg_aco.nearby import nearby
from treereg_aco.waves import CHANCE, PEAKS, grow, window_peaks
from treereg_core.features import FeatureSet, IntArray
from treereg_core.transform import FloatArray

# Trees in a window; distance of windows and their largest radius in tree distances.
WINDOW = 80
STEP = 4.0
RADIUS = 8.0
# Waves that are looked for, per tree distance, and the grid of wave vectors.
LONGEST, SHORTEST = 1 / 3.4, 1 / 0.75
GRID = 0.05
# Lines with at least this share of the strongest ones' power can be the rows.
STRONG = 0.3
# Line spacings that differ by less than this share are the same, as on a square lattice.
SQUARE = 0.03
# Radius of the ground about a tree, in tree distances.
GROUND = 4.0
# Planting may be closer than trees stand by this share.
SPARSE = 0.75
# A single row has so many trees at least, and they scatter across it by this share of their distance at most.
LEAST_IN_ROW = 6
SLENDER = 0.25


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of trees: `centre` (m, 2), and the `waves` (m, PEAKS, 2) in each with their `power` (m, PEAKS).

    `near` (m, k) are the windows around each, itself first.
    """

    centre: FloatArray
    waves: FloatArray
    power: FloatArray
    near: IntArray


@dataclass(frozen=True, eq=False)
class Field:
    """The wave of the rows at each of m places: vectors (m, 2), per metre, and the number of the block (m,).

    `side` is the tree distance, metres.
    """

    centre: FloatArray
    wave: FloatArray
    block: IntArray
    side: float


def tree_distance(features: FeatureSet) -> float:
    """Side of the square that a tree has to itself, metres: the median, over trees, of the room of its neighbours."""
    count = min(max(len(features) // 4, 3), 12, len(features) - 1)
    distance = np.concatenate([found for _, found, _ in nearby(features, [count + 1])])
    return float(np.median(distance) * np.sqrt(np.pi / count))


def row_field(features: FeatureSet) -> Field:
    """The waves of the rows wherever there are rows; no place at all where the trees stand in none."""
    alone = single_row(features)
    if alone is not None:
        return alone
    side = tree_distance(features)
    field = field_of(features, side)
    # where many trees are missing, those left stand farther apart than the planting
    return field if len(field.block) else field_of(features, SPARSE * side)


def field_of(features: FeatureSet, side: float) -> Field:
    """The field of all blocks, for trees that are planted about so many metres apart.

    Blocks are grown one after the other, each from its clearest window and from each of that window's waves. The rows
    are the lines of the widest spacing among the strong ones, since there trees stand closest in line; on a square
    lattice, those along which the block is longer.
    """
    windows = windows_of(features, side)
    free = np.ones(len(windows.centre), dtype=np.bool_)
    wave, block = np.zeros((len(free), 2)), np.full(len(free), -1, dtype=np.int64)
    home = np.asarray(cKDTree(windows.centre).query(features.xy)[1], dtype=np.int64)
    number = 0
    while True:
        seed = int(np.argmax(np.where(free, windows.power[:, 0], 0)))
        if not free[seed] or windows.power[seed, 0] < CHANCE:
            break
        peaks = [peak for peak in range(PEAKS) if windows.power[seed, peak] >= CHANCE]
        grown = [grow(windows.waves, windows.power, windows.near, free, (seed, peak)) for peak in peaks]
        most = max(power.sum() for _, power in grown)
        chosen, power = widest(features, home, side, [(w, p) for w, p in grown if p.sum() >= STRONG * most])
        inside = power > 0
        wave[inside], block[inside] = chosen[inside], number
        free &= ~inside
        number += 1
    seen = block >= 0
    return Field(windows.centre[seen], wave[seen], block[seen], side)


def single_row(features: FeatureSet) -> Field | None:
    """The field of trees that all stand in one straight row, which makes no wave; None where they do not."""
    _, size, axes = np.linalg.svd(features.xy - features.xy.mean(axis=0), full_matrices=False)
    if len(features) < LEAST_IN_ROW or size[1] > SLENDER * features.spacing * np.sqrt(len(features)):
        return None
    return Field(features.xy[:1], axes[1:] / features.spacing, np.zeros(1, dtype=np.int64), features.spacing)


def windows_of(features: FeatureSet, side: float) -> Windows:
    """Overlapping windows over all trees, and the waves in each."""
    cell = np.floor((features.xy - features.xy.min(axis=0)) / (STEP * side)).astype(np.int64)
    which = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(which)
    centre = np.column_stack([np.bincount(which, x) / count for x in features.xy.T])
    size = min(WINDOW, len(features))
    distance, members = features.tree.query(centre, k=list(range(1, size + 1)), distance_upper_bound=RADIUS * side)
    members = np.where(np.isfinite(distance), members, -1)
    waves, power = window_peaks(features.xy, centre, members, GRID / side, LONGEST / side, SHORTEST / side)
    near = cKDTree(centre).query(centre, k=list(range(1, min(9, len(centre)) + 1)))[1]
    return Windows(centre, waves, power, np.asarray(near, dtype=np.int64))


def widest(
    features: FeatureSet, home: IntArray, side: float, grown: list[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Of several families of lines through one block the one of the widest spacing; among equals the longest lines.

    `home` (n,) is the window of each tree.
    """
    spacing = [np.median(1 / np.hypot(*wave[power > 0].T)) for wave, power in grown]
    alike = [family for family, s in zip(grown, spacing, strict=True) if s >= (1 - SQUARE) * max(spacing)]
    if len(alike) == 1:
        return alike[0]
    # each tree counts for the ground about it, so that trees which one survey misses turn nothing
    ground = 1 / np.asarray(features.tree.query_ball_point(features.xy, GROUND * side, return_length=True))

    def extent(family: tuple[FloatArray, FloatArray]) -> float:
        wave, power = family
        inside = power > 0
        x, y = (wave[inside] / np.hypot(*wave[inside].T)[:, None]).mean(axis=0)
        along = features.xy[inside[home]] @ np.array([-y, x]) / np.hypot(x, y)
        weight = ground[inside[home]] / ground[inside[home]].sum()
        return float(weight @ (along - weight @ along) ** 2)

    return max(alike, key=extent)
