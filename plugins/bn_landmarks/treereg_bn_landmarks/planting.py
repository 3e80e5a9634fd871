"""What one survey says of its own trees: confidence, heat map, size, and place in the planting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from treereg_bn_landmarks.structure import STATES
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, nearest
from treereg_core.transform import FloatArray

# The trees that are around a tree.
AROUND = 8
# Bounds of the classes: ranks of confidence and of the heat map, robust scores of size.
CONFIDENCE = (0.15, 0.35, 0.6, 0.8)
SURROUNDINGS = (0.25, 0.75)
SIZE = (-2.0, -0.8, 1.5)
# A tree stands where another expects it when it is within this share of the in-row step.
EXPECTED = 0.35
# Rounds of averaging over the trees around that make the direction of planting smooth.
DIRECTION_ROUNDS = 4
# Two directions of planting are told apart when neighbours prefer one by so much.
ONE_DIRECTION = 0.1


@dataclass(frozen=True, eq=False)
class Planting:
    """One survey by itself; all arrays have an entry, or a line, for each tree.

    - `mean` (n, n): the matrix that averages over each tree and those around it.
    - `step`: the usual distance of neighbours in a row, metres; `axis`: the direction of planting over the whole
      survey as a unit number, in the survey's own frame.
    - `log_area`: natural logarithm of the crown over the median of those around.
    - `confidence`, `surroundings`, `size`, `place`: the classes, as positions in `STATES`.
    - `looks`: the class of `their` that the tree is in the eyes of the other survey.
    """

    mean: csr_array[np.float64]
    step: float
    axis: complex
    log_area: FloatArray
    confidence: IntArray
    surroundings: IntArray
    size: IntArray
    place: IntArray
    looks: IntArray

    @classmethod
    def of(cls, features: FeatureSet, threads: int = 1) -> Planting:
        """Of a survey of three trees or more; worked out once, whatever the placements.

        Raises `NoRegistration` when trees do not stand apart.
        """
        if cls not in features.derived:
            features.derived[cls] = cls._worked_out(features, threads)
        planting: Planting = features.derived[cls]
        return planting

    @classmethod
    def _worked_out(cls, features: FeatureSet, threads: int) -> Planting:
        xy = features.xy - features.xy.mean(axis=0)
        distance, near = nearest_of(features, features.xy, features, count=min(AROUND + 1, len(xy)), threads=threads)
        distance, around = distance[:, 1:], near[:, 1:]
        spacing = float(np.median(distance[:, 0]))
        if spacing == 0:
            raise NoRegistration("the trees of a survey do not stand apart, so landmarks cannot be told")
        begin = np.arange(0, near.size + 1, near.shape[1])
        mean = csr_array((np.full(near.size, 1 / near.shape[1]), near.ravel(), begin), shape=(len(xy), len(xy)))
        step, direction, axis = _direction(xy, around, distance, spacing, mean)
        place = _place(features, direction * step, threads)

        rank = ranks(features.confidence)
        confidence = np.searchsorted(CONFIDENCE, rank, side="right")
        surroundings = np.searchsorted(SURROUNDINGS, ranks(rank[around].mean(axis=1)), side="right")
        log_area = np.log(features.area)
        log_area = log_area - np.median(log_area[around], axis=1)
        size = np.searchsorted(SIZE, robust_scores(log_area), side="right")
        looks = _looks(confidence, place)
        return cls(mean, step, axis, log_area, confidence, surroundings, size, place, looks)

    def averaged(self, values: FloatArray, rounds: int) -> FloatArray:
        """Values (n, m) averaged over each tree and those around it, so many times over."""
        for _ in range(rounds):
            values = np.asarray(self.mean @ values)
        return values


def nearest_of(
    asked: FeatureSet, points: FloatArray, asking: FeatureSet, within: float = np.inf, count: int = 1, threads: int = 1
) -> tuple[FloatArray, IntArray]:
    """As the core's `nearest`, over the trees `asked`, for one point (n, 2) for each tree `asking`.

    These ask in the order of space, which is much faster.
    """
    order = asking.tree.indices
    distance, index = nearest(asked.tree, points[order], within, count, threads)
    back = np.argsort(order)
    return distance[back], index[back]


def ranks(values: FloatArray) -> FloatArray:
    """Ranks in 0 to 1 with equal values in the middle of theirs; rounding makes no difference of equal values."""
    _, inverse, counts = np.unique(np.round(values, 9), return_inverse=True, return_counts=True)
    return np.asarray(((np.cumsum(counts) - counts / 2) / len(values))[inverse])


def robust_scores(values: FloatArray) -> FloatArray:
    """Distances from the median in robust standard deviations; those of logarithms of crowns are 0.05 at least."""
    centred = values - np.median(values)
    return np.asarray(centred / max(1.4826 * float(np.median(np.abs(centred))), 0.05))


def _direction(
    xy: FloatArray, around: IntArray, distance: FloatArray, spacing: float, mean: csr_array[np.float64]
) -> tuple[float, FloatArray, complex]:
    """The in-row step in metres, the direction of the planting at each tree (n, 2), and over the whole survey."""
    offset = xy[around] - xy[:, None]
    towards = (offset[..., 0] + 1j * offset[..., 1]) / np.where(distance > 0, distance, 1)
    weight = np.exp(-((distance / (1.3 * spacing)) ** 2)) * (distance > 0.4 * spacing)
    squared = towards * towards
    second, fourth = (weight * squared).sum(axis=1), (weight * squared * squared).sum(axis=1)
    # Where rows are no denser than the trees in them are far apart, both directions of the planting are as good.
    one = abs(second.sum()) > ONE_DIRECTION * weight.sum()
    smooth = second if one else fourth
    for _ in range(DIRECTION_ROUNDS):
        smooth = mean @ smooth
    whole = np.exp(1j * np.angle(second.sum() if one else fourth.sum()) / (2 if one else 4))
    direction = np.exp(1j * np.angle(smooth) / (2 if one else 4))
    turned = towards * distance * direction.conj()[:, None]
    along, across = np.abs(turned.real), np.abs(turned.imag)
    step = 1.15 * spacing
    for _ in range(3):
        in_row = (across < 0.35 * step) & (np.abs(along - step) < 0.35 * step)
        step = float(np.median(along[in_row])) if in_row.any() else step
    return step, np.column_stack([direction.real, direction.imag]), complex(whole)


def _place(features: FeatureSet, step: FloatArray, threads: int) -> IntArray:
    """How each tree stands to those one and two steps (n, 2) away on both sides, as a class of `place`."""
    within = EXPECTED * float(np.hypot(*step[0]))

    def found(steps: int) -> IntArray:
        distance, _ = nearest_of(features, features.xy + steps * step, features, within, threads=threads)
        return np.isfinite(distance).astype(np.int64)

    before, after = found(-1) + found(-2), found(1) + found(2)
    together = before + after
    names = STATES["place"]
    place = np.full(len(features), names.index("off"))
    place[together == 1] = names.index("loose")
    place[together >= 2] = names.index("end")
    place[(together >= 2) & (before > 0) & (after > 0)] = names.index("broken")
    place[together >= 3] = names.index("inside")
    return place


def _looks(confidence: IntArray, place: IntArray) -> IntArray:
    """The class of `their`: good with both confidence and place, doubtful with neither."""
    points = confidence + np.array([0, 1, 2, 3, 4])[place]
    names = STATES["their"]
    return np.where(
        points >= 6, names.index("good"), np.where(points >= 4, names.index("fair"), names.index("doubtful"))
    )
