"""The fold over stages."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest

from tests.core.methods import Columns, Nearest, SameRows, Sure, orchard
from treereg_core import register
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.judgement import Verdict
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock, Pipeline
from treereg_core.transform import Model, Rigid

CONTEXT = Context()
MOVE = Rigid.turn(1.0, about=(12, 30), shift=(0.4, -0.7))


@pytest.fixture
def pair() -> Pair:
    """The same orchard twice; the source is misplaced by the inverse of MOVE and stands in reverse order."""
    reference = orchard()
    order = np.arange(len(reference))[::-1]
    source = FeatureSet.of(MOVE.inverse()(reference.xy)[order], reference.confidence[order], reference.area[order])
    return Pair(reference, source)


@pytest.mark.parametrize(
    "stages",
    [
        [Nearest()],
        [Nearest(), Nearest()],
        [Sure(), Nearest()],
        [Columns(), Nearest()],
        [Columns(), Sure(), Nearest()],
        [Columns()],
        [Sure(), Columns()],
    ],
)
def test_every_kind_of_pipeline_finds_the_placement(pair: Pair, stages: list[object]) -> None:
    found = Pipeline.of(stages).register(pair, CONTEXT)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.transform(pair.source.xy), MOVE(pair.source.xy), atol=1e-6)
    assert (found.pairs[:, 0] == len(pair.reference) - 1 - found.pairs[:, 1]).all()
    assert len(found.pairs) >= 50


def test_filters_narrow_what_later_stages_see(pair: Pair) -> None:
    found = Pipeline.of([Sure(least=0.8), Nearest()]).register(pair, CONTEXT)
    assert 0 < len(found.pairs) == (pair.source.confidence >= 0.8).sum()
    assert (pair.reference.confidence[found.pairs[:, 0]] >= 0.8).all()


def test_rows_of_the_same_trees_are_detected_once_for_several_starts(pair: Pair) -> None:
    said: list[str] = []
    clock = Clock()
    starts = [pair, pair.at(Rigid.turn(0.5)), pair.at(MOVE)]
    found = Pipeline.of([Sure(), Columns(), Nearest()]).registrations(starts, Context(progress=said.append), clock)
    assert len(found) == 3
    assert said.count("detect") == 2
    assert set(clock.seconds) == {"sure", "columns", "nearest_rows", "nearest"}


def test_a_start_that_gives_nothing_is_dropped_and_said(pair: Pair) -> None:
    said: list[str] = []
    starts = [pair.at(Rigid.turn(0, shift=(1e4, 0))), pair]
    found = Pipeline.of([Nearest()]).registrations(starts, Context(progress=said.append))
    assert len(found) == 1
    assert "one start gave nothing: no point has a positive weight" in said
    assert Pipeline.of([Columns(), SameRows()]).registrations([pair], CONTEXT) == []
    with pytest.raises(NoRegistration, match="no rows are the same"):
        Pipeline.of([Columns(), SameRows(), Nearest()]).register(pair, CONTEXT)


def test_a_filter_that_leaves_nothing_is_no_crash(pair: Pair) -> None:
    for stages in ([Sure(least=1.0), Nearest()], [Sure(least=1.0), Columns()], [Columns(), Sure(least=1.0), Nearest()]):
        with pytest.raises(NoRegistration):
            Pipeline.of(stages).register(pair, CONTEXT)


def test_a_pipeline_is_a_value() -> None:
    one, other = Pipeline.of([Columns(), Nearest()]), Pipeline.of([Columns(), Nearest()])
    assert one == other
    assert pickle.loads(pickle.dumps(one)) == one
    assert [stage.name for stage in one.stages] == ["columns", "nearest_rows", "nearest"]
    assert one != Pipeline.of([Columns(width=4.0), Nearest()])


def test_the_model_is_the_contexts() -> None:
    reference = orchard()
    stretched = FeatureSet.of(reference.xy / 1.01)
    found = Pipeline.of([Columns()]).register(Pair(reference, stretched), Context(model=Model.SIMILARITY))
    assert found.transform.scale == pytest.approx(1.01)


def test_the_verdict_says_why_no_stage_found_anything() -> None:
    xy = np.random.default_rng(0).uniform(0, 60, (25, 2))
    said = register(xy, xy + np.array([1.0, 0.5]), method="aco").judgement
    assert said.verdict is Verdict.FAILED
    assert re.fullmatch(r"No placement was found [\w ]+: the 25 trees stand in no rows [\w ]+\.", said.reason)
