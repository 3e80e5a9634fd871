"""Placements worth a look: rows laid on rows at every offset, in both senses, and slid along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.evidence import Evidence
from treereg_core.features import IntArray
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.row_laying import Laid, lay, start_of
from treereg_core.row_lines import RowLines
from treereg_core.screening import screen
from treereg_core.transform import Affine, FloatArray, Rigid

ON_LINES, SCREENED = 160, 300
"""So many trees are asked which line they stand on, and so many whether they meet a tree."""
ASIDE, ASIDE_STEP = 1.125, 0.375
"""The start is tried so many row distances to both sides, so far apart, and laid on the lines that are best there."""
WIDTHS = (0.26, 0.18, 0.12)
"""Lines draw trees within these distances, in row distances, one round each."""
TURNED = (0.0, -0.6, 0.6, -1.2, 1.2)
"""It is also turned, so that rows end so many row distances to the side."""
MEET, AS_TIGHT = 0.15, 0.8
"""Below this share of trees close to a line no rows meet; lines meet when they do as well as this share of the best."""
APART = 0.4
"""Placements nearer across than this, in row distances, are of one offset."""
ALONG, ALONG_STEP = 3.5, 0.7
"""So many in-row spacings to both sides along the rows, so far apart."""

CROSSING = "the rows of the two surveys cross each other or lie apart, so none can be matched"


@dataclass(frozen=True, eq=False)
class Placed:
    """A placement worth a look.

    - `trees`: what single trees say for it, a log-likelihood.
    - `sense`: 0, or 1 when it is a half turn from the start.
    - `along`, `across`: how much farther it puts the source than the base of its sense, metres, in the rows' frame.
    - `offset`: counts the offsets across, so that placements of one offset differ along the rows alone.
    """

    transform: Affine
    trees: float
    sense: int
    along: float
    across: float
    offset: int


@dataclass(frozen=True, eq=False)
class Ground:
    """Two surveys with rows as lines, ready to be laid on each other.

    `frame` takes the reference to a frame along its rows; `apart` is the mean distance from row to next row, metres,
    where `reference.distance` is that to the nearer one, as in double rows.
    """

    pair: Pair
    reference: RowLines
    source: RowLines
    evidence: Evidence
    frame: Rigid
    apart: float


def bases(ground: Ground, context: Context) -> tuple[Affine, Affine]:
    """The start, its rows laid on those of the reference that are nearest, and the half turn of that.

    Raises `NoRegistration` when rows do not meet.
    """
    start = start_of(ground.pair.reference_from_source, context.model, ground.source)
    asked, _ = _samples(ground, context)
    points = start(ground.source.smooth)
    centre = points.mean(axis=0)
    distance = ground.reference.distance
    half = max(float(np.abs(ground.frame.linear[0] @ (points - centre).T).max()), ground.reference.spacing)
    turned = [Rigid.turn(np.degrees(end * distance / half), about=centre) @ start for end in TURNED]
    laid = _laid(ground, turned, asked, ASIDE * distance)
    if not laid.tight.max() > MEET:
        raise NoRegistration(CROSSING)
    placed = laid.transforms()
    tight = np.flatnonzero(laid.tight >= (1 + AS_TIGHT) / 2 * laid.tight.max())
    base = placed[min(tight.tolist(), key=lambda k: ground.evidence.apart(start, placed[k]))]
    return base, Rigid.turn(180.0, about=base(ground.source.smooth).mean(axis=0)) @ base


def placements(ground: Ground, based: tuple[Affine, Affine], offsets: float, context: Context) -> list[Placed]:
    """Distinct placements up to so many rows to both sides of the bases, and along.

    Raises `NoRegistration` when rows do not meet.
    """
    asked, few = _samples(ground, context)
    reference, points = ground.reference, ground.source.smooth[asked]
    senses = [_at_offsets(ground, base, asked, offsets) for base in based]
    if not any(map(len, senses)):
        raise NoRegistration(CROSSING)
    every = Laid.of([transform for laid in senses for transform in laid.transforms()])
    steps = np.arange(-ALONG, ALONG + 1e-9, ALONG_STEP) * reference.spacing
    widths = tuple(width * reference.distance for width in WIDTHS[-2:])
    slid = lay(reference, ground.source, asked[::2], every.moved(np.outer(steps, ground.frame.linear[0])), widths)
    # all at once, because each is scored against what is usual among them
    screened = screen(ground.evidence, slid.transforms(), few)
    found: list[Placed] = []
    for offset in range(len(every)):
        sense = int(offset >= len(senses[0]))
        of_one = slice(offset * len(steps), (offset + 1) * len(steps))
        transforms, score = screened.transforms[of_one], screened.score[of_one]
        away = _displaced(ground, transforms, based[sense], points)
        for k in _distinct(away, score, ground.evidence.gate).tolist():
            along, across = away[k].tolist()
            found.append(Placed(transforms[k], float(score[k]), sense, along, across, offset))
    return found


def _at_offsets(ground: Ground, base: Affine, asked: IntArray, offsets: float) -> Laid:
    """The base laid on the lines at each offset across, up to so many rows to both sides."""
    beside = APART * ground.reference.distance
    farthest = offsets * ground.apart + beside
    laid = _laid(ground, [base], asked, farthest)
    across = _displaced(ground, laid.transforms(), base, ground.source.smooth[asked])[:, 1]
    near = np.abs(across) < farthest
    good = np.flatnonzero(near & (laid.tight >= max(AS_TIGHT * laid.tight[near].max(initial=0.0), MEET)))
    return laid.take(good[_distinct(across[good, None], laid.tight[good], beside)])


def _samples(ground: Ground, context: Context) -> tuple[IntArray, IntArray]:
    """Trees that lie on the reference's ground: some of those in rows, as positions in the lines, and some of all."""
    rng = context.rng("bn_rows")
    source, trees = ground.pair.source, ground.source.trees
    covered = ground.evidence.reference.footprint.covers(ground.pair.source_in_reference)
    if not covered[trees].any():
        raise NoRegistration("no row of the source lies on the ground of the reference, so none can be matched")

    def some(among: IntArray, ids: IntArray, count: int) -> IntArray:
        among = among[np.argsort(ids[among])]  # whatever the order of trees, the same ones are drawn
        return np.asarray(among[np.sort(rng.choice(len(among), min(len(among), count), replace=False))])

    on_lines = some(np.flatnonzero(covered[trees]), source.ids[trees], ON_LINES)
    return on_lines, some(np.flatnonzero(covered), source.ids, SCREENED)


