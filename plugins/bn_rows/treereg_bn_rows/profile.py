"""Profiles: the rows of two surveys in one frame, in their order across the field, and which lie beside each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.numbering import common_direction, numbered
from treereg_core.pair import Rows
from treereg_core.row_lines import RowLines, trees_of
from treereg_core.transform import Affine, FloatArray, Rigid

LENGTHWISE = 0.5
"""A row is of the common direction when the cosine of its angle to it is at least this, as in `numbered`."""
STATIONS = np.array([1, 3, 5]) / 6
"""Where along the stretch that two rows share their distance is taken."""
MEET = 0.4
"""Trees of two rows meet when they are nearer along than this share of the in-row spacing."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The lengthwise rows of one survey: `u` along the common direction, `v` across it, metres.

    - `rows` (r,): which of the survey's rows each is; they stand in their order across the field.
    - `u`, `line_u`, `line_v` (n,), `row` (n,): the trees row after row, each row from its begin to its end; where they
      stand along, and where their row runs beside them.
    """

    rows: IntArray
    u: FloatArray
    line_u: FloatArray
    line_v: FloatArray
    row: IntArray

    @classmethod
    def of(cls, rows: Rows, features: FeatureSet, lines: RowLines, to_frame: Affine) -> Profile:
        """The rows that have `lines`, as they lie in the frame; raises `NoRegistration` where none is lengthwise."""
        smooth, xy = to_frame(lines.smooth), to_frame(features.xy)
        bounds = np.flatnonzero(np.diff(lines.row, prepend=-1, append=-1))
        chord = np.abs(smooth[bounds[1:] - 1] - smooth[bounds[:-1]])
        which = lines.row[bounds[:-1]]
        lengthwise = which[chord[:, 0] >= LENGTHWISE * np.hypot(*chord.T)]
        if not len(lengthwise):
            raise NoRegistration("the rows of the two surveys cross each other, so none can be matched")
        chosen = Rows(tuple(rows.trees[k] for k in lengthwise)).keep(features.ids)
        first = {int(row.min()): int(k) for row, k in zip(chosen.trees, lengthwise, strict=True)}
        order = [first[int(row.min())] for row in numbered(chosen, features.replace(xy=xy)).trees]
        rank = np.full(len(rows), -1)
        rank[order] = np.arange(len(order))
        row = rank[lines.row]
        along = np.lexsort((smooth[:, 0], row))
        along = along[row[along] >= 0]
        u, v = smooth[along].T
        return cls(np.array(order), xy[lines.trees[along], 0], u, v, row[along])

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def start(self) -> IntArray:
        """Where each row's trees begin, and where the last one's end (r + 1,)."""
        return np.searchsorted(self.row, np.arange(len(self) + 1))

    @cached_property
    def trees(self) -> IntArray:
        """How many trees each row has (r,)."""
        return np.diff(self.start)

    @cached_property
    def first(self) -> FloatArray:
        """Where along each row begins (r,), metres."""
        return self.line_u[self.start[:-1]]

    @cached_property
    def last(self) -> FloatArray:
        """Where along each row ends (r,), metres."""
        return self.line_u[self.start[1:] - 1]

    def key(self, row: IntArray, place: FloatArray) -> FloatArray:
        """Places along rows (k,), metres, on one axis, row after row, far enough apart for places beyond their ends."""
        apart = float(np.ptp(self.u)) + 1.0
        return np.asarray(row * 3 * apart + place - self.u.min())

    @cached_property
    def keys(self) -> FloatArray:
        """The keys of all trees (n,), ascending."""
        return np.sort(self.key(self.row, self.u))

    def across(self, row: IntArray, place: FloatArray) -> FloatArray:
        """Where across rows run (k, ...) at these places along (k, ...), metres; beyond a row's end as at its end."""
        apart = float(np.ptp(self.line_u)) + 1.0
        low = self.line_u.min()
        place = np.clip(place.T, self.first[row], self.last[row])
        v = np.interp(row * apart + place - low, self.row * apart + self.line_u - low, self.line_v)
        return np.asarray(v.T)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Pairs of rows (k) that run beside each other within reach, as the source lies at first.

    `i`, `j` count rows in the two profiles. Metres: `across` (k,) how far the reference's row lies farther across,
    `askew` (k,) by how much more so at the end of their common stretch than at its begin, `begin`, `end` (k,) how much
    farther along the reference's row begins and ends, `shared` (k,) how long the stretch is.
    """

    reference: Profile
    source: Profile
    i: IntArray
    j: IntArray
    across: FloatArray
    askew: FloatArray
    shared: FloatArray
    begin: FloatArray
    end: FloatArray

    @classmethod
    def of(cls, reference: Profile, source: Profile, reach: float) -> Candidates:
        """All pairs of rows that lie within `reach` metres across, on a stretch that both have, row after row."""
        i, j = _near(reference, source, reach)
        low, high = np.maximum(reference.first[i], source.first[j]), np.minimum(reference.last[i], source.last[j])
        both = high > low
        i, j, low, high = i[both], j[both], low[both], high[both]
        places = low[:, None] + (high - low)[:, None] * STATIONS
        across = reference.across(i, places) - source.across(j, places)
        middle = across.mean(axis=1)
        found = cls(
            reference,
            source,
            i,
            j,
            middle,
            (across[:, -1] - across[:, 0]) / (STATIONS[-1] - STATIONS[0]),
            high - low,
            reference.first[i] - source.first[j],
            reference.last[i] - source.last[j],
        )
        return found.take(np.abs(middle) < reach)

    def take(self, index: IntArray | BoolArray) -> Candidates:
        """Those at these positions."""
        names = ("i", "j", "across", "askew", "shared", "begin", "end")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def shifted(self, along: float, across: float, within: float) -> Candidates:
        """As they are when the source lies so much farther along and across, metres; those within `within` across."""
        moved = replace(self, across=self.across - across, begin=self.begin - along, end=self.end - along)
        return moved.take(np.abs(moved.across) < within)

    def meeting(self, along: float, spacing: float) -> tuple[IntArray, IntArray]:
        """For each pair (k,) the trees of both rows on the stretch that both have, and how many meet none there.

        The source lies `along` metres farther than at first, which `begin` and `end` already count.
        """
        seen = np.zeros(len(self.i), dtype=np.int64)
        alone = np.zeros(len(self.i), dtype=np.int64)
        for mine, my, other, its, step in (
            (self.reference, self.i, self.source, self.j, -along),
            (self.source, self.j, self.reference, self.i, along),
        ):
            count = mine.trees[my]
            pair = np.repeat(np.arange(len(my)), count)
            tree = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count) + mine.start[my][pair]
            place = mine.u[tree] + step
            within = (place > other.first[its][pair] - spacing / 2) & (place < other.last[its][pair] + spacing / 2)
            pair, place = pair[within], place[within]
            away = _to_nearest(other, its[pair], place)
            seen += np.bincount(pair, minlength=len(my))
            alone += np.bincount(pair[away > MEET * spacing], minlength=len(my))
        return seen, alone


def _near(reference: Profile, source: Profile, reach: float) -> tuple[IntArray, IntArray]:
    """The pairs of rows whose boxes are within `reach` metres across and meet along, row after row.

    A tree of boxes finds them: a table of all rows by all rows would not fit where an estate has many short ones.
    """
    import shapely

    boxes = []
    for profile in (reference, source):
        low, high = (bound.reduceat(profile.line_v, profile.start[:-1]) for bound in (np.minimum, np.maximum))
        boxes.append(shapely.box(profile.first, low - reach / 2, profile.last, high + reach / 2))
    i, j = shapely.STRtree(boxes[1]).query(boxes[0])
    order = np.lexsort((j, i))
    return i[order], j[order]


def _to_nearest(profile: Profile, row: IntArray, place: FloatArray) -> FloatArray:
    """How far along the nearest tree of a row is from each place (k,), metres."""
    keys = profile.keys
    wanted = profile.key(row, place)
    at = np.searchsorted(keys, wanted)
    after = keys[np.minimum(at, len(keys) - 1)]
    before = keys[np.maximum(at - 1, 0)]
    return np.asarray(np.minimum(np.abs(after - wanted), np.abs(wanted - before)))


def frame_of(rows: Rows, features: FeatureSet) -> Rigid:
    """Takes a survey to a frame about its middle whose first axis is the common direction of its rows."""
    trees, row = trees_of(rows, features)
    pieces = np.split(trees, np.flatnonzero(np.diff(row)) + 1)
    x, y = common_direction([features.ids[piece] for piece in pieces], features)
    turn = np.array([[x, y], [-y, x]])
    return Rigid(turn, -turn @ features.xy[trees].mean(axis=0))
