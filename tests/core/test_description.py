"""Descriptions: what filters say of all trees at the judged placement, and what is made of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.core.methods import METHODS, Columns
from treereg_core.api import execute
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.learning import Learner, Outcome, State
from treereg_core.method import Context, Described, FeatureFilter
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import Entry, Registry
from treereg_core.result import Result
from treereg_core.rows import NearestRows
from treereg_core.simulate import Scene, Simulation, simulate

CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=0.2, rotation_sd=0.1)
ASKED: list[tuple[Pair, Context]] = []


class Telling(FeatureFilter, Learner):
    """Says of each tree how near the other survey's nearest one is, and of the source what it knew before."""

    name = "telling"

    def select(self, pair: Pair, context: Context) -> Pair:
        return pair

    def describe(self, pair: Pair, context: Context) -> Described:
        ASKED.append((pair, context))
        near = FeatureSet.of(pair.source_in_reference).tree.query(pair.reference.xy)[0]
        lessons = context.memory.get(self.name, {}).get("lessons", 0)
        return {"near": near}, {"lessons": np.full(len(pair.source), float(lessons))}

    def learn(self, outcome: Outcome, state: State) -> State:
        return {"lessons": state.get("lessons", 0) + 1}


class Odd(Telling):
    """Says what no filter should."""

    name = "odd"
    what: str = "twice"

    def describe(self, pair: Pair, context: Context) -> Any:
        n, m = len(pair.reference), len(pair.source)
        match self.what:
            case "raise":
                raise RuntimeError("it\nbroke")
            case "refuse":
                raise NoRegistration("nothing to say")
            case "twice":
                return {"near": np.full(n, -1.0)}, {"far": np.ones(m)}
            case "short":
                return {"near": np.zeros(n - 1)}, {}
            case "nan":
                return {}, {"near": np.full(m, np.nan)}
            case "name":
                return {"No Name": np.zeros(n)}, {}
            case "own":
                return {}, {"confidence": np.zeros(m)}
        return {"near": np.zeros(n)}


class RowsOfAll(NearestRows):
    name = "rows_of_all"


@pytest.fixture(autouse=True)
def _forget() -> None:
    ASKED.clear()


@pytest.fixture(scope="module")
def orchard() -> Simulation:
    return simulate(CLEAR, 4)


def run(surveys: Simulation, method: str = "telling+nearest", **options: Any) -> Result:
    registry = Registry(tuple(Entry(m.name, m.role, "test", "1.0", m) for m in (*METHODS, Telling, Odd, RowsOfAll)))
    given = {"method": method, "start": "identity", "threads": 1, **options}
    return execute(plan_for(Options(**given), registry), (surveys.reference, surveys.source), Clock())


def test_all_usable_trees_are_described_at_the_placement_that_was_found(orchard: Simulation) -> None:
    result = run(orchard, "sure+telling+nearest", settings={"sure": {"least": 0.6}})
    assert result.accepted
    reference, source = result.described
    assert (list(reference), list(source)) == (["near"], ["lessons"])
    assert reference["near"].shape == (len(orchard.reference),)
    assert not reference["near"].flags.writeable
    ((pair, _),) = ASKED
    assert pair.reference_from_source == result.transform
    assert len(pair.source) == len(orchard.source)
    assert set(result.timings) == {"start", "sure", "telling", "nearest", "judge"}


def test_a_placement_in_doubt_is_described_too_and_none_is_not(orchard: Simulation) -> None:
    doubtful = run(orchard, max_failure=0.0)
    assert not doubtful.accepted
    assert "near" in doubtful.described[0]
    strange = simulate(CLEAR.model_copy(update={"same_orchard": False}), 9)
    ASKED.clear()
    failed = run(strange)
    assert failed.transform is None
    assert failed.described == ({}, {})
    assert not ASKED


def test_methods_that_say_nothing_leave_nothing(orchard: Simulation) -> None:
    result = run(orchard, "sure+nearest")
    assert (result.described, result.warnings) == (({}, {}), ())


def test_of_two_filters_with_one_name_the_later_counts(orchard: Simulation) -> None:
    reference, source = run(orchard, "telling+odd+nearest").described
    assert set(reference["near"]) == {-1.0}
    assert list(source) == ["lessons", "far"]


def test_what_is_said_is_what_was_known_before_this_lesson(orchard: Simulation, tmp_path: Path) -> None:
    for _ in range(2):
        result = run(orchard, memory=tmp_path)
        assert set(result.described[1]["lessons"]) == {0.0}


def test_rows_are_those_of_the_stages_where_all_trees_were_looked_at(orchard: Simulation) -> None:
    settings = {"columns": {"width": 1.0}}
    run(orchard, "columns+rows_of_all+sure+telling+nearest", settings=settings | {"sure": {"least": 0.6}})
    run(orchard, "telling+columns+rows_of_all+nearest", settings=settings)
    (behind, _), (before, _) = ASKED
    assert behind.rows is not None
    whole = Columns(width=1.0).detect(orchard.reference, Context())
    assert [row.tolist() for row in behind.rows.reference.trees] == [row.tolist() for row in whole.trees]
    assert before.rows is None


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("raise", "RuntimeError: it broke"),
        ("short", "near has shape"),
        ("nan", "near holds a number that is not finite"),
        ("name", "'No Name' cannot be the name"),
        ("own", "'confidence' cannot be the name"),
        ("one", "ValueError"),
    ],
)
def test_a_filter_that_cannot_describe_costs_no_registration(what: str, words: str, orchard: Simulation) -> None:
    result = run(orchard, "telling+odd+nearest", settings={"odd": {"what": what}})
    assert result.accepted
    (warning,) = result.warnings
    assert warning.startswith("odd could not describe the trees (")
    assert words in warning
    assert "near" in result.described[0]


def test_a_filter_with_nothing_to_say_is_no_fault(orchard: Simulation) -> None:
    result = run(orchard, "odd+nearest", settings={"odd": {"what": "refuse"}})
    assert (result.accepted, result.described, result.warnings) == (True, ({}, {}), ())
