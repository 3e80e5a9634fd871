"""Linking: which detections of several surveys, laid on each other, show the same tree.

Each survey's detections are assigned one to one to the trees known so far, and once all surveys are in, again to what
the other surveys together say, until nothing changes. A detection shows a known tree when that is likelier than that
the tree was missed and the detection is a stranger: a false one, or a tree that nobody saw before. That follows from
how far it stands from where the others have the tree, how large its crown is and how sure the detector was (the
likelihood ratio of data association in tracking; Bar-Shalom, Daum & Huang 2009, doi:10.1109/MCS.2009.934469).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.features import BoolArray, IntArray, nearest
from treereg_core.series.laid import CLASSES, Laid
from treereg_core.transform import FloatArray

GATE = 0.45
"""Farther from a tree than this share of the spacing nothing is that tree."""
RIVALS = 3
"""So many trees are looked at for each detection."""
STRAY, STRAY_FACTOR = 0.1, 3.0
"""This share of a tree's detections stray so much farther than the others: crowns that were outlined differently."""
LEAST_SIGMA = 0.02
"""Metres; no detector places a tree better."""
LEAST_SPREAD = 0.05
"""Of the natural logarithm of two crowns of one tree; no detector measures a crown better."""
LEAST_LIKE, MOST_LIKE = -2.5, 2.0
"""The least and the most that the sizes of two crowns say, log-likelihood: a tree that replaces a dead one is small."""
SURE = 1.5
"""The least log-odds of a link: a wrong link harms more than one that is left out."""
FEWEST = 8
"""Fewer links say nothing about a survey, nor about how far it is off at a place, as a bent map is."""
OFTEN = 3
"""Trees that so many surveys or more show are found equally often."""
KINDS = CLASSES + OFTEN - 1
"""How often trees are found depends on how often they were seen; of those seen once, on how sure the detector was."""
ROUNDS, PASSES = 4, 3
"""So many rounds over all surveys at most, and so many passes over one: links tell offsets, and these tell links."""


def link(given: Sequence[Laid], spacing: float) -> tuple[list[Laid], list[IntArray]]:
    """The surveys with all crowns as large as the first one's, and the number of the tree that each detection shows.

    One array of numbers (n,) for each survey; a survey shows each tree once at most. `spacing` is the distance between
    trees in metres. Trees are numbered from 0 in the order of the surveys that first show them, and within a survey in
    its own order.
    """
    surveys: list[Laid] = []
    numbers: list[IntArray] = []
    for survey in given:
        known = _Known.of(surveys, numbers)
        numbers.append(_numbered(survey, known, spacing))
        surveys.append(survey.sized(_growth(survey, known, numbers[-1])))
    for _ in range(ROUNDS):
        before = list(numbers)
        for k, survey in enumerate(surveys):
            known = _Known.of([*surveys[:k], *surveys[k + 1 :]], [*numbers[:k], *numbers[k + 1 :]])
            numbers[k] = _numbered(survey, known, spacing)
        numbers = _from_zero(numbers)
        if all(np.array_equal(old, new) for old, new in zip(before, numbers, strict=True)):
            break
    return surveys, numbers


@dataclass(frozen=True, eq=False)
class _Known:
    """Trees as some surveys show them.

    - `number` (t,): of the tree; `seen` (t,): how many of the surveys show it; `xy` (t, 2), `log_area` (t,): means.
    - `kind` (t,): which are found equally often: the class of confidence of those seen once, then by `seen`.
    - `free`: the next number that no tree has.
    """

    number: IntArray
    seen: IntArray
    xy: FloatArray
    log_area: FloatArray
    kind: IntArray
    free: int

    @classmethod
    def of(cls, surveys: Sequence[Laid], numbers: Sequence[IntArray]) -> _Known:
        if not surveys:
            none = np.zeros(0, dtype=np.int64)
            return cls(none, none, np.zeros((0, 2)), np.zeros(0), none, 0)
        every = np.concatenate(numbers)
        number, at, seen = np.unique(every, return_inverse=True, return_counts=True)
        xy = np.concatenate([survey.xy for survey in surveys])
        log_area = np.concatenate([survey.log_area for survey in surveys])
        mean = [np.bincount(at, values) / seen for values in (*xy.T, log_area)]
        kind = CLASSES - 2 + np.minimum(seen, OFTEN)
        once = seen[at] == 1
        kind[at[once]] = np.concatenate([survey.classes[0] for survey in surveys])[once]
        return cls(number, seen, np.column_stack(mean[:2]), mean[2], kind, int(every.max()) + 1)

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.xy)


def _numbered(survey: Laid, known: _Known, spacing: float) -> IntArray:
    """The number of each detection's tree: of one that is known, else the next that are free."""
    tree = _assigned(survey, known, GATE * spacing)
    number = known.free + np.cumsum(tree < 0) - 1
    number[tree >= 0] = known.number[tree[tree >= 0]]
    return np.asarray(number, dtype=np.int64)


def _growth(survey: Laid, known: _Known, number: IntArray) -> float:
    """By how much crowns grew, logarithm: of the same trees, since the medians of surveys may be of other ones."""
    _, tree, detection = np.intersect1d(known.number, number, return_indices=True)
    if len(tree) < FEWEST:
        return 0.0
    return float(np.median(survey.log_area[detection] - known.log_area[tree]))


