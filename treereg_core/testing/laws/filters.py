"""Laws on feature filters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.method import FeatureFilter
from treereg_core.pair import Pair, Rows
from treereg_core.testing.law import LawSkipped, law, require
from treereg_core.testing.scenes import degenerate, ordinary, true_rows
from treereg_core.testing.using import plain, seen, suited, use


@law
def it_keeps_a_subset(method: FeatureFilter) -> None:
    """It invents no tree and changes nothing of a tree but its weight, which stays finite and not negative.

    It may add attributes of its own.
    """
    pairs = {"an ordinary orchard": suited(method, ordinary()), **degenerate()}
    for name, pair in pairs.items():
        result = use(method, pair)
        if isinstance(result, Pair):
            require_subset(result.reference, pair.reference, f"{name}, reference")
            require_subset(result.source, pair.source, f"{name}, source")


@law
def it_leaves_trees_to_work_with(method: FeatureFilter) -> None:
    """Of an ordinary orchard some trees are left in both surveys: 3 at least."""
    result = use(method, suited(method, ordinary()))
    require(isinstance(result, Pair), f"it refused: {result}")
    left = min(len(result.reference), len(result.source))
    require(left >= 3, f"only {left} trees are left of {len(ordinary().source)}")


@law
def it_moves_nothing(method: FeatureFilter) -> None:
    """The placement is not a filter's to change."""
    pair = suited(method, ordinary())
    result = use(method, pair)
    require(result.reference_from_source == pair.reference_from_source, "the placement was changed")


@law
def rows_keep_their_order(method: FeatureFilter) -> None:
    """Detected rows lose the trees that were filtered out, and nothing else happens to them."""
    rows = true_rows(ordinary())
    matches = np.column_stack([np.arange(5), np.arange(5)])
    pair = replace(suited(method, ordinary()), rows=replace(rows, matches=matches))
    result = use(method, pair)
    require(result.rows is not None, "the rows are gone")
    require(np.array_equal(result.rows.matches, matches), "the matches of rows were changed")
    for side, kept in (("reference", result.reference), ("source", result.source)):
        before: Rows = getattr(rows, side)
        after: Rows = getattr(result.rows, side)
        require(plain(after) == plain(before.keep(kept.ids)), f"{side}: other rows than what was kept of them")


@law
def a_filter_of_one_survey_ignores_the_other(method: FeatureFilter) -> None:
    """One that says it does not need the pair gives the same trees whatever the other survey is."""
    if method.needs_pair:
        raise LawSkipped("it looks at both surveys")
    pair = suited(method, ordinary())
    one, two = Pair(pair.reference, pair.reference), Pair(pair.source, pair.source)
    expected = seen(use(method, one)).weights[0], seen(use(method, two)).weights[0]
    require(seen(use(method, pair)).weights == expected, "beside another survey it keeps other trees")


def require_subset(kept: FeatureSet, given: FeatureSet, name: str) -> None:
    """Require every kept tree to be one of the given ones, the same but for its weight and further attributes."""
    at = given.positions(kept.ids)
    require((at >= 0).all(), f"{name}: a tree was invented")
    require((kept.weight >= 0).all(), f"{name}: a weight is negative")
    attributes = {key: values for key, values in kept.attributes.items() if key in given.attributes}
    same = plain(kept.replace(attributes=attributes)) == plain(given.take(at).replace(weight=kept.weight))
    require(same, f"{name}: a tree was changed")
