"""History: what every survey of a series shows of every tree, and the state that the tree is in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from scipy.special import expit

from treereg_core.features import BoolArray, FeatureSet, IntArray, frozen_array, nearest
from treereg_core.series.laid import Laid
from treereg_core.series.linking import GATE, link
from treereg_core.transform import Affine, FloatArray

TURNOVER = 0.02
"""Share of an orchard's trees that die, or are planted, from one survey to the next: what is assumed beforehand."""
PROBABLE = 0.5
"""What is less probable to be a tree than this is taken for false detections."""
AROUND = 2.0
"""A survey may have viewed the ground as far as so many spacings from its outermost trees."""
REFINED = 8
"""So many rounds of expectation maximisation."""
SHRUNK, SHRUNK_SIGMAS = 0.7, 4.0
"""A tree was planted anew when the logarithm of its crown falls by this, and by so many standard deviations."""


class State(IntEnum):
    """What a survey shows of a tree.

    `present`; `missing`: the survey covers the place and shows no tree; `new`: the first survey that shows it, though
    an earlier one covered the place; `replanted`: a much smaller crown than before, which stays so; `unseen`: the
    survey does not cover the place, so nothing is said.
    """

    PRESENT = 0
    MISSING = 1
    NEW = 2
    REPLANTED = 3
    UNSEEN = 4

    @property
    def word(self) -> str:
        """As it is written in files."""
        return self.name.lower()


@dataclass(frozen=True, eq=False)
class History:
    """Trees (t) over the surveys of a series (s) that were laid on each other, in the order of time.

    - `detection` (t, s): the position of the tree in each survey's arrays, -1 where the survey does not show it.
    - `covered` (t, s): whether the survey covers the tree's place.
    - `xy` (t, s, 2): where the survey shows it, in the frame of the first survey, metres; the mean of the others' where
      it does not.
    - `spacing`: the distance between trees, metres.
    """

    surveys: tuple[Laid, ...]
    spacing: float
    detection: IntArray
    covered: BoolArray
    xy: FloatArray

    def __post_init__(self) -> None:
        for name, kind in (("detection", np.int64), ("covered", np.bool_), ("xy", np.float64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), kind))

    @classmethod
    def of(cls, surveys: Sequence[tuple[FeatureSet, Affine]]) -> History:
        """The history that surveys tell together: their trees, and the transforms that take them to the first one."""
        spacing = float(np.median([features.spacing * transform.scale for features, transform in surveys])) or 1.0
        laid, numbers = link([Laid.of(*survey, spacing) for survey in surveys], spacing)
        detection = np.full((max(int(number.max()) for number in numbers) + 1, len(laid)), -1, dtype=np.int64)
        for s, number in enumerate(numbers):
            detection[number, s] = np.arange(len(number))
        seen = detection >= 0
        shown = gathered([survey.xy for survey in laid], detection)
        mean = np.nanmean(shown, axis=1)
        covered = seen | np.column_stack([survey.ground.covers(mean) for survey in laid])
        xy = np.where(seen[..., None], shown, mean[:, None])
        return cls(tuple(laid), spacing, detection, covered, xy)

    @cached_property
    def probability(self) -> FloatArray:
        """The probability (t,) that detections show a tree, and are not false ones alone."""
        return frozen_array(_probability(self))

    @property
    def probable(self) -> BoolArray:
        """Which trees (t,) are trees rather than false detections."""
        return np.asarray(self.probability >= PROBABLE)

    @property
    def seen(self) -> BoolArray:
        """Which surveys show which trees, (t, s)."""
        return np.asarray(self.detection >= 0)

    @cached_property
    def state(self) -> IntArray:
        """The `State` (t, s) of every tree at every survey."""
        state = np.where(self.covered, State.MISSING, State.UNSEEN)
        state[self.seen] = State.PRESENT
        first = np.argmax(self.seen, axis=1)
        covered_before = np.cumsum(self.covered, axis=1)[np.arange(len(first)), first] > 1
        state[np.flatnonzero(covered_before), first[covered_before]] = State.NEW
        state[self._replanted] = State.REPLANTED
        return frozen_array(state, np.int64)

    @cached_property
    def _replanted(self) -> BoolArray:
        """Where (t, s) a crown is much smaller than before, and still is in the next survey that shows it, if any."""
        log_area = gathered([survey.log_area for survey in self.surveys], self.detection)
        change = np.diff(log_area, axis=1)
        change = change[np.isfinite(change)]
        spread = 1.4826 * float(np.median(np.abs(change - np.median(change)))) if len(change) else 0.0
        fall = max(SHRUNK, SHRUNK_SIGMAS * spread)
        replanted = np.zeros_like(self.seen)
        # the mean crown since the tree was planted, over the surveys before
        total, count = np.zeros((2, len(log_area)))
        for s, now in enumerate(log_area.T):
            limit = total / np.maximum(count, 1) - fall
            small = (count > 0) & (now < limit)
            later = _next_seen(log_area, s)
            anew = small & ~(later > limit + fall / 2)
            replanted[:, s] = anew
            # a crown that is small for once, such as half of one, says nothing about the tree's size
            usual = self.seen[:, s] & (anew | ~small)
            total = np.where(anew, 0, total) + np.where(usual, now, 0)
            count = np.where(anew, 0, count) + usual
        return replanted


