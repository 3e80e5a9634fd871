"""The judge: the same for all methods, it says which result stands, against what, and how far to trust it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from treereg_core.calibration import failure_probability
from treereg_core.comparison import Comparison, compare, in_part_only, standing
from treereg_core.evidence import Evidence, Match, mean_statistics
from treereg_core.expected_error import expected_error, fit_covariance
from treereg_core.judgement import ExpectedError, Judgement, Matches, Rival, Verdict
from treereg_core.method import Context, Registration
from treereg_core.pair import Pair
from treereg_core.prior import log_prior, log_prior_at_home
from treereg_core.rivals import find_rivals
from treereg_core.threads import concurrently
from treereg_core.transform import Affine, Rigid

# An overlap of less than this share of the trees owes up to CHOICE to having been chosen among many.
SMALL_OVERLAP = 0.2
CHOICE = 60.0
# A placement that beats decoys by less does not explain the trees, unless nearly all of them meet, as on a lattice.
STANDING = 15.0
PERIODIC = 0.95
# Against larger log-odds it is no rival that makes a placement doubtful.
DECISIVE = 20.0
# Against smaller ones a rival explains the trees about as well.
TIED = 5.0
# A smaller failure probability is doubtful to nobody but who asked for a still smaller one.
CERTAIN_ENOUGH = 1e-3
# A placement that lays a part of a bent map only is wrong so often at least; of some 200 on simulated orchards one was.
PART_FAILS = 0.01
NOTHING = Matches(np.zeros((0, 2), np.int64), np.zeros(0))


@dataclass(frozen=True, eq=False)
class _Case:
    """The best registration, with all that speaks for and against it."""

    registration: Registration
    match: Match
    alone: Comparison
    opponents: tuple[tuple[Affine, Comparison], ...]
    in_part_only: bool
    by_chance: bool

    @property
    def stands(self) -> float:
        """By how much it beats decoys, less what a small overlap owes to choice.

        The smaller the overlap, the more placements there are, and with few trees one of them looks good by chance.
        Nothing is left where partners lie no nearer than those that chance brings within the gate.
        """
        if self.by_chance:
            return -math.inf
        seen = np.concatenate([self.match.covered_reference, self.match.covered_source]).mean()
        return self.alone.margin - CHOICE * max(0.0, 1 - float(seen) / SMALL_OVERLAP)

    @property
    def failure_probability(self) -> float:
        """That it is wrong: against decoys or its most dangerous rival, whichever is more, or for laying a part."""
        owed = self.alone.margin - self.stands
        against = (self.alone, *(c for _, c in self.opponents))
        failure = max(failure_probability(c.margin - owed, c.prior) for c in against)
        return max(failure, PART_FAILS) if self.in_part_only else failure


class Judge(BaseModel):
    """Decides by the evidence of single trees, against rivals of its own making.

    The result with the most evidence is compared with every placement that could be mistaken for it: its neighbours on
    the planting lattice, turned ones, and whatever else looks good. Log-odds alone are overconfident; the failure
    probability comes from the smaller of the log-odds and twice the squared consistency over the field, calibrated on
    simulated orchards.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    rivals: int = Field(5, ge=0, le=8, description="how many rivals are reported at most")

    def judge(self, pair: Pair, candidates: Sequence[Registration], context: Context, max_failure: float) -> Judgement:
        """The word on the best of `candidates`, which are registrations of `pair`, all usable trees in it.

        It is accepted when its failure probability is at most `max_failure`.
        """
        if min(len(pair.reference), len(pair.source)) < 3 or min(pair.reference.spacing, pair.source.spacing) <= 0:
            return _failed("There are too few trees that stand apart to say anything.", NOTHING)
        evidence = Evidence(pair.reference, pair.source, context.threads)
        before = _matches(evidence.match(Rigid.identity()), pair)
        if not candidates:
            return _failed("No placement was found at which the trees of the two surveys meet.", before)
        case = _best(evidence, pair, candidates, context)
        if case is None:
            return _failed("No placement was found at which enough trees of the two surveys meet.", before)
        failure = case.failure_probability
        verdict, reason = _verdict(case, failure, max_failure, context.georeference_sd)
        if verdict is Verdict.FAILED:
            return _failed(reason, before)
        error = _expected_error(evidence, case, pair, context)
        if error is None:
            return _failed("The pairs that were found do not determine the transform.", before)
        return Judgement(
            verdict=verdict,
            reason=reason,
            transform=case.registration.transform,
            matches=_matches(evidence.match(case.registration.transform), pair),
            before=before,
            expected_error=error,
            failure_probability=failure,
            rivals=tuple(Rival(t, -c.log_odds) for t, c in case.opponents[: self.rivals]),
        )