def _laid(ground: Ground, starts: Sequence[Affine], asked: IntArray, aside: float) -> Laid:
    """The starts and others beside them, up to so many metres to both sides, laid on the nearest lines."""
    distance = ground.reference.distance
    count = int(np.ceil(aside / (ASIDE_STEP * distance) - 1e-9))
    steps = np.arange(-count, count + 1) * ASIDE_STEP * distance
    moved = Laid.of(starts).moved(np.outer(steps, ground.frame.linear[1]))
    return lay(ground.reference, ground.source, asked, moved, tuple(width * distance for width in WIDTHS))


def _displaced(ground: Ground, placed: Sequence[Affine], base: Affine, points: FloatArray) -> FloatArray:
    """How much farther along and across (k, 2), metres, placements put points of the source than a base, on average."""
    middle = points.mean(axis=0, keepdims=True)
    away = np.array([transform(middle)[0] for transform in placed]).reshape(-1, 2) - base(middle)
    return np.asarray(away @ ground.frame.linear.T)


def _distinct(places: FloatArray, score: FloatArray, apart: float) -> IntArray:
    """Positions of the places (k, d) that are so many metres from every better one, best first."""
    kept: list[int] = []
    for k in np.argsort(-score, kind="stable").tolist():
        if (((places[kept] - places[k]) ** 2).sum(axis=1) > apart**2).all():
            kept.append(k)
    return np.array(kept, dtype=np.int64)
