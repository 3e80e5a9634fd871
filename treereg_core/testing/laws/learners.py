"""Laws on methods that learn from accepted registrations."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.learning import Learner, Outcome, State
from treereg_core.method import Context
from treereg_core.pair import Pair, Rows
from treereg_core.simulate import Simulation
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import ordinary, row_of_trees, true_rows
from treereg_core.testing.using import NO_MATCHES, plain, seen, suited, use
from treereg_core.transform import Rigid

HOME = Rigid.turn(3.0, shift=(343_000.0, 6_306_000.0))


@law
def what_it_learned_is_json(method: Learner) -> None:
    """Mappings with text keys, lists, finite numbers, texts: what comes back from a file is what went into it."""
    for state in lessons(method):
        require(json.loads(json.dumps(state, allow_nan=False)) == state, "its state is another one after JSON")


@law
def learning_changes_nothing_it_is_given(method: Learner) -> None:
    """Neither the outcome nor the state so far: what is new is returned."""
    outcome, state = pickle.loads(pickle.dumps(outcome_of(1))), lessons(method)[0]
    before = plain(outcome), json.dumps(state)
    method.learn(outcome, state)
    require(plain(outcome) == before[0], "the outcome was changed")
    require(json.dumps(state) == before[1], "the state so far was changed")


@law
def learning_is_repeatable(method: Learner) -> None:
    """The same outcomes give the same state, by a copy of the method too, and whatever was learned in between."""
    first = lessons(method)
    require(lessons(pickle.loads(pickle.dumps(method))) == first, "the same outcomes gave another state")


@law
def a_place_that_is_not_known_is_no_obstacle(method: Learner) -> None:
    """It learns where the first reference's frame is not known, where no rows were matched, and from no matches."""
    outcome = outcome_of(0)
    for poor in (
        replace(outcome, home_from_reference=None),
        replace(outcome, pair=replace(outcome.pair, rows=None)),
        replace(outcome, matches=NO_MATCHES),
    ):
        json.dumps(method.learn(poor, {}), allow_nan=False)


@law
def what_it_learned_is_of_use(method: Any) -> None:
    """It works with what it learned as without, whether the place of the reference is known or not."""
    pair = suited(method, ordinary())
    refused = seen(use(method, pair)).refused
    for home in (HOME, None):
        context = Context(memory={method.name: lessons(method)[-1]}, home_from_reference=home)
        require(seen(use(method, pair, context)).refused == refused, "with what it learned it refuses")


@law
def its_exports_are_texts(method: Learner) -> None:
    """What it gives other programs is text by the name of a file."""
    for name, text in method.export(lessons(method)[-1]).items():
        require(isinstance(name, str) and not set(name) & set("/\\:"), f"{name!r} is not the name of a file")
        require(isinstance(text, str), f"{name} is not a text")


def lessons(method: Learner) -> list[State]:
    """What a method knows after one and after two accepted registrations of one orchard, as it comes from a file."""
    first = method.learn(outcome_of(0), {})
    return [first, method.learn(outcome_of(1), json.loads(json.dumps(first, allow_nan=False)))]


@cache
def outcome_of(date: int) -> Outcome:
    """The true outcome for an ordinary orchard at one of several dates, with all rows matched; trees move a little."""
    simulation = ordinary()
    rows = true_rows(simulation)
    ours = numbers(simulation, simulation.reference, rows.reference)
    theirs = numbers(simulation, simulation.source, rows.source)
    matches = [(i, theirs.index(number)) for i, number in enumerate(ours) if number in theirs]
    moved = simulation.source.xy + np.random.default_rng(date).normal(0, 0.05, simulation.source.xy.shape)
    truth = simulation.truth or Rigid.identity()
    pair = Pair(
        simulation.reference, simulation.source.replace(xy=moved), truth, replace(rows, matches=np.array(matches))
    )
    return Outcome(pair, simulation.true_pairs(), HOME)


def numbers(simulation: Simulation, features: FeatureSet, rows: Rows) -> list[int]:
    """The true number of each row of one survey."""
    row_of = row_of_trees(simulation, features)
    return [row_of[int(row[0])] for row in rows.trees]