def gathered(values: Sequence[FloatArray], detection: IntArray) -> FloatArray:
    """The values (t, s, ...) of each tree from the arrays (n, ...) of each survey; NaN where `detection` is -1."""
    columns = []
    for survey, at in zip(values, detection.T, strict=True):
        column = survey[np.maximum(at, 0)].copy()
        column[at < 0] = np.nan
        columns.append(column)
    return np.stack(columns, axis=1)


def _next_seen(values: FloatArray, s: int) -> FloatArray:
    """The value (t,) in the next survey after this one that has one, NaN without."""
    found = np.full(len(values), np.nan)
    for later in range(values.shape[1] - 1, s, -1):
        found = np.where(np.isfinite(values[:, later]), values[:, later], found)
    return found


def _probability(history: History) -> FloatArray:
    """The probability (t,) that detections show a tree, by when it was seen and missed and how sure the detector was.

    Against a tree stand strangers, of which several would have to lie together by chance. How often trees are found,
    and how dense strangers are, follows from the probabilities (expectation maximisation). One survey alone is
    believed.
    """
    surveys, seen = history.surveys, history.seen
    times = seen.sum(axis=1)
    if len(surveys) == 1:
        return np.ones(len(seen))
    viewed = _viewed(history)
    chance_m2 = np.pi * (GATE * history.spacing) ** 2
    ground_m2 = max(survey.ground_m2 for survey in surveys)
    probability = (times > 1).astype(np.float64)
    for _ in range(REFINED):
        log_odds = np.log(probability.sum() + 1) - np.log(ground_m2) - (times - 1) * np.log(chance_m2)
        missing = np.ones(seen.shape)
        for s, survey in enumerate(surveys):
            shown = seen[:, s]
            known = probability * (history.covered[:, s] & (times > shown))
            found = (known[shown].sum() + 1) / (known.sum() + 2)
            missing[~shown, s] = 1 - found * viewed[~shown, s]
            tree = np.zeros(len(survey.xy))
            tree[history.detection[shown, s]] = probability[shown]
            log_odds[shown] += np.log(found) - survey.log_strangers(tree)[history.detection[shown, s]]
        probability = expit(log_odds + np.log(_stood(missing, seen)))
    return np.asarray(probability)


def _viewed(history: History) -> FloatArray:
    """How likely each survey viewed the place of each tree (t, s): what it covers, and around that as likely as not."""
    place = np.nanmean(gathered([survey.xy for survey in history.surveys], history.detection), axis=1)
    viewed = history.covered.astype(np.float64)
    for s, survey in enumerate(history.surveys):
        distance, _ = nearest(survey.tree, place, AROUND * history.spacing)
        viewed[np.isfinite(distance) & (viewed[:, s] == 0), s] = 0.5
    return viewed


def _stood(missing: FloatArray, seen: BoolArray) -> FloatArray:
    """How probable it is (t,) that a tree which stood from the first to the last sighting was not seen besides.

    It may have been planted late, or have died early; `missing` (t, s) is how probable it was missed if it stood.
    """
    surveys = seen.shape[1]
    first, last = np.argmax(seen, axis=1), surveys - 1 - np.argmax(seen[:, ::-1], axis=1)
    before, after = np.ones(missing.shape), np.ones(missing.shape)
    for s in range(1, surveys):
        before[:, s] = before[:, s - 1] * missing[:, s - 1] + TURNOVER
        after[:, -1 - s] = after[:, -s] * missing[:, -s] + TURNOVER
    at = np.arange(len(seen))
    inside = (np.arange(surveys) > first[:, None]) & (np.arange(surveys) < last[:, None])
    return np.asarray(before[at, first] * after[at, last] * np.where(inside, missing, 1).prod(axis=1))
