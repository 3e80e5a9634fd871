"""The default row matcher: rows by nearest summed distances, laid on each other as lines, then slid along."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.evidence import Evidence
from treereg_core.features import IntArray
from treereg_core.footprint import Footprint
from treereg_core.method import Context, RowMatcher
from treereg_core.pair import Pair
from treereg_core.row_laying import Laid, lay, start_of
from treereg_core.row_lines import RowLines, lines_of
from treereg_core.row_matching import match_rows
from treereg_core.row_trees import along_rows
from treereg_core.screening import screen
from treereg_core.transform import Affine, FloatArray, Rigid

# So many trees are asked which line they stand on.
ON_LINES = 160
# Placements are tried so many row distances to both sides, so far apart, and drawn onto lines within these distances.
ASIDE, ASIDE_STEP = 1.5, 0.375
WIDTHS = (0.26, 0.18, 0.12)
# Where lines do not meet so well, or no placement stands clear, starts are turned too: rows end so many row distances
# to both sides, so far apart.
SURE, TURNED, TURNED_STEP = 0.7, 1.5, 0.5
# A placement is on the lines when they meet as well as this share of the best; so many of them are looked at.
AS_TIGHT, LINED_UP = 0.8, 3
# Below this share of trees close to a line no rows meet.
MEET = 0.15
# Then so many in-row spacings to both sides along the rows, so far apart.
ALONG, ALONG_STEP = 3.5, 0.7
# Screened on so many trees, then the best on more.
FIRST, LOOKED_AT, SECOND = 200, 8, 1000
# The search ends with the first look in which one placement scores this much, and the next less than this share of it.
CLEAR, CLOSE = 30.0, 0.25
# How far starts usually are off, along in in-row spacings, across in row distances.
USUAL_ALONG, USUAL_ACROSS = 2.0, 0.7
# So many placements come back at most, none less likely than the best by this log-likelihood.
RETURNED, WORSE = 4, 30.0


class NearestRows(RowMatcher):
    """Rows on rows as lines, by summed distances (Chen & Medioni 1992, doi:10.1016/0262-8856(92)90066-C).

    It stands in for a row matcher where an expression has none. The rows of the source are laid on those of the
    reference, which fixes the turn and the shift across; then they are slid along, and single trees tell which of the
    placements are right: where some are missing, how large their crowns are, how they were planted. Under each such
    placement rows are matched on the stretch that both have, whichever way they run, however they were cut or split.

    Good when no row begins farther than two fifths of the row distance across, and two trees along, from its true
    place. From farther off it may end on a neighbouring row.
    """

    name = "nearest_rows"

    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """The likeliest placement with its rows, and its rivals when the trees leave a choice; each fitted to trees.

        Raises `NoRegistration` when a survey has no rows, when they cross those of the other or lie elsewhere, or when
        too few trees of matched rows meet.
        """
        rows, reference, source = lines_of(pair)
        search = _Search(pair, reference, source, Evidence(pair.reference, pair.source, context.threads), context)
        results: list[Pair] = []
        reason = NoRegistration("no rows meet")
        for transform in search.placements():
            matched = replace(pair, rows=replace(rows, matches=match_rows(reference, source, transform))).at(transform)
            try:
                matched = matched.at(along_rows(matched, context).transform)
            except NoRegistration as refusal:
                reason = refusal
                continue
            if search.differs(matched.reference_from_source, [result.reference_from_source for result in results]):
                results.append(matched)
        if not results:
            raise reason
        return tuple(results)


@dataclass(frozen=True, eq=False)
class _Search:
    """Looks for the placements of two surveys at which their rows, and then their trees, meet."""

    pair: Pair
    reference: RowLines
    source: RowLines
    evidence: Evidence
    context: Context

    def placements(self) -> list[Affine]:
        """Distinct placements, likeliest first. Raises `NoRegistration` when no rows meet."""
        rng = self.context.rng(NearestRows.name)
        # where rows stand far apart the ground of the evidence is a strip along each
        xy, spacing = self.pair.reference.xy, self.pair.reference.spacing
        ground = Footprint.of(xy, max(2.5 * spacing, self.reference.distance))
        covered = ground.covers(self.pair.source_in_reference)
        if not covered[self.source.trees].any():
            raise NoRegistration("no row of the source lies on the ground of the reference, so none can be matched")
        asked = _some(rng, np.flatnonzero(covered[self.source.trees]), ON_LINES)
        common = np.flatnonzero(covered)
        few, more = _some(rng, common, FIRST), _some(rng, common, SECOND)
        ranked: list[tuple[float, Affine]] = []
        for laid in self.looks(asked):
            ranked = self.slid(laid, asked, few, more)
            if len(ranked) > 1 and ranked[0][0] > CLEAR and ranked[1][0] < CLOSE * ranked[0][0]:
                break
        return [transform for score, transform in ranked[:RETURNED] if score > ranked[0][0] - WORSE]

    def looks(self, asked: IntArray) -> Iterator[Laid]:
        """Ever wider looks at where lines lie on lines; most often the first, what moved least, is right."""
        start = start_of(self.pair.reference_from_source, self.context.model, self.source)
        laid = self.lined_up(start, [start], asked)
        if laid.tight.max() > SURE:
            yield laid.take(np.arange(1))
            if len(laid) > 1:
                yield laid
        laid = self.lined_up(start, self._turned(start, asked), asked)
        if not laid.tight.max() > MEET:
            raise NoRegistration("the rows of the two surveys cross each other or lie apart, so none can be matched")
        yield laid

    def lined_up(self, start: Affine, turned: Sequence[Affine], asked: IntArray) -> Laid:
        """Distinct placements at which lines meet, beside some; what moved least from the start comes first."""
        aside = np.outer(np.arange(-ASIDE, ASIDE + 1e-9, ASIDE_STEP) * self.reference.distance, self._across())
        widths = tuple(width * self.reference.distance for width in WIDTHS)
        laid = lay(self.reference, self.source, asked, Laid.of(turned).moved(aside), widths)
        placed = laid.transforms()
        good = np.flatnonzero(laid.tight >= AS_TIGHT * laid.tight.max())
        moved = np.array([self.evidence.apart(start, placed[k]) for k in good])
        kept: list[int] = []
        for k in good[np.argsort(moved, kind="stable")].tolist():
            if len(kept) < LINED_UP and self.differs(placed[k], [placed[other] for other in kept]):
                kept.append(k)
        return laid.take(np.array(kept))

    def slid(self, laid: Laid, asked: IntArray, few: IntArray, more: IntArray) -> list[tuple[float, Affine]]:
        """Distinct placements along the lines, with what speaks for each, likeliest first."""
        along = np.arange(-ALONG, ALONG + 1e-9, ALONG_STEP) * self.reference.spacing
        widths = tuple(width * self.reference.distance for width in WIDTHS[-2:])
        tried = laid.moved(np.outer(along, self._along()))
        tried = lay(self.reference, self.source, asked[::2], tried, widths)
        screened = screen(self.evidence, tried.transforms(), few)
        best = self._distinct(screened.transforms, screened.score)[:LOOKED_AT]
        screened = screen(self.evidence, tuple(t for _, t in best), more)
        score = screened.score - self._strangeness(screened.transforms, asked)
        return self._distinct(screened.transforms, score)

    def differs(self, transform: Affine, others: list[Affine]) -> bool:
        """Whether a placement puts the trees elsewhere than all others."""
        return all(self.evidence.apart(transform, other) > self.evidence.gate for other in others)

    def _distinct(self, transforms: tuple[Affine, ...], score: FloatArray) -> list[tuple[float, Affine]]:
        """Distinct ones of these placements, best first, each with its score."""
        kept: list[tuple[float, Affine]] = []
        for k in np.argsort(-score, kind="stable").tolist():
            if self.differs(transforms[k], [other for _, other in kept]):
                kept.append((float(score[k]), transforms[k]))
        return kept

    def _strangeness(self, transforms: tuple[Affine, ...], asked: IntArray) -> FloatArray:
        """How unusual it is that a start was off by so much: minus the logarithm of its probability, (k,)."""
        points, start = self.source.smooth[asked], self.pair.reference_from_source
        tangent = self.source.tangent[asked] @ start.linear.T
        tangent /= np.hypot(*tangent.T)[:, None]
        away = np.array([transform(points) for transform in transforms]) - start(points)
        along = (away * tangent).sum(axis=2)
        square = (away**2).sum(axis=2)
        usual_along, usual_across = USUAL_ALONG * self.reference.spacing, USUAL_ACROSS * self.reference.distance
        odd = along**2 / usual_along**2 + np.maximum(square - along**2, 0) / usual_across**2
        return np.asarray(odd.mean(axis=1) / 2)

    def _along(self) -> FloatArray:
        """The direction (2,) that rows of the source have in common, in the reference's frame."""
        tangent = self.source.tangent @ self.pair.reference_from_source.linear.T
        return np.asarray(np.linalg.eigh(tangent.T @ tangent)[1][:, 1])

    def _across(self) -> FloatArray:
        x, y = self._along()
        return np.array([-y, x])

    def _turned(self, start: Affine, asked: IntArray) -> list[Affine]:
        """The start turned about the middle of its trees, by angles that move the ends of rows to each side."""
        points = start(self.source.smooth[asked])
        centre = points.mean(axis=0)
        half = max(float(np.abs((points - centre) @ self._along()).max()), self.reference.spacing)
        ends = np.arange(-TURNED, TURNED + 1e-9, TURNED_STEP) * self.reference.distance
        return [Rigid.turn(np.degrees(end / half), about=centre) @ start for end in ends]


def _some(rng: np.random.Generator, among: IntArray, count: int) -> IntArray:
    """So many of these positions, or all of them."""
    return np.sort(rng.choice(among, min(len(among), count), replace=False))
