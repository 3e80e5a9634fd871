"""Which way the rows run at every tree, and how far apart they and their trees stand.

Rows are a wave: in a window of some eighty trees the structure factor, |sum exp(2 pi i k.x)|^2, peaks at the wave
vectors of all families of parallel lines through the lattice. Missing and false trees weaken the peaks but do not
move them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from treereg_aco.field import STEP, Field, row_field
from treereg_aco.nearby import AT_A_TIME, nearby
from treereg_aco.waves import add_comb
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray
from treereg_core.transform import FloatArray

# Neighbours of a tree that are looked at.
NEIGHBOURS = 32
# In-row spacings that are looked for, in tree distances, and how many.
SPACINGS = np.linspace(1 / 1.8, 1 / 0.25, 140)
# In-row spacings are at most so many times the row spacing: 1.155 where trees stand in triangles.
WIDEST = 1.3
# Of the spacings that fit the steps along rows the longest is taken that fits this well against the best.
FITS = 0.6
# Width, in row spacings, of the strip along a row in which steps count as being along it.
STRIP = 0.12


@dataclass(frozen=True, eq=False)
class Frames:
    """For each tree: the unit vector along its row (n, 2), the spacing in the row (n,) and that of rows (n,), metres.

    Vectors run the same way from tree to tree within a block, but for a seam
    where its rows close round a hilltop. `near` (n, k) are the trees around each, nearest first,
    itself left out. `lane` is the distance from a row to the nearest other one, metres: less than the row spacing where
    rows stand in pairs.
    """

    along: FloatArray
    spacing: FloatArray
    row_spacing: FloatArray
    near: IntArray
    lane: float


def row_frames(features: FeatureSet, side: float) -> Frames:
    """The frame of the rows at every tree. Raises `NoRegistration` where the trees stand in no rows.

    `side` is the distance of trees in the orchard, metres; these may be only some of them.
    """
    if len(features) < 2 or features.spacing == 0:
        raise NoRegistration(f"{len(features)} trees are too few, or too close together, to show rows")
    field = row_field(features)
    if not len(field.block):
        raise NoRegistration(f"the {len(features)} trees stand in no rows that can be told from chance")
    at, weight = around(field, features.xy)
    wave = field.wave[at]
    # round a hilltop a field of lines cannot be given one sense everywhere
    wave = wave * np.where((wave * wave[:, :1]).sum(axis=2) < 0, -1, 1)[..., None]
    wave = (wave * weight[..., None]).sum(axis=1)
    length = np.hypot(*wave.T)
    along = np.column_stack([-wave[:, 1], wave[:, 0]]) / length[:, None]
    count = min(NEIGHBOURS, len(features) - 1)
    near = np.empty((len(features), count), dtype=np.int64)
    for some, _, found in nearby(features, range(2, count + 2)):
        near[some] = found
    fit = comb_fit(steps(features.xy, along, near), (field, at[:, 0]), 1 / length, side)
    spacing = (spacings(field, side, fit)[at] * weight).sum(axis=1)
    return Frames(along, spacing, 1 / length, near, lane(steps(features.xy, along, near), spacing, side))


def around(field: Field, xy: FloatArray) -> tuple[IntArray, FloatArray]:
    """For each tree the nearest places of the field (n, k) and their weights; only those of the nearest one's block."""
    count = min(4, len(field.block))
    distance, places = cKDTree(field.centre).query(xy, k=list(range(1, count + 1)))
    at = np.asarray(places, dtype=np.int64)
    weight = (field.block[at] == field.block[at[:, :1]]) / (distance**2 + (STEP / 2 * field.side) ** 2)
    return at, weight / weight.sum(axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Steps:
    """From each tree `i` (p,) to a neighbour: metres along (never negative) and across (left positive) the rows."""

    i: IntArray
    along: FloatArray
    across: FloatArray


def steps(xy: FloatArray, along: FloatArray, near: IntArray) -> Iterator[Steps]:
    """All steps to neighbours, those of some trees at a time: of all at once they would fill gigabytes."""
    for begin in range(0, len(xy), AT_A_TIME):
        some = near[begin : begin + AT_A_TIME]
        i = np.repeat(np.arange(begin, begin + len(some)), some.shape[1])
        forward, across = between(xy, along, i, some.ravel())
        yield Steps(i, np.abs(forward), across * np.where(forward < 0, -1, 1))


def between(xy: FloatArray, along: FloatArray, i: IntArray, j: IntArray) -> tuple[FloatArray, FloatArray]:
    """From trees `i` to trees `j`: metres along the rows, as i's frame looks, and across them, left positive.

    Measured in the mean of the two frames, so that along a bend, which is a circle, nothing is across.
    """
    (xi, yi), (xj, yj) = along[i].T, along[j].T
    sense = np.where(xi * xj + yi * yj < 0, -1, 1)
    x, y = xi + xj * sense, yi + yj * sense
    length = np.sqrt(x * x + y * y)
    x, y = x / length, y / length
    dx, dy = (xy[j] - xy[i]).T
    return (dx * x + dy * y).T, (dy * x - dx * y).T


def comb_fit(
    stepping: Iterable[Steps], home: tuple[Field, IntArray], row_spacing: FloatArray, side: float
) -> FloatArray:
    """How well the steps along rows fit combs of `SPACINGS` at each place of the field; `home` has each tree's (n,)."""
    field, place = home
    frequencies = SPACINGS / side
    fit = np.zeros((len(field.block), len(frequencies)))
    for step in stepping:
        strip = STRIP * row_spacing[step.i]
        kept = (np.abs(step.across) < 2.5 * strip) & (step.along > 0.15 * side)
        weight = np.exp(-0.5 * (step.across[kept] / strip[kept]) ** 2)
        add_comb(place[step.i[kept]], step.along[kept], weight, frequencies, fit)
    return fit


def spacings(field: Field, side: float, fit: FloatArray) -> FloatArray:
    """The in-row spacing at each place of the field, metres: the longest comb that the steps along rows fit well."""
    frequencies = SPACINGS / side
    near = cKDTree(field.centre).query(field.centre, k=list(range(1, min(9, len(field.block)) + 1)))[1]
    same = field.block[near] == field.block[:, None]
    for _ in range(2):
        fit = (fit[near] * same[..., None]).sum(axis=1)
    before, here, after = fit[:, :-2], fit[:, 1:-1], fit[:, 2:]
    possible = frequencies[1:-1] * WIDEST > np.hypot(*field.wave.T)[:, None]
    top = (here > before) & (here >= after) & possible
    height = np.where(top, here, 0)
    at = np.argmax(height >= FITS * height.max(axis=1, keepdims=True), axis=1)
    rows = np.arange(len(fit))
    before, here, after = before[rows, at], here[rows, at], after[rows, at]
    bend = np.minimum(before - 2 * here + after, -1e-12)
    fine = frequencies[1:-1][at] + (before - after) / (2 * bend) * (frequencies[1] - frequencies[0])
    return np.where(height.max(axis=1) > 0, 1 / fine, side)


def lane(stepping: Iterable[Steps], spacing: FloatArray, side: float) -> float:
    """The distance from a row to the nearest other one, metres: where trees beside a tree are most frequent."""
    bins = np.arange(0, 2.5, 0.05)
    count = np.zeros(len(bins) - 1, dtype=np.int64)
    for step in stepping:
        beside = np.abs(step.across[step.along < 1.6 * spacing[step.i]]) / side
        count += np.histogram(beside, bins)[0]
    smooth = np.convolve(count, [1, 2, 3, 2, 1], mode="same")
    first = int(0.3 / 0.05)
    inner = smooth[first:-1]
    top = (inner >= smooth[first - 1 : -2]) & (inner > smooth[first + 1 :]) & (inner >= 0.5 * inner.max())
    return float((first + np.argmax(top) + 0.5) * 0.05 * side)
