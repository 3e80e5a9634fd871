"""Laws on feature filters."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np

from treereg_core.description import checked
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context, Described, FeatureFilter
from treereg_core.pair import Pair, Rows
from treereg_core.testing.law import LawSkipped, law, require
from treereg_core.testing.scenes import degenerate, line, ordinary, shuffled, true_rows
from treereg_core.testing.using import CONTEXT, plain, seen, suited, use
from treereg_core.transform import Rigid

ROUNDING = 1e-6
"""What another order of sums may change in a number of the size of a probability."""


@law
def it_keeps_a_subset(method: FeatureFilter) -> None:
    """It invents no tree and changes nothing of a tree but its weight, which stays finite and not negative.

    It may add attributes of its own; see `what_it_adds_to_both_surveys_ignores_the_placement`.
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
def what_it_adds_to_both_surveys_ignores_the_placement(method: FeatureFilter) -> None:
    """An attribute of both surveys is evidence for a placement, so a placement must not make it."""
    pair = suited(method, ordinary())
    away = Rigid.turn(30.0, about=pair.reference.xy.mean(axis=0)) @ pair.reference_from_source
    one, two = use(method, pair), use(method, pair.at(away))
    if not isinstance(one, Pair) or not isinstance(two, Pair):
        raise LawSkipped("it refuses one of two placements")
    for name in added(one, pair) & added(two, pair):
        for side in ("reference", "source"):
            a, b = by_id(getattr(one, side), name), by_id(getattr(two, side), name)
            changed = any(abs(a[tree] - b[tree]) > ROUNDING for tree in a.keys() & b.keys())
            require(not changed, f"{side}: {name} depends on the placement; say it in `describe`")


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


@law
def it_describes_each_tree_by_a_number(method: FeatureFilter) -> None:
    """What it knows of trees is one finite number for each, whatever the trees, under a name fit for a property."""
    simulation = ordinary()
    pair = suited(method, simulation)
    for each in (pair, replace(pair, rows=true_rows(simulation)), line(), *degenerate().values()):
        described(method, each)


@law
def describing_changes_nothing(method: FeatureFilter) -> None:
    """Neither the pair nor, when it is asked again or with more threads, a bit of the answer."""
    pair = pickle.loads(pickle.dumps(suited(method, ordinary())))
    before = plain(pair)
    one, two = (plain(described(method, pair, Context(threads=threads))) for threads in (1, 2))
    require(plain(pair) == before, "the pair was changed")
    require(one == two, "asked again, with 2 threads, it says something else")


@law
def describing_ignores_the_order_of_trees(method: FeatureFilter) -> None:
    """Trees in another order, with their ids, are described the same."""
    pair = suited(method, ordinary())
    other = shuffled(pair)
    sides = (pair.reference, pair.source), (other.reference, other.source)
    for one, two, a, b in zip(*sides, described(method, pair), described(method, other), strict=True):
        require(a.keys() == b.keys(), "with the trees in another order it describes something else")
        for name in a:
            same = np.abs(a[name][one.positions(two.ids)] - b[name]).max() <= ROUNDING
            require(same, f"with the trees in another order {name} is another one")


def described(method: FeatureFilter, pair: Pair, context: Context = CONTEXT) -> Described:
    """What a filter knows of the trees of a pair, checked; nothing when it refuses."""
    try:
        return checked(method.describe(pair, context), pair)
    except NoRegistration:
        return {}, {}


def added(result: Pair, given: Pair) -> set[str]:
    """The attributes that both surveys of a result have, and that were not given."""
    both = result.reference.attributes.keys() & result.source.attributes.keys()
    return both - (given.reference.attributes.keys() & given.source.attributes.keys())


def by_id(features: FeatureSet, name: str) -> dict[int, float]:
    """An attribute of each tree by its id."""
    return dict(zip(features.ids.tolist(), features.attributes[name].tolist(), strict=True))


def require_subset(kept: FeatureSet, given: FeatureSet, name: str) -> None:
    """Require every kept tree to be one of the given ones, the same but for its weight and further attributes."""
    at = given.positions(kept.ids)
    require((at >= 0).all(), f"{name}: a tree was invented")
    require((kept.weight >= 0).all(), f"{name}: a weight is negative")
    attributes = {key: values for key, values in kept.attributes.items() if key in given.attributes}
    same = plain(kept.replace(attributes=attributes)) == plain(given.take(at).replace(weight=kept.weight))
    require(same, f"{name}: a tree was changed")
