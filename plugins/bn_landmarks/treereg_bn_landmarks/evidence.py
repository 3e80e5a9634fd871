"""The evidence on every tree of both surveys under the present transform, as classes of the network's nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_bn_landmarks.planting import Planting, nearest_of
from treereg_bn_landmarks.structure import EVIDENCE, STATES
from treereg_core.errors import NoRegistration
from treereg_core.features import BoolArray, FeatureSet, IntArray, nearest
from treereg_core.footprint import Footprint
from treereg_core.pair import Pair, Rows
from treereg_core.transform import FloatArray, Model

# Something stands at a tree when it is within this share of the in-row step, and beside it when it is within that.
GATE, BESIDE = 0.35, 0.6
# Nothing farther away than so many steps is looked at.
REACH = 1.0
# So many trees, and so many partners of theirs, tell how all are off together, in so many rounds at most.
ASKED, ENOUGH, SETTLING = 3000, 30, 15
# Fewer trees are no planting.
LEAST = 3
# A footprint is closed over so many steps.
FOOTPRINT = 2.5
# A partner is close when it is off by so many times what is usual, and always within so many steps.
CLOSE, EXACT = 1.25, 0.02
# Crowns are like each other when their logarithms differ by at most so many robust standard deviations.
LIKE = 1.0
# Bounds of the classes of agreement, and the rounds of averaging of shares and offsets of partners.
AGREEMENT = (0.4, 0.6, 0.75, 0.9)
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Side:
    """One survey beside the other, in the reference's frame.

    - `xy` (n, 2): where its trees stand; `near` (n,): the nearest tree of the other survey within reach, or -1, and
      `away` (n,): how far it is, metres; `partner` (n,): the same within the gate, or -1; `mutual` (n,): whether that
      one has no nearer tree itself; `covered` (n,): whether the other survey covers the ground.
    """

    features: FeatureSet
    planting: Planting
    xy: FloatArray
    near: IntArray
    away: FloatArray
    partner: IntArray
    mutual: BoolArray
    covered: BoolArray


def sides(pair: Pair, threads: int = 1) -> tuple[Side, Side]:
    """Reference and source as they lie to each other, less what partners have in common: a motion, then an offset.

    A start that is off by a part of the spacing moves all trees, and a bend of the map all trees around, alike; neither
    says anything on any single one. Raises `NoRegistration` for fewer than three trees in a survey, or trees that do
    not stand apart.
    """
    if min(len(pair.reference), len(pair.source)) < LEAST:
        raise NoRegistration(f"a survey has fewer than {LEAST} trees, so landmarks cannot be told")
    plantings = Planting.of(pair.reference, threads), Planting.of(pair.source, threads)
    step = (plantings[0].step + pair.reference_from_source.scale * plantings[1].step) / 2
    pair = _settled(pair, GATE * step)
    points = pair.reference.xy, pair.source_in_reference
    forth, back = (near for near, _ in _nearest(pair, points, GATE * step, threads))
    shifted = (
        points[0] + _common_offset(plantings[0], points, forth, _mutual(forth, back)),
        points[1] + _common_offset(plantings[1], points[::-1], back, _mutual(back, forth)),
    )
    both = _nearest(pair, shifted, REACH * step, threads)
    forth, back = (np.where(away <= GATE * step, near, -1) for near, away in both)
    # Both grounds are laid out in one frame, so that the source's own frame makes no difference.
    grounds = footprint(points[0], plantings[0].step), footprint(points[1], plantings[1].step)
    covered = grounds[1].covers(shifted[0]), grounds[0].covers(shifted[1])
    return (
        Side(pair.reference, plantings[0], points[0], *both[0], forth, _mutual(forth, back), covered[0]),
        Side(pair.source, plantings[1], points[1], *both[1], back, _mutual(back, forth), covered[1]),
    )


def _settled(pair: Pair, within: float) -> Pair:
    """The pair moved rigidly onto the partners of some of its trees, until these stay the same.

    So starts that lie a little apart lead to the same evidence, to the last tree.
    """
    every = 1 + len(pair.reference) // ASKED
    points = pair.reference.xy[np.argsort(pair.reference.ids)][::every]
    before = np.empty(0, dtype=np.int64)
    for _ in range(SETTLING):
        here = pair.reference_from_source.inverse()(points)
        distance, partner = nearest(pair.source.tree, here, within / pair.reference_from_source.scale)
        near = np.isfinite(distance)
        if near.sum() < ENOUGH or np.array_equal(partner, before):
            break
        before = partner
        try:
            common = Model.RIGID.fit(pair.source_in_reference[partner[near]], points[near])
        except ValueError:
            break
        pair = pair.at(common @ pair.reference_from_source)
    return pair


def _nearest(
    pair: Pair, points: tuple[FloatArray, FloatArray], within: float, threads: int
) -> tuple[tuple[IntArray, FloatArray], tuple[IntArray, FloatArray]]:
    """The nearest source tree (n,) of each reference tree that is looked for at these points, in the reference's
    frame, and how far it is; and the other way round (m,). -1 and infinite where none is within so many metres.

    Each is asked in the frame of the survey that is asked, so that its k-d tree serves all placements.
    """
    to_source, scale = pair.reference_from_source.inverse(), pair.reference_from_source.scale
    away, forth = nearest_of(pair.source, to_source(points[0]), pair.reference, within / scale, threads=threads)
    back_away, back = nearest_of(pair.reference, points[1], pair.source, within, threads=threads)
    return (
        (np.where(forth < len(pair.source), forth, -1), scale * away),
        (np.where(back < len(pair.reference), back, -1), back_away),
    )


def _common_offset(
    planting: Planting, points: tuple[FloatArray, FloatArray], partner: IntArray, mutual: BoolArray
) -> FloatArray:
    """How far the mutual partners around each tree stand from theirs on average, (n, 2) metres; 0 where none do.

    `points` are those of the survey itself and of the other one.
    """
    offset = np.zeros((len(partner), 3))
    offset[mutual, :2] = points[1][partner[mutual]] - points[0][mutual]
    offset[mutual, 2] = 1
    smooth = planting.averaged(offset, ROUNDS)
    return np.asarray(smooth[:, :2] / (smooth[:, 2:] + 1e-3))


def footprint(xy: FloatArray, step: float) -> Footprint:
    """The ground that a survey's trees (n, 2) cover, metres, when this is their in-row step."""
    return Footprint.of(xy, FOOTPRINT * step)


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
    partner[side.away <= BESIDE * side.planting.step] = names.index("beside")
    area = np.maximum(side.features.area, other.features.area[side.near])
    partner[side.away <= np.sqrt(area / np.pi)] = names.index("within")
    partner[side.partner >= 0] = names.index("taken")
    if len(mine):
        common = _common_offset(side.planting, (side.xy, other.xy), side.partner, side.mutual)
        away = np.hypot(*(other.xy[side.partner[mine]] - side.xy[mine] - common[mine]).T)
        close = away <= max(CLOSE * float(np.median(away)), EXACT * side.planting.step)
        difference = side.planting.log_area[mine] - other.planting.log_area[side.partner[mine]]
        spread = max(1.4826 * float(np.median(np.abs(difference))), 0.05)
        like = np.abs(difference) <= LIKE * spread
        partner[mine] = names.index("apart_unlike") + 2 * close + like
    return partner
