"""Ranking: for each offset of the rows the assignment of greatest probability, and what speaks for it in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from treereg_bn_rows import evidence
from treereg_bn_rows.assignment import in_order
from treereg_bn_rows.looks import Look
from treereg_bn_rows.network import Posterior
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

USUAL_ALONG, USUAL_ACROSS = 2.0, 2.0
"""How far starts usually are off, along in in-row spacings, across in rows."""
HALF_TURN = 3.0
"""How much less likely it is that a start is off by a half turn too: log-odds."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """A look and the states of its signs; `matches` (k, 2), the rows of reference and source assigned to each other.

    Log-odds: `profile`, what the rows say for the placement; `total`, with what single trees say and how strange it is.
    """

    look: Look
    states: dict[str, IntArray]
    matches: IntArray
    profile: float
    total: float


def ranked(looked: Sequence[Look], known: Posterior) -> list[Ranked]:
    """The best placement of each offset, likeliest first."""
    best: dict[int, Ranked] = {}
    for look in looked:
        held = best.get(look.placed.offset)
        found = _assigned(look, known, -np.inf if held is None else held.total)
        if found is not None and (held is None or found.total > held.total):
            best[look.placed.offset] = found
    order = sorted(best.values(), key=lambda found: -found.total)
    return [_in_field(found, order, known) for found in order]


def _assigned(look: Look, known: Posterior, least: float) -> Ranked | None:
    """A look with its rows assigned by all signs but the field; None when its total cannot be above `least`."""
    probability = 1 / (1 + np.exp(-known.log_odds(look.states)))
    states = {**look.states, "context": evidence.context(look.pairs, probability)}
    log_odds = known.log_odds(states)
    others = look.placed.trees - _strangeness(look)
    # no assignment is better than each row's best partner
    most = np.zeros(len(look.pairs.reference))
    np.maximum.at(most, look.pairs.i, log_odds)
    if most.sum() + others <= least:
        return None
    matches, profile = _in_order(look, log_odds)
    return Ranked(look, states, matches, profile, profile + others)


def _in_field(found: Ranked, others: Sequence[Ranked], known: Posterior) -> Ranked:
    """The same with the state of the field, and with the rows assigned that are the same if the placement is right.

    Which one is right is for the judge: so no placement's field speaks against its rows.
    """
    rivals = [other.total for other in others if other is not found]
    advantage = found.total - max(rivals) if rivals else np.inf
    shown, assumed = (
        {**found.states, "field": evidence.field(value, len(found.look.pairs.i))}
        for value in (advantage, max(advantage, 0.0))
    )
    matches, _ = _in_order(found.look, known.log_odds(assumed))
    return replace(found, states=shown, matches=matches)


def _in_order(look: Look, log_odds: FloatArray) -> tuple[IntArray, float]:
    """The most probable assignment (k, 2), and the sum of its log-odds."""
    pairs = look.pairs
    chosen = in_order(pairs.i, pairs.j, log_odds)
    matches = look.rows[chosen]
    return matches[np.argsort(matches[:, 0])], float(log_odds[chosen].sum())


def _strangeness(look: Look) -> float:
    """How unusual it is that a start was off by so much: minus the logarithm of its probability."""
    placed = look.placed
    off = placed.along / (USUAL_ALONG * look.spacing), placed.across / (USUAL_ACROSS * look.apart)
    return (off[0] ** 2 + off[1] ** 2) / 2 + HALF_TURN * placed.sense
