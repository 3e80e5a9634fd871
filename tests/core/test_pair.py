"""Pair and Rows: what flows through the stages."""

from __future__ import annotations

import pickle

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from treereg_core.features import FeatureSet
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.testing import scenes
from treereg_core.testing import strategies as some
from treereg_core.testing.using import plain
from treereg_core.transform import Affine, Rigid


def test_a_pair_begins_at_the_files_own_georeference() -> None:
    pair = Pair(FeatureSet.of([[0, 0]]), FeatureSet.of([[5, 5]]))
    assert pair.reference_from_source == Rigid.identity()
    assert pair.rows is None
    assert pair.source_in_reference.tolist() == [[5, 5]]


@given(some.pairs(), some.transforms())
def test_the_transform_is_applied_in_one_place(pair: Pair, other: Affine) -> None:
    assert np.array_equal(pair.source_in_reference, pair.reference_from_source(pair.source.xy))
    assert not pair.source_in_reference.flags.writeable
    there = pair.at(other)
    assert np.array_equal(there.source_in_reference, other(pair.source.xy))
    assert there.reference is pair.reference
    assert there.rows is pair.rows


@given(some.pairs(), st.data())
def test_narrowing_keeps_rows_in_order_and_drops_what_was_left_out(pair: Pair, data: st.DataObject) -> None:
    kept = [
        f.take(np.array(data.draw(st.lists(st.booleans(), min_size=len(f), max_size=len(f))), dtype=bool))
        for f in (pair.reference, pair.source)
    ]
    narrowed = pair.narrow(kept[0], kept[1])
    assert narrowed.reference is kept[0]
    assert narrowed.source is kept[1]
    assert narrowed.reference_from_source == pair.reference_from_source
    assert (narrowed.rows is None) == (pair.rows is None)
    if pair.rows and narrowed.rows:
        assert np.array_equal(narrowed.rows.matches, pair.rows.matches)
        before = (pair.rows.reference, pair.rows.source)
        for old, new, features in zip(before, (narrowed.rows.reference, narrowed.rows.source), kept, strict=True):
            assert len(new) == len(old)
            for row, left in zip(old.trees, new.trees, strict=True):
                assert left.tolist() == [tree for tree in row.tolist() if tree in features.ids.tolist()]


@given(some.pairs())
def test_it_pickles(pair: Pair) -> None:
    assert plain(pickle.loads(pickle.dumps(pair))) == plain(pair)


@given(some.pairs())
def test_swapping_and_shuffling_lose_nothing(pair: Pair) -> None:
    there_and_back = scenes.swapped(scenes.swapped(pair))
    np.testing.assert_allclose(there_and_back.source_in_reference, pair.source_in_reference, rtol=0, atol=1e-6)
    assert plain(there_and_back.rows) == plain(pair.rows)
    mixed = scenes.shuffled(pair)
    assert plain(mixed.source.take(mixed.source.positions(pair.source.ids))) == plain(pair.source)
    assert plain(mixed.reference.take(mixed.reference.positions(pair.reference.ids))) == plain(pair.reference)


def test_no_matches_have_the_shape_of_matches() -> None:
    assert MatchedRows(Rows(()), Rows(()), np.array([], dtype=np.int64)).matches.shape == (0, 2)
    assert len(Rows(())) == 0
