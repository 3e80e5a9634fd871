"""Ranking: for each offset of the rows the assignment of greatest probability, and what speaks for it in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from treereg_bn_rows import evidence
from treereg_bn_rows.assignment import in_order
from treereg_bn_rows.looks import Look
from treereg_bn_rows.network import Posterior
from treereg_core.features import IntArray

USUAL_ALONG, USUAL_ACROSS = 2.0, 2.0
"""How far starts usually are off, along in in-row spacings, across in row distances."""
HALF_TURN = 3.0
"""How much less likely it is that a start is off by a half turn too: log-odds."""


@dataclass(frozen=True, eq=False)
class Ranked:
    """A look and the states of all its signs; `matches` (k, 2), the rows assigned to each other.

    Log-odds: `profile`, what the rows say for the placement; `total`, with what single trees say and how strange it is.
    """

    look: Look
    states: dict[str, IntArray]
    matches: IntArray
    profile: float
    total: float


def ranked(looked: Sequence[Look], known: Posterior) -> list[Ranked]:
    """The best placement of each offset, likeliest first."""
    first = [_assigned(look, {**look.states, "context": _context(look, known)}, known) for look in looked]
    best: dict[int, Ranked] = {}
    for found in first:
        held = best.setdefault(found.look.placed.offset, found)
        if found.total > held.total:
            best[found.look.placed.offset] = found
    order = sorted(best.values(), key=lambda found: -found.total)
    return [_in_field(found, order, known) for found in order]


def _context(look: Look, known: Posterior) -> IntArray:
    return evidence.context(look.pairs, 1 / (1 + np.exp(-known.log_odds(look.states))))


def _in_field(found: Ranked, others: Sequence[Ranked], known: Posterior) -> Ranked:
    """The same placement with rows assigned by what the whole field says too; what speaks for it stays."""
    rivals = [other.total for other in others if other is not found]
    advantage = found.total - max(rivals) if rivals else np.inf
    states = {**found.states, "field": evidence.field(advantage, len(found.look.pairs.i))}
    again = _assigned(found.look, states, known)
    return Ranked(found.look, states, again.matches, found.profile, found.total)


def _assigned(look: Look, states: dict[str, IntArray], known: Posterior) -> Ranked:
    """The most probable assignment in order by these states."""
    pairs = look.pairs
    log_odds = np.full((len(pairs.reference), len(pairs.source)), -np.inf)
    log_odds[pairs.i, pairs.j] = known.log_odds(states)
    i, j = in_order(log_odds).T
    matches = np.column_stack([pairs.reference.rows[i], pairs.source.rows[j]])
    matches = matches[np.argsort(matches[:, 0])]
    profile = float(log_odds[i, j].sum())
    return Ranked(look, states, matches, profile, profile + look.placed.trees - _strangeness(look))


def _strangeness(look: Look) -> float:
    """How unusual it is that a start was off by so much: minus the logarithm of its probability."""
    placed = look.placed
    off = placed.along / (USUAL_ALONG * look.spacing), placed.across / (USUAL_ACROSS * look.distance)
    return (off[0] ** 2 + off[1] ** 2) / 2 + HALF_TURN * placed.sense
