"""The fold over stages, and the default row matcher."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from tests.core.methods import Columns, Nearest, SameRows, Sure, orchard
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.pipeline import Clock, Pipeline
from treereg_core.rows import NearestRows, mutual_nearest, summed_distances, three_trees
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


def with_rows(pair: Pair) -> Pair:
    rows = [Columns().detect(features, CONTEXT) for features in (pair.reference, pair.source)]
    return Pair(
        pair.reference, pair.source, pair.reference_from_source, MatchedRows(rows[0], rows[1], np.empty((0, 2)))
    )


def test_the_default_row_matcher_matches_each_row_once_with_its_own(pair: Pair) -> None:
    (matched,) = NearestRows().match(with_rows(pair), CONTEXT)
    assert matched.rows is not None
    assert sorted(matched.rows.matches[:, 0]) == list(range(6))
    for i, j in matched.rows.matches:
        ours, theirs = matched.rows.reference.trees[i], matched.rows.source.trees[j]
        assert set(ours) == {len(pair.reference) - 1 - tree for tree in theirs}
    np.testing.assert_allclose(matched.reference_from_source.matrix, MOVE.matrix, atol=1e-6)


def test_rows_are_matched_in_either_sense_and_a_row_alone_stays_alone(pair: Pair) -> None:
    laid = with_rows(pair)
    assert laid.rows is not None
    reversed_rows = Rows(tuple(row[::-1] for row in laid.rows.source.trees[1:]))
    (matched,) = NearestRows().match(
        Pair(pair.reference, pair.source, rows=MatchedRows(laid.rows.reference, reversed_rows, np.empty((0, 2)))),
        CONTEXT,
    )
    assert matched.rows is not None
    assert len(matched.rows.matches) == 5
    np.testing.assert_allclose(matched.reference_from_source.matrix, MOVE.matrix, atol=1e-6)


def test_summed_distances_by_hand() -> None:
    reference = np.array([[[0, 0], [0, 3], [0, 6]]], dtype=float)
    source = np.array([[[1, 6], [1, 3], [1, 0]], [[0, 4], [0, 7], [0, 10]]], dtype=float)
    np.testing.assert_allclose(summed_distances(reference, source), [[3.0, 12.0]])


def test_empty_rows_and_no_rows() -> None:
    features = FeatureSet.of([[0, 0], [0, 3]])
    points = three_trees(Rows((np.array([], dtype=np.int64), np.array([0, 1]))), features, features.xy)
    assert np.isinf(points[0]).all()
    np.testing.assert_allclose(points[1], [[0, 0], [0, 3], [0, 3]])
    assert len(mutual_nearest(summed_distances(points, points))) == 1
    none = MatchedRows(Rows(()), Rows(()), np.empty((0, 2)))
    with pytest.raises(NoRegistration, match="0 trees of the matched rows"):
        NearestRows().match(Pair(features, features, rows=none), CONTEXT)


def test_the_model_is_the_contexts() -> None:
    reference = orchard()
    stretched = FeatureSet.of(reference.xy / 1.01)
    found = Pipeline.of([Columns()]).register(Pair(reference, stretched), Context(model=Model.SIMILARITY))
    assert found.transform.scale == pytest.approx(1.01)
