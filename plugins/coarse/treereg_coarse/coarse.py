"""The global search for where one survey lies on another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from treereg_core.correlation import FINE, ROUGH, Correlator
from treereg_core.errors import NoRegistration
from treereg_core.evidence import Evidence, Match, mean_statistics
from treereg_core.method import CoarseAligner, Context
from treereg_core.pair import Pair
from treereg_core.prior import log_prior
from treereg_core.rotation import rotations
from treereg_core.screening import screen
from treereg_core.transform import Affine, Rigid

# The search ends early when the best peak scores this much, and the next less than this share of it.
CLEAR = 60.0
CLOSE = 0.25
# The finer maps of more trees take more memory than most machines have, and so many trees seldom need them.
MANY = 300_000
# Peaks taken from each map by score, and as many by the number of trees that meet.
PER_MAP = 40
# Where no peak stands clear, so many placements are screened on a few trees.
SCREENED = 640
# Source trees on which the last few are refined.
REFINED_ON = 3000
# A decoy has at least so many pairs, and this share of the best match rate.
FEW = 30
ON_LATTICE = 0.9


@dataclass(frozen=True)
class _Candidate:
    transform: Affine
    score: float


class Coarse(CoarseAligner):
    """Global search by pair directions and cross-correlation (after Reddy & Chatterji 1996, doi:10.1109/83.506761).

    Finds any rotation and any shift, with part overlap, in three steps. The rotation comes from the directions between
    the trees within each survey, which no shift changes. For each likely rotation and its half turn, all shifts are
    tried at once by FFT, on maps of where trees stand and of how large their crowns are for their surroundings: the
    latter is what tells one tree or row from the next. The best few are refined and ranked by the evidence of single
    trees.

    Good for orchards of 60 trees and more, planted or wild, seen by both surveys to a quarter at least. It proposes
    several placements where the evidence leaves a choice; which one is right, if any, is for the judge to say. The
    scale of the two surveys must agree within about one per cent.
    """

    name = "coarse"

    rotations: int = Field(4, ge=1, le=36, description="how many rotations are tried, each with its half turn")
    refined: int = Field(12, ge=1, le=200, description="how many placements are looked at tree by tree")
    proposals: int = Field(4, ge=1, le=50, description="how many distinct placements go on to the matcher at most")

    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """A few placements of the source, best first, whatever the pair's present transform.

        Raises `NoRegistration` when a survey has fewer than three trees that stand apart, or when no shift lets
        enough trees meet.
        """
        if min(len(pair.reference), len(pair.source)) < 3 or min(pair.reference.spacing, pair.source.spacing) <= 0:
            raise NoRegistration("there are too few trees to search for a placement")
        evidence = Evidence(pair.reference, pair.source, context.threads)
        candidates = self._peaks(pair, evidence, context)
        if not candidates:
            raise NoRegistration("no shift of the source lets enough trees meet")
        return tuple(pair.at(c) for c in self._ranked(pair, evidence, candidates, context)[: self.proposals])

    def _peaks(self, pair: Pair, evidence: Evidence, context: Context) -> list[_Candidate]:
        """The best shifts of the likeliest rotations; further rotations only while no shift stands clear."""
        angles, _ = rotations(
            pair.reference, pair.source, evidence.spacing, context.rng("coarse", "directions"), self.rotations
        )
        found: list[_Candidate] = []
        # The last look is the first again on a finer grid.
        finer = angles[:1] if max(len(pair.reference), len(pair.source)) <= MANY else ()
        for angle, grid in [*((a, ROUGH) for a in angles), *((a, FINE) for a in finer)]:
            for peaks in Correlator(evidence, grid).at(Rigid.turn(float(angle))):
                for k in peaks.foremost(PER_MAP):
                    transform = peaks.transform(k)
                    prior = 2 * log_prior(transform, pair.source, context.georeference_sd)
                    found.append(_Candidate(transform, float(peaks.score[k]) + prior))
            found.sort(key=lambda c: -c.score)
            if len(found) > 1 and found[0].score > CLEAR and found[1].score < CLOSE * found[0].score:
                break
        if sum(c.score > CLOSE * found[0].score for c in found) <= self.refined:
            return found[: self.refined]
        return self._screened(evidence, found, context)

    def _screened(self, evidence: Evidence, found: list[_Candidate], context: Context) -> list[_Candidate]:
        """Successive halving: many placements on few trees, then fewer on more."""
        rng = context.rng("coarse", "sample")
        first = found[: self.refined // 2]
        for kept, trees in ((SCREENED, 250), (SCREENED // 10, 1500)):
            found = found[:kept]
            n = len(evidence.source.features)
            sample = np.sort(rng.choice(n, min(trees, n), replace=False))
            screened = screen(evidence, tuple(c.transform for c in found), sample)
            found = [_Candidate(t, float(s)) for t, s in zip(screened.transforms, screened.score, strict=True)]
            found.sort(key=lambda c: -c.score)
        return first + found[: self.refined - len(first)]

    def _ranked(self, pair: Pair, evidence: Evidence, candidates: list[_Candidate], context: Context) -> list[Affine]:
        """Distinct placements after refinement, by the evidence of single trees."""
        n = len(evidence.source.features)
        sample = np.sort(context.rng("coarse", "refinement").choice(n, min(n, REFINED_ON), replace=False))
        screened = screen(evidence, tuple(c.transform for c in candidates), sample, rounds=3)
        matches: list[Match] = []
        for k in np.argsort(-screened.score, kind="stable"):
            transform = screened.transforms[k]
            if all(evidence.apart(transform, m.transform) > evidence.gate for m in matches):
                matches.append(evidence.match(transform))
            if len(matches) == 2 * self.proposals:
                break
        if len(matches) < 2:
            return [m.transform for m in matches]
        statistics = [evidence.statistics(m) for m in matches]
        # Only placements on the lattice are decoys: against one that is askew, any other looks right.
        rate = np.array([m.rate * (s.pairs >= FEW) for m, s in zip(matches, statistics, strict=True)])
        scores = []
        for k, match in enumerate(matches):
            others = np.delete(np.arange(len(matches)), k)
            decoy = mean_statistics([statistics[i] for i in others if rate[i] >= ON_LATTICE * rate[others].max()])
            parts = evidence.scores(match, statistics[k].better_than(decoy), decoy)
            prior = log_prior(match.transform, pair.source, context.georeference_sd)
            scores.append(sum(float(p.sum()) for p in parts) + prior)
        order = np.argsort(-np.array(scores), kind="stable")
        return [matches[k].transform for k in order if scores[k] >= CLOSE * scores[order[0]]]
