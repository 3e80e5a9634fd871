"""The row matcher `bn_rows`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from pydantic import Field

from treereg_bn_rows.counts import counted, mixed, updated
from treereg_bn_rows.lessons import lessons
from treereg_bn_rows.looks import looks
from treereg_bn_rows.network import posterior, xmlbif
from treereg_bn_rows.ranking import Ranked, ranked
from treereg_bn_rows.structure import NETWORK
from treereg_core.errors import NoRegistration
from treereg_core.learning import Learner, Outcome, State
from treereg_core.method import Context, RowMatcher
from treereg_core.pair import Pair
from treereg_core.row_lines import RowLines
from treereg_core.row_matching import match_rows
from treereg_core.row_trees import along_rows

WORSE, WORSE_PROFILE = 30.0, 10.0
"""Placements are handed on when these log-odds, of rows and trees, or of rows alone, are all that the best is ahead."""


class BnRows(RowMatcher, Learner):
    """Rows by a Bayesian network, in their order across the field (treereg's founding proposal, section 3.3.2).

    For every offset of up to three rows to both sides, and for the half turn of each, the rows of the source are laid
    on those of the reference and slid along. Under each such placement the network says how probable it is that two
    rows are the same, from how far they lie apart, their direction, where they begin and end, their length, their
    number of trees, trees that stand opposite gaps, the rows beside them, and the field as a whole.

    Of all assignments that keep the rows' order it takes the most probable one. The placement that its rows and their
    trees speak for comes first; others that are hardly worse follow, for the judge to choose.

    Good when the start may be a few rows off, or a half turn, as long as rows run within some degrees of each other.
    What an accepted registration shows of the orchard's rows is counted, and mixed with what simulated orchards taught.
    """

    name = "bn_rows"
    network = NETWORK

    offsets: float = Field(
        3.0,
        ge=0,
        le=20,
        description="how far across the start may be off",
        json_schema_extra={"unit": "rows"},
    )
    placements: int = Field(5, ge=1, le=50, description="how many placements are handed on at most")

    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """The likeliest placement with its rows, and its rivals when the rows leave a choice; each fitted to trees.

        Raises `NoRegistration` when a survey has no rows, when they cross those of the other or lie elsewhere, or when
        too few trees of matched rows meet, and `InputError` when the memory is damaged.
        """
        known = posterior(mixed(context.memory.get(self.name, {})))
        return _handed_on(pair, ranked(looks(pair, self.offsets, context), known), self.placements, context)

    def learn(self, outcome: Outcome, state: State) -> State:
        """The state with the counts of this outcome's rows, the same and not; older ones weigh four fifths.

        Nothing is learned from an outcome without rows. Raises `InputError` when the state is damaged.
        """
        tables = mixed(state)
        rows = outcome.pair.rows
        if rows is None:
            return state
        try:
            found = ranked(looks(outcome.pair, self.offsets, Context()), posterior(tables))
        except NoRegistration:
            return state
        lesson = lessons(found, rows, outcome.matches)
        return updated(state, counted(lesson.states, lesson.same))

    def export(self, state: State) -> Mapping[str, str]:
        """The network with what is known as XMLBIF."""
        return {f"{self.name}.xml": xmlbif(mixed(state))}


def _handed_on(pair: Pair, found: Sequence[Ranked], most: int, context: Context) -> tuple[Pair, ...]:
    """The pair with each of these placements' rows, at the fit to their trees, less those that are far less likely."""
    results: list[Pair] = []
    reason = NoRegistration("no rows of the two surveys are the same")
    best = found[0]
    for one in found:
        if len(results) == most:
            break
        if one.total < best.total - WORSE and one.profile < best.profile - WORSE_PROFILE:
            continue
        try:
            results.append(_fitted(pair, one, context))
        except NoRegistration as refusal:
            reason = refusal
    if not results:
        raise reason
    return tuple(results)


def _fitted(pair: Pair, one: Ranked, context: Context) -> Pair:
    """The pair with its rows matched as under this placement, at the fit to their trees."""
    assert pair.rows is not None
    matched = replace(pair, rows=replace(pair.rows, matches=one.matches))
    fitted = matched.at(along_rows(matched.at(one.look.placed.transform), context).transform)
    lengthwise = one.look.pairs.reference.rows, one.look.pairs.source.rows
    if len(lengthwise[0]) == len(pair.rows.reference) or len(lengthwise[1]) == len(pair.rows.source):
        return fitted
    # rows across the others, as on headlands, have no order among them: they are matched by where they lie
    lines = RowLines.of(pair.rows.reference, pair.reference), RowLines.of(pair.rows.source, pair.source)
    near = match_rows(*lines, fitted.reference_from_source)
    crosswise = ~np.isin(near[:, 0], lengthwise[0]) & ~np.isin(near[:, 1], lengthwise[1])
    matches = np.unique(np.concatenate([one.matches, near[crosswise]]), axis=0)
    return replace(fitted, rows=replace(pair.rows, matches=matches))
