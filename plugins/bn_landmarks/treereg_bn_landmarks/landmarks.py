"""The feature filter `bn_landmarks`, and how it learns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydantic import Field

from treereg_bn_landmarks.choice import choose, passing
from treereg_bn_landmarks.counting import count, tempered
from treereg_bn_landmarks.evidence import Side, evidence, footprint, sides
from treereg_bn_landmarks.memory import NAME, Memory
from treereg_bn_landmarks.network import look_up, none, partners_unknown, posterior, xmlbif
from treereg_bn_landmarks.structure import NETWORK
from treereg_core.errors import NoRegistration
from treereg_core.features import IntArray
from treereg_core.learning import Learner, Outcome, State
from treereg_core.method import Context, Described, FeatureFilter
from treereg_core.pair import Pair
from treereg_core.transform import Affine, FloatArray

DESCRIBED = "landmark_probability"


class Landmarks(FeatureFilter, Learner):
    """Landmarks by a Bayesian network (Pearl 1988, doi:10.1016/C2009-0-27609-4; treereg's founding proposal, 3.3.1).

    A landmark is a real tree that both surveys show. Each tree's probability of being one follows from its confidence
    and those around it, its crown against its neighbours', its place in the planting, what stands there in the other
    survey under the present transform, and what earlier surveys had there. The most probable share goes on, partners
    together and spread over the orchard, so that they fix the rotation; each tree's weight is multiplied by its
    probability. That of every tree, at the judged placement, stands in the registered files as `landmark_probability`.

    So few trees fix the transform less well than all of them. With a threshold all but the unlikely ones go on, with
    the weights they had. The network is then not asked what stands there in the other survey: the matcher weighs that
    itself, and counted twice it would favour pairs that happen to lie close.

    Good when the start is within about a third of the in-row spacing. From farther off few trees have partners, and
    the probabilities say so. What is learned of an orchard changes the network's tables, and adds which single trees
    earlier surveys had.
    """

    name = NAME
    needs_pair = True
    network = NETWORK

    share: float = Field(0.2, gt=0, le=1, description="share of each survey's trees that goes on, the most probable")
    threshold: float | None = Field(
        None,
        ge=0,
        le=1,
        description="instead: trees go on that are at least so probable by all but what stands there in the other "
        "survey, with the weights they had; `share` is then the least that goes on",
    )

    def select(self, pair: Pair, context: Context) -> Pair:
        """The most probable landmarks of both surveys. Raises `NoRegistration` when nothing can be chosen."""
        both = sides(pair, context.threads)
        found = _probabilities(pair, both, context, partners=self.threshold is None)
        if self.threshold is None:
            chosen, weights = choose(both, found, self.share), found
        else:
            chosen = tuple(passing(p, self.threshold, self.share) for p in found)
            weights = np.ones_like(found[0]), np.ones_like(found[1])
        kept = []
        for side, weight, mask in zip(both, weights, chosen, strict=True):
            features = side.features.take(mask)
            kept.append(features.replace(weight=features.weight * weight[mask]))
        return pair.narrow(*kept)

    def describe(self, pair: Pair, context: Context) -> Described:
        """P(landmark) of every tree. Raises `NoRegistration` for fewer than three trees that stand apart."""
        reference, source = probabilities(pair, context)
        return {DESCRIBED: reference}, {DESCRIBED: source}

    def learn(self, outcome: Outcome, state: State) -> State:
        """The state with this outcome's counts, and its source's trees where the home frame is known.

        Raises `InputError` for a damaged state.
        """
        memory = Memory.of(state)
        pair, home = outcome.pair, outcome.home_from_reference
        try:
            both = _as_matched(sides(pair), outcome.matches)
        except NoRegistration:
            return memory.state()
        learned = none()
        table = posterior(memory.counts)
        for side, seen in zip(both, _all_evidence(pair, both, memory, home), strict=True):
            counted = seen[side.covered]
            real, landmark = look_up(table, counted).T
            more = tempered(count(counted, real, landmark), len(counted))
            learned = {node: learned[node] + more[node] for node in learned}
        memory = memory.with_counts(learned)
        if home is not None:
            xy, step, reference_from_home = pair.source_in_reference, both[1].planting.step, home.inverse()
            ground = footprint(xy, step)
            memory = memory.with_trees(home(xy), step, lambda at: ground.covers(reference_from_home(at)))
        return memory.state()

    def export(self, state: State) -> Mapping[str, str]:
        """`bn_landmarks.xml`: the network with what was learned, in the XML Bayesian interchange format."""
        return {f"{NAME}.xml": xmlbif(Memory.of(state).counts)}


def probabilities(pair: Pair, context: Context) -> tuple[FloatArray, FloatArray]:
    """P(landmark) of every tree of the reference (n,) and of the source (m,).

    Raises `NoRegistration` for surveys of fewer than three trees that stand apart, `InputError` for a damaged memory.
    """
    return _probabilities(pair, sides(pair, context.threads), context)


def _probabilities(
    pair: Pair, both: tuple[Side, Side], context: Context, partners: bool = True
) -> tuple[FloatArray, FloatArray]:
    """P(landmark) of all trees; without `partners`, what stands there in the other survey counts as unknown."""
    memory = Memory.of(context.memory.get(NAME, {}))
    table = posterior(memory.counts)
    reference, source = _all_evidence(pair, both, memory, context.home_from_reference)
    if not partners:
        reference, source = partners_unknown(reference), partners_unknown(source)
    return look_up(table, reference)[:, 1], look_up(table, source)[:, 1]


def evidence_of(pair: Pair, state: State, home_from_reference: Affine | None) -> tuple[IntArray, IntArray]:
    """The evidence on the trees of both surveys, (n, nodes) and (m, nodes), as classes of `structure.EVIDENCE`."""
    return _all_evidence(pair, sides(pair), Memory.of(state), home_from_reference)


def _all_evidence(
    pair: Pair, both: tuple[Side, Side], memory: Memory, home: Affine | None
) -> tuple[IntArray, IntArray]:
    reference, source = both
    rows = (pair.rows.reference, pair.rows.source) if pair.rows else (None, None)
    return (
        evidence(reference, source, rows[0], memory.earlier(reference.xy, home, reference.planting.step)),
        evidence(source, reference, rows[1], memory.earlier(source.xy, home, source.planting.step)),
    )


def _as_matched(both: tuple[Side, Side], matches: IntArray) -> tuple[Side, Side]:
    """The sides with the judge's pairs as the mutual partners, and no others."""
    at = [side.features.positions(ids) for side, ids in zip(both, matches.T, strict=True)]
    known = (at[0] >= 0) & (at[1] >= 0)
    matched = []
    for side, mine, theirs in ((both[0], at[0][known], at[1][known]), (both[1], at[1][known], at[0][known])):
        partner, mutual = side.partner.copy(), np.zeros(len(side.xy), dtype=bool)
        partner[mine], mutual[mine] = theirs, True
        matched.append(replace(side, partner=partner, mutual=mutual))
    return matched[0], matched[1]
