"""Looks: what the pairs of rows show under each placement that is worth one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_bn_rows.evidence import BESIDE, signs, surprises
from treereg_bn_rows.placing import Ground, Placed, bases, placements
from treereg_bn_rows.profile import Candidates, Profile, frame_of
from treereg_core.course import Course
from treereg_core.evidence import Evidence
from treereg_core.features import IntArray
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.row_lines import RowLines, lines_of
from treereg_core.transform import Affine, Rigid

SAME_LINE, WIDEST = 0.4, 4.0
"""Neighbours are nearer or farther apart than this, in distances to the nearer row, when they are of one line, or when
there is a road between them."""


@dataclass(frozen=True, eq=False)
class Look:
    """The pairs of rows that lie beside each other under one placement, and the states of each pair by itself.

    `apart`, `spacing`: the mean distances of neighbouring rows and of trees along them in the reference, metres.
    """

    placed: Placed
    pairs: Candidates
    states: dict[str, IntArray]
    apart: float
    spacing: float

    @property
    def rows(self) -> IntArray:
        """The pairs (k, 2) as positions in the rows of reference and source."""
        return np.column_stack([self.pairs.reference.rows[self.pairs.i], self.pairs.source.rows[self.pairs.j]])


def looks(pair: Pair, offsets: float, context: Context) -> list[Look]:
    """All looks at a pair, up to so many row distances across from where it lies.

    Raises `NoRegistration` when a survey has no rows, or when they do not meet.
    """
    ground = ground_of(pair, context)
    based = bases(ground, context)
    found = placements(ground, based, offsets, context)
    reach = offsets * ground.apart + ground.reference.distance
    beside = candidates(ground, based, reach)
    shown = []
    for placed in found:
        pairs = beside[placed.sense].shifted(placed.along, placed.across, BESIDE * ground.reference.distance)
        shown.append((placed, pairs, *pairs.meeting(placed.along, ground.reference.spacing)))
    # most placements are wrong, so that the usual one is too
    shares = [alone.sum() / seen.sum() for _, _, seen, alone in shown if seen.sum()]
    usual = float(np.median(shares)) if shares else 0.0
    scale = ground.reference.distance, ground.reference.spacing
    return [
        Look(placed, pairs, signs(pairs, *scale, surprises(seen, alone, usual)), ground.apart, ground.reference.spacing)
        for placed, pairs, seen, alone in shown
    ]


def ground_of(pair: Pair, context: Context) -> Ground:
    """A pair made ready; raises `NoRegistration` when a survey has no rows."""
    rows, reference, source = lines_of(pair)
    evidence = Evidence(pair.reference, pair.source, context.threads)
    frame = frame_of(rows.reference, pair.reference)
    return Ground(pair, reference, source, evidence, frame, _apart(reference, frame))


def _apart(lines: RowLines, frame: Rigid) -> float:
    """The mean distance from row to next row, metres; wider gaps, as roads, left out."""
    course = Course.of(frame(lines.smooth), np.unique(lines.row, return_counts=True)[1])
    if course is None:
        return lines.distance
    near, far = course.opposite
    gap = course.across[far] - course.across[near]
    gap = gap[(gap > SAME_LINE * lines.distance) & (gap < WIDEST * lines.distance)]
    return max(float(gap.mean()), lines.distance) if len(gap) else lines.distance


def candidates(ground: Ground, bases: tuple[Affine, ...], reach: float) -> tuple[Candidates, ...]:
    """The pairs of rows within so many metres across under each placement."""
    rows = ground.pair.rows
    assert rows is not None
    reference = Profile.of(rows.reference, ground.pair.reference, ground.reference, ground.frame)
    sources = (Profile.of(rows.source, ground.pair.source, ground.source, ground.frame @ base) for base in bases)
    return tuple(Candidates.of(reference, source, reach) for source in sources)
