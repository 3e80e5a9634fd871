"""The evidence on every tree of both surveys under the present transform, as classes of the network's nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_bn_landmarks.planting import Planting
from treereg_bn_landmarks.structure import EVIDENCE, STATES
from treereg_core.features import BoolArray, FeatureSet, IntArray, nearest
from treereg_core.footprint import Footprint
from treereg_core.pair import Pair, Rows
from treereg_core.transform import FloatArray

# Something stands at a tree when it is within this share of the in-row step.
GATE = 0.35
# A footprint is closed over so many steps.
FOOTPRINT = 2.5
# A partner is close when it is off by so many times what is usual, and always within so many steps.
CLOSE, EXACT = 1.25, 0.02
# Crowns are like each other when their logarithms differ by at most so many robust standard deviations.
LIKE = 1.0
# Bounds of the classes of agreement, and the rounds of averaging of shares and offsets of partners.
AGREEMENT = (0.55, 0.75, 0.9)
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Side:
    """One survey beside the other, in the reference's frame.

    - `xy` (n, 2): where its trees stand; `partner` (n,): the nearest tree of the other survey within the gate, or -1;
      `mutual` (n,): whether that one has no nearer tree itself; `covered` (n,): whether the other survey covers the
      ground.
    """

    features: FeatureSet
    planting: Planting
    xy: FloatArray
    partner: IntArray
    mutual: BoolArray
    covered: BoolArray


def sides(pair: Pair, threads: int = 1) -> tuple[Side, Side]:
    """Reference and source as they lie to each other; each of three trees or more that are not all at one point."""
    plantings = Planting.of(pair.reference, threads), Planting.of(pair.source, threads)
    to_source = pair.reference_from_source.inverse()
    scale = pair.reference_from_source.scale
    within = GATE * (plantings[0].step + scale * plantings[1].step) / 2
    here, there = pair.reference.xy, pair.source_in_reference
    # Both ways are asked in one frame each, so that the kept trees of the surveys serve all placements.
    forth = _partner(pair.source, to_source(here), within / scale, threads)
    back = _partner(pair.reference, there, within, threads)
    covered = (
        footprint(pair.source, plantings[1].step).covers(to_source(here)),
        footprint(pair.reference, plantings[0].step).covers(there),
    )
    return (
        Side(pair.reference, plantings[0], here, forth, _mutual(forth, back), covered[0]),
        Side(pair.source, plantings[1], there, back, _mutual(back, forth), covered[1]),
    )


def footprint(features: FeatureSet, step: float) -> Footprint:
    """The ground that a survey covers, worked out once."""
    key = (Footprint, "bn_landmarks")
    if key not in features.derived:
        features.derived[key] = Footprint.of(features.xy, FOOTPRINT * step)
    ground: Footprint = features.derived[key]
    return ground


def evidence(side: Side, other: Side, rows: Rows | None, earlier: IntArray) -> IntArray:
    """The classes (n, nodes) of one survey's trees, in the order of `EVIDENCE`; `earlier` (n,) comes from memory."""
    planting = side.planting
    partner = _partner_class(side, other)
    their = np.where(side.partner >= 0, other.planting.looks[side.partner], STATES["their"].index("none"))
    unknown = len(STATES["row"])
    in_row = np.full(len(planting.place), unknown)
    if rows is not None and len(rows):
        in_row = np.isin(side.features.ids, np.concatenate([*rows.trees])).astype(np.int64)
    classes = {
        "surroundings": planting.surroundings,
        "agreement": _agreement(side),
        "size": planting.size,
        "confidence": planting.confidence,
        "place": planting.place,
        "row": in_row,
        "earlier": earlier,
        "partner": partner,
        "their": their,
    }
    return np.column_stack([classes[node] for node in EVIDENCE])


def _partner(features: FeatureSet, points: FloatArray, within: float, threads: int) -> IntArray:
    _, index = nearest(features.tree, points, within, threads=threads)
    return np.where(index < len(features), index, -1)


def _mutual(forth: IntArray, back: IntArray) -> BoolArray:
    return np.asarray((forth >= 0) & (back[forth] == np.arange(len(forth))))


def _agreement(side: Side) -> IntArray:
    """The class of the share of covered trees around each that have a partner, pulled a little to the survey's own."""
    both = np.column_stack([side.mutual & side.covered, side.covered]).astype(np.float64)
    overall = both[:, 0].sum() / max(both[:, 1].sum(), 1)
    matched, covered = side.planting.averaged(both, ROUNDS).T
    share = (matched + 0.2 * overall) / (covered + 0.2)
    return np.asarray(np.searchsorted(AGREEMENT, share, side="right"))


def _partner_class(side: Side, other: Side) -> IntArray:
    """What stands at each tree in the other survey."""
    mine = np.flatnonzero(side.mutual)
    names = STATES["partner"]
    partner = np.where(side.covered, names.index("nothing"), names.index("uncovered"))
    partner[side.partner >= 0] = names.index("taken")
    if len(mine):
        step = side.planting.step
        offset = np.zeros((len(side.xy), 3))
        offset[mine, :2] = other.xy[side.partner[mine]] - side.xy[mine]
        offset[mine, 2] = 1
        smooth = side.planting.averaged(offset, ROUNDS)[mine]
        away = np.hypot(*(offset[mine, :2] - smooth[:, :2] / smooth[:, 2:]).T)
        close = away <= max(CLOSE * float(np.median(away)), EXACT * step)
        difference = side.planting.log_area[mine] - other.planting.log_area[side.partner[mine]]
        spread = max(1.4826 * float(np.median(np.abs(difference))), 0.05)
        like = np.abs(difference) <= LIKE * spread
        partner[mine] = names.index("apart_unlike") + 2 * close + like
    return partner