def _best(evidence: Evidence, pair: Pair, candidates: Sequence[Registration], context: Context) -> _Case | None:
    """The candidate with the most evidence, against its rivals; None when nothing meets anywhere."""
    distinct: list[Registration] = []
    for candidate in candidates:
        if all(evidence.apart(candidate.transform, d.transform) > evidence.gate / 2 for d in distinct):
            distinct.append(candidate)
    matches = evidence.matches([evidence.refine(d.transform, context.model, rounds=1) for d in distinct])
    best = 0
    rivals = find_rivals(evidence, matches[0].transform, tuple(m.transform for m in matches[1:]), context)
    if len(matches) > 1 and rivals.decoys:
        decoy = mean_statistics([evidence.statistics(m) for m in rivals.decoys])
        totals = []
        for match in matches:
            right = evidence.statistics(match).better_than(decoy)
            prior = log_prior(match.transform, pair.source, context.georeference_sd)
            totals.append(sum(float(s.sum()) for s in evidence.scores(match, right, decoy)) + prior)
        best = int(np.argmax(totals))
        if best:
            others = tuple(m.transform for k, m in enumerate(matches) if k != best)
            rivals = find_rivals(evidence, matches[best].transform, others, context)
    match = matches[best]
    if not rivals.decoys or not len(match.source):
        return None
    decoy = mean_statistics([evidence.statistics(m) for m in rivals.decoys])
    right = evidence.statistics(match).better_than(decoy)
    prior = log_prior(match.transform, pair.source, context.georeference_sd)

    def against(rival: Match) -> tuple[Affine, Comparison]:
        known = prior - log_prior(rival.transform, pair.source, context.georeference_sd)
        return rival.transform, compare(evidence, match, rival, right, decoy).plus(known)

    opponents = concurrently(against, rivals.dangerous, evidence.threads)
    opponents.sort(key=lambda o: o[1].log_odds)
    alone = standing(evidence, match, right, decoy)
    if match.rate >= PERIODIC:
        # Where all trees meet, as on a lattice, the georeference alone may tell which position it is.
        alone = alone.plus(
            log_prior_at_home(match.transform, pair.source, context.georeference_sd, evidence.spacing / 2)
        )
    # Partners anywhere within the gate lie so far off that the mean square is half of its own.
    by_chance = float((match.distance**2).mean()) >= evidence.gate**2 / 2
    return _Case(distinct[best], match, alone, tuple(opponents), in_part_only(evidence, match), by_chance)


def _verdict(case: _Case, failure: float, max_failure: float, georeference_sd: float | None) -> tuple[Verdict, str]:
    share = f"{case.match.rate:.0%} of the trees that both surveys cover have a partner"
    if failure <= max_failure:
        return Verdict.ACCEPTED, f"{share}, and {_next_best(case)}."
    if case.stands < STANDING and case.match.rate < PERIODIC:
        known = (
            "" if georeference_sd is None else ", or their georeference may be further off than --georeference-sd says"
        )
        return Verdict.FAILED, (
            f"No placement explains the trees: at the best one {share}, no better than by chance. The surveys may show "
            f"different orchards, or too little of the same one{known}."
        )
    if case.in_part_only:
        doubt = "one of the maps is bent, so that in a part of the field hardly any trees meet"
    elif failure <= CERTAIN_ENOUGH:
        doubt = _next_best(case)
    elif case.opponents and case.opponents[0][1].log_odds > DECISIVE:
        doubt = "the parts of the field do not agree on it, as when one of the maps is bent or a part of it is hidden"
    elif case.opponents and case.opponents[0][1].log_odds > TIED:
        doubt = "the trees are too few, or say too little, to be sure of it"
    else:
        doubt = "another placement explains the trees about as well"
    return Verdict.AMBIGUOUS, (
        f"{share}, but {doubt}: the chance that this placement is wrong is {failure:.2g}, more than the "
        f"{max_failure:g} allowed. Compare the rivals, or say how far the georeference may be off (--georeference-sd)."
    )


def _next_best(case: _Case) -> str:
    if not case.opponents:
        return "no other placement comes near"
    log_odds = case.opponents[0][1].log_odds
    times = "over a million" if log_odds > math.log(1e6) else f"{math.exp(max(log_odds, 0.0)):,.0f}"
    return f"the next best placement is {times} times less likely"


def _expected_error(evidence: Evidence, case: _Case, pair: Pair, context: Context) -> ExpectedError | None:
    """The error of the fit, and on top what it is away from the evidence's own fit beyond what chance explains."""
    try:
        covariance, spread = fit_covariance(case.registration, pair.reference, pair.source, context.model)
    except (ValueError, np.linalg.LinAlgError):
        return None
    return expected_error(covariance, spread)


def _matches(match: Match, pair: Pair) -> Matches:
    ids = np.column_stack([pair.reference.ids[match.reference], pair.source.ids[match.source]])
    return Matches(ids, match.distance)


def _failed(reason: str, before: Matches) -> Judgement:
    return Judgement(Verdict.FAILED, reason, None, NOTHING, before, None, 1.0, ())
