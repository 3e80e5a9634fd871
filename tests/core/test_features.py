"""FeatureSet: arrays that stay together and cannot be changed."""

from __future__ import annotations

import pickle
import signal
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from treereg_core.features import FeatureSet, frozen_array, largest, nearest
from treereg_core.testing import strategies as some
from treereg_core.testing.using import plain

THREE = FeatureSet.of([[0, 0], [0, 3], [4, 3]], [0.1, 0.5, 0.9], [2, 3, 4], height=[3.0, 3.5, 4.0])


def test_plain_arrays_get_defaults() -> None:
    features = FeatureSet.of([[0, 0], [1, 1]])
    assert features.ids.tolist() == [0, 1]
    assert features.confidence.tolist() == features.area.tolist() == features.weight.tolist() == [1, 1]
    assert len(FeatureSet.of([])) == 0


@given(st.lists(st.integers(0, 9), max_size=30), st.integers(0, 40))
def test_the_largest_come_first_and_equal_ones_in_their_order(values: list[int], count: int) -> None:
    in_order = sorted(range(len(values)), key=lambda k: (-values[k], k))
    assert largest(np.array(values, dtype=np.float64), count).tolist() == in_order[:count]


@given(some.feature_sets())
def test_nothing_can_be_changed(features: FeatureSet) -> None:
    for array in (features.ids, features.xy, features.confidence, features.area, features.weight):
        assert not array.flags.writeable
    with pytest.raises(AttributeError):
        features.xy = np.zeros((0, 2))  # type: ignore[misc]
    with pytest.raises(TypeError):
        features.attributes["height"] = np.zeros(len(features))  # type: ignore[index]


def test_the_arrays_given_are_copied() -> None:
    xy = np.zeros((2, 2))
    features = FeatureSet.of(xy)
    xy += 1
    assert features.xy.tolist() == [[0, 0], [0, 0]]
    frozen = frozen_array(xy)
    assert frozen_array(frozen) is frozen


@given(some.feature_sets(), st.data())
def test_take_keeps_each_tree_together_and_positions_finds_it(features: FeatureSet, data: st.DataObject) -> None:
    order = data.draw(st.permutations(range(len(features))))
    chosen = np.array(order[: data.draw(st.integers(0, len(features)))], dtype=np.int64)
    taken = features.take(chosen)
    at = features.positions(taken.ids)
    assert at.tolist() == chosen.tolist()
    assert plain(features.take(at)) == plain(taken)
    absent = range(10_001, 10_004)
    assert features.positions(list(absent)).tolist() == [-1, -1, -1]
    assert taken.positions(features.ids).tolist() == [
        chosen.tolist().index(k) if k in chosen else -1 for k in range(len(features))
    ]


def test_take_by_mask_and_attributes_follow() -> None:
    tall = THREE.take(THREE.attributes["height"] > 3.2)
    assert tall.ids.tolist() == [1, 2]
    assert tall.attributes["height"].tolist() == [3.5, 4.0]
    assert tall.xy.tolist() == [[0, 3], [4, 3]]


def test_replace_changes_what_is_named_and_nothing_else() -> None:
    weighted = THREE.replace(weight=THREE.confidence)
    assert weighted.weight.tolist() == [0.1, 0.5, 0.9]
    assert THREE.weight.tolist() == [1, 1, 1]
    assert plain(weighted.replace(weight=THREE.weight)) == plain(THREE)


@given(some.feature_sets())
def test_it_pickles(features: FeatureSet) -> None:
    assert plain(pickle.loads(pickle.dumps(features))) == plain(features)
    again = pickle.loads(pickle.dumps(THREE))
    assert plain(again) == plain(THREE)
    assert not again.xy.flags.writeable


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"xy": np.zeros((2, 2))}, r"xy has shape \(2, 2\), but there are 3 trees"),
        ({"xy": np.zeros((3, 3))}, "xy has shape"),
        ({"confidence": [0.5, np.nan, 0.5]}, "confidence holds a number that is not finite"),
        ({"area": [1, np.inf, 1]}, "area holds a number that is not finite"),
        ({"ids": [4, 5, 4]}, "ids repeat"),
        ({"weight": [1.0]}, "weight has shape"),
        ({"attributes": {"height": np.zeros(2)}}, "'height' has shape"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        THREE.replace(**changes)


def test_spacing_is_the_median_distance_to_the_nearest_other_tree() -> None:
    assert THREE.spacing == 3.0
    x, y = np.meshgrid(np.arange(5) * 3.0, np.arange(4) * 5.5)
    assert FeatureSet.of(np.column_stack([x.ravel(), y.ravel()])).spacing == 3.0
    assert FeatureSet.of([[1, 1]]).spacing == FeatureSet.of([]).spacing == FeatureSet.of([[1, 1]] * 4).spacing == 0.0


@given(some.feature_sets(2), some.rigids())
def test_spacing_does_not_depend_on_the_frame(features: FeatureSet, t: Any) -> None:
    assert features.replace(xy=t(features.xy)).spacing == pytest.approx(features.spacing, abs=1e-9)


def test_the_tree_is_built_once_and_answers_for_xy() -> None:
    assert THREE.tree is THREE.tree
    assert THREE.tree.query([[4.1, 3.0]])[1].tolist() == [2]


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs an alarm clock")
def test_an_interrupted_search_leaves_no_thread_behind() -> None:
    points = np.random.default_rng(1).uniform(0, 1, (200_000, 2))
    tree = cKDTree(points)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            nearest(tree, points, 1.0, count=20, threads=2)
        assert threading.active_count() == 1, "it would write into memory that is no longer its own"
    finally:
        signal.signal(signal.SIGALRM, before)


def test_threads_change_nothing() -> None:
    points = np.random.default_rng(2).uniform(0, 1, (20_001, 2))
    one, three = (nearest(cKDTree(points), points, 0.004, count=2, threads=n) for n in (1, 3))
    np.testing.assert_array_equal(one[0], three[0])
    np.testing.assert_array_equal(one[1], three[1])
