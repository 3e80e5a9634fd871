"""Rivals: the placements that could be mistaken for a given one, made by the judge itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.correlation import Correlator, Peaks
from treereg_core.evidence import Evidence, Match
from treereg_core.features import largest
from treereg_core.method import Context
from treereg_core.prior import log_prior, log_priors
from treereg_core.rotation import rotations
from treereg_core.screening import screen
from treereg_core.transform import Affine, FloatArray, Rigid

# Neighbouring positions: the NEIGHBOURS at which most trees meet, within NEAR tree spacings.
NEAR = 12.0
NEIGHBOURS = 48
# So many of the best, and of the best visited, shifts of every turn.
FOREMOST = 12
# Near the files' own georeference so many more at which this share of the most trees meet.
MEETING = 0.5
# Of so many likely turns those whose fit is at least this share of the best one's.
TURNS = 6
SUITS = 0.6
# So many source trees tell which rivals are dangerous; so many of these are compared over all trees.
SAMPLE = 500
DANGEROUS = 6
# So many neighbours say what a decoy is like.
DECOYS = 4


@dataclass(frozen=True, eq=False)
class Rivals:
    """`dangerous`: those that come closest, to be compared tree by tree; `decoys`: typical wrong but regular ones."""

    dangerous: tuple[Match, ...]
    decoys: tuple[Match, ...]


def find_rivals(evidence: Evidence, transform: Affine, others: tuple[Affine, ...], context: Context) -> Rivals:
    """Placements a few trees or rows away, turned as the planting patterns allow, and anywhere else that looks good.

    `others` are further ones to be considered, such as what other methods or starts ended on. If the judge knew only
    what a search proposes it would miss the dangerous ones.
    """
    correlator = Correlator(evidence)
    near: list[Affine] = []
    far = list(others)
    for turn in _turns(evidence, transform, context):
        for half_turn, peaks in enumerate(correlator.at(Rigid.turn(turn) @ transform)):
            if turn == 0 and not half_turn:
                near = _nearest(peaks, transform, evidence)
            far += [peaks.transform(k) for k in peaks.foremost(FOREMOST)]
            far += _probable(peaks, evidence, context)
    near += _around(transform, evidence)[: max(DECOYS - len(near), 0)]
    n = len(evidence.source.features)
    sample = np.sort(context.rng("judge", "sample").choice(n, min(SAMPLE, n), replace=False))
    everything = screen(evidence, tuple(near + far), sample)
    place = list(everything.transforms)
    distinct = _distinct(evidence, transform, place, everything.score)
    if context.georeference_sd is not None:
        # On a lattice the trees alone would name only placements that the georeference rules out.
        source, sd = evidence.source.features, context.georeference_sd
        prior = np.array([log_prior(one, source, sd) for one in place])
        distinct = list(dict.fromkeys(_distinct(evidence, transform, place, everything.score + prior) + distinct))
    decoys = [k for k in range(min(len(near), DECOYS)) if evidence.apart(place[k], transform) > evidence.gate]
    wanted = list(dict.fromkeys(distinct + decoys))
    match = dict(zip(wanted, evidence.matches([place[k] for k in wanted]), strict=True))
    return Rivals(tuple(match[k] for k in distinct), tuple(match[k] for k in decoys))


def _turns(evidence: Evidence, transform: Affine, context: Context) -> list[float]:
    """By how many degrees the source might have to be turned further: 0, and the other turns that suit both patterns.

    Half turns go without saying. The turns are found anew, since the placement may itself be askew.
    """
    reference, source = evidence.reference.features, evidence.source.features
    angles, fit = rotations(reference, source, evidence.spacing, context.rng("judge", "directions"), TURNS)
    further = (angles - transform.rotation_deg + 90) % 180 - 90
    return [0.0, *(float(a) for a, f in zip(further, fit, strict=True) if abs(a) > 1 and f > SUITS * fit[0])]


def _nearest(peaks: Peaks, transform: Affine, evidence: Evidence) -> list[Affine]:
    """The neighbouring positions at which most trees meet, most first."""
    away = np.hypot(*(peaks.shift - transform.shift).T)
    near = np.flatnonzero((away > evidence.gate) & (away < NEAR * evidence.spacing))
    return [peaks.transform(int(k)) for k in near[largest(peaks.met[near], NEIGHBOURS)]]


def _probable(peaks: Peaks, evidence: Evidence, context: Context) -> list[Affine]:
    """Placements that trees and georeference together, or the latter alone, make likely; none without the latter."""
    if context.georeference_sd is None:
        return []
    prior = log_priors(peaks.template, peaks.shift, evidence.source.features, context.georeference_sd)
    likely = largest(peaks.score / 2 + prior, FOREMOST)
    meeting = np.flatnonzero(peaks.met > MEETING * peaks.met.max(initial=0.0))
    at_home = meeting[largest(prior[meeting], FOREMOST)]
    return [peaks.transform(int(k)) for k in np.union1d(likely, at_home)]


def _around(transform: Affine, evidence: Evidence) -> list[Affine]:
    """Placements a few spacings away on all sides: decoys where there is no lattice."""
    angles = np.arange(8) * (np.pi / 4)
    steps = 4 * evidence.spacing * np.column_stack([np.cos(angles), np.sin(angles)])
    return [type(transform)(transform.linear, transform.shift + step) for step in steps]


def _distinct(evidence: Evidence, transform: Affine, place: list[Affine], score: FloatArray) -> list[int]:
    """Positions of the placements that differ from the given one and from each other, best first."""
    chosen: list[int] = []
    for k in np.argsort(-score, kind="stable"):
        seen = [transform, *(place[c] for c in chosen)]
        if all(evidence.apart(place[k], other) > evidence.gate for other in seen):
            chosen.append(int(k))
        if len(chosen) == DANGEROUS:
            break
    return chosen