def _assigned(survey: Laid, known: _Known, gate: float) -> IntArray:
    """For each detection the position of the known tree that it shows, -1 for a stranger."""
    assigned = np.full(len(survey.xy), -1, dtype=np.int64)
    if not len(known.xy):
        return assigned
    offset = np.zeros_like(survey.xy)
    for _ in range(PASSES):
        pairs = _Pairs.near(survey, known, offset, gate)
        log_odds = _log_odds(pairs, assigned, offset)
        assigned = _one_to_one(pairs, log_odds)
        offset = _common_offset(survey, known, assigned)
    return assigned


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Detections and the known trees near them, (k,) positions each, and the square of the distance, metres."""

    survey: Laid
    known: _Known
    detection: IntArray
    tree: IntArray
    square: FloatArray

    @classmethod
    def near(cls, survey: Laid, known: _Known, offset: FloatArray, gate: float) -> _Pairs:
        count = min(RIVALS, len(known.xy))
        distance, tree = nearest(known.tree, survey.xy + offset, gate, count)
        distance, tree = distance.reshape(-1, count), tree.reshape(-1, count)
        detection, column = np.nonzero(np.isfinite(distance))
        return cls(survey, known, detection, tree[detection, column], distance[detection, column] ** 2)


def _log_odds(pairs: _Pairs, assigned: IntArray, offset: FloatArray) -> FloatArray:
    """Log-odds (k,) that the detection shows the tree, against a tree that was missed and a stranger.

    `assigned` (n,) are the links of the pass before, which tell how far places and crowns of one tree spread, how often
    trees are found, and how many strangers look like each detection. While there are hardly any, the nearest pairs are
    taken.
    """
    survey, known = pairs.survey, pairs.known
    linked = np.flatnonzero(assigned >= 0)
    if len(linked) < FEWEST:
        return SURE + 1 / (1 + pairs.square)
    at = assigned[linked]
    square = ((survey.xy[linked] + offset[linked] - known.xy[at]) ** 2).sum(axis=1)
    # the median square of two normal residuals is 1.386 variances
    one = max(float(np.median(square / (1 + 1 / known.seen[at]))) / 1.386, LEAST_SIGMA**2)
    variance = one * (1 + 1 / known.seen[pairs.tree])
    place = np.logaddexp(
        _log_density(pairs.square, variance) + np.log(1 - STRAY),
        _log_density(pairs.square, STRAY_FACTOR**2 * variance) + np.log(STRAY),
    )

    found = np.bincount(at, minlength=len(known.xy)) > 0
    covered = survey.ground.covers(known.xy)
    shown, missed = (np.bincount(known.kind[covered & which], minlength=KINDS) + 1 for which in (found, ~found))
    expected = np.log(shown / missed)[known.kind[pairs.tree]]

    strange = survey.log_strangers((assigned >= 0).astype(np.float64))[pairs.detection]
    return np.asarray(expected + place + _likeness(pairs, assigned) - strange)


def _log_density(square: FloatArray, variance: FloatArray) -> FloatArray:
    """Of a normal distribution in the plane, at these squares of the distance (k,)."""
    return np.asarray(-square / (2 * variance) - np.log(2 * np.pi * variance))


def _likeness(pairs: _Pairs, assigned: IntArray) -> FloatArray:
    """What the sizes of both crowns say (k,): log-likelihood against crowns of any two trees."""
    survey, known = pairs.survey, pairs.known
    linked = np.flatnonzero(assigned >= 0)
    difference = survey.log_area[linked] - known.log_area[assigned[linked]]
    middle = float(np.median(difference))
    same = max(1.4826 * float(np.median(np.abs(difference - middle))), LEAST_SPREAD)
    other = max(same, float(np.hypot(np.std(survey.log_area), np.std(known.log_area))))
    square = (survey.log_area[pairs.detection] - known.log_area[pairs.tree] - middle) ** 2
    like = np.log(other / same) - square / 2 * (1 / same**2 - 1 / other**2)
    return np.asarray(np.clip(like, LEAST_LIKE, MOST_LIKE))


def _one_to_one(pairs: _Pairs, log_odds: FloatArray) -> IntArray:
    """For each detection the position of its tree, or -1; the likeliest pairs first, each of both once at most."""
    assigned = np.full(len(pairs.survey.xy), -1, dtype=np.int64)
    taken = np.zeros(len(pairs.known.xy), dtype=bool)
    order = np.lexsort((pairs.tree, pairs.detection, -log_odds))
    order = order[log_odds[order] > SURE]
    detection, tree = pairs.detection[order], pairs.tree[order]
    while len(detection):
        best = np.flatnonzero(_first(detection) & _first(tree))
        assigned[detection[best]] = tree[best]
        taken[tree[best]] = True
        left = (assigned[detection] < 0) & ~taken[tree]
        detection, tree = detection[left], tree[left]
    return assigned


def _first(values: IntArray) -> BoolArray:
    """Which values stand for the first time."""
    first = np.zeros(len(values), dtype=bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first


def _common_offset(survey: Laid, known: _Known, assigned: IntArray) -> FloatArray:
    """How far the linked trees around each detection stand from it on average (n, 2) metres; 0 where there are few."""
    linked = assigned >= 0
    residual = np.zeros_like(survey.xy)
    residual[linked] = known.xy[assigned[linked]] - survey.xy[linked]
    count = linked[survey.around].sum(axis=1)
    mean = residual[survey.around].sum(axis=1) / np.maximum(count, 1)[:, None]
    return np.where((count >= FEWEST)[:, None], mean, 0.0)


def _from_zero(numbers: Sequence[IntArray]) -> list[IntArray]:
    """The same trees numbered in the order of the surveys that first show them."""
    _, first, at = np.unique(np.concatenate(numbers), return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.split(rank[at], np.cumsum([len(number) for number in numbers])[:-1])
