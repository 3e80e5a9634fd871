"""Following trees through surveys that were laid on each other: links, states, probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.series import links
from treereg_core.features import FeatureSet
from treereg_core.series import History, State
from treereg_core.series.laid import Laid
from treereg_core.series.linking import link
from treereg_core.simulate import Scene, Seasons, SeriesSimulation, simulate_series
from treereg_core.transform import FloatArray, Rigid

SPACING = 3.0
ROWS, TREES = 8, 20


def planted(seed: int = 0) -> FloatArray:
    """Rows 5.5 m apart, trees every 3 m, planted 0.15 m off."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(5.5 * np.arange(ROWS), SPACING * np.arange(TREES), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()]) + rng.normal(0, 0.15, (ROWS * TREES, 2))


def seen(xy: FloatArray, seed: int, area: FloatArray | float = 4.0) -> FeatureSet:
    """What a survey makes of trees: 0.15 m off, crowns a tenth off."""
    rng = np.random.default_rng(seed)
    areas = area * np.exp(rng.normal(0, 0.1, len(xy)))
    return FeatureSet.of(xy + rng.normal(0, 0.15, xy.shape), rng.uniform(0.5, 1, len(xy)), areas)


def history(*surveys: FeatureSet) -> History:
    return History.of([Laid.of(survey, Rigid.identity()) for survey in surveys], SPACING)


def in_the_middle(xy: FloatArray) -> int:
    return int(np.argmin(np.hypot(*(xy - xy.mean(axis=0)).T)))


def test_surveys_of_the_same_trees_are_linked_tree_by_tree() -> None:
    xy = planted()
    found = history(*(seen(xy, seed) for seed in range(4)))
    assert np.array_equal(found.detection, np.repeat(np.arange(len(xy))[:, None], 4, axis=1))
    assert (found.state == State.PRESENT).all()
    assert (found.probability > 0.99).all()


def test_one_survey_alone_is_all_present() -> None:
    found = history(seen(planted(), 1))
    assert (found.state == State.PRESENT).all()
    assert found.probable.all()


@given(st.integers(0, 2**32 - 1), st.floats(-6e6, 6e6), st.floats(-180, 180))
def test_neither_the_order_of_trees_nor_the_frame_matters(seed: int, far: float, turn: float) -> None:
    rng = np.random.default_rng(seed)
    xy = planted()
    surveys = [seen(xy[rng.random(len(xy)) > 0.1], k) for k in range(3)]
    plain = [Laid.of(survey, Rigid.identity()) for survey in surveys]
    orders = [rng.permutation(len(survey)) for survey in surveys]
    moved = Rigid.turn(turn, shift=(far, -far))
    other = [Laid.of(survey.take(order), moved) for survey, order in zip(surveys, orders, strict=True)]

    def partition(numbers: list[np.ndarray]) -> set[frozenset[tuple[int, int]]]:
        trees: dict[int, set[tuple[int, int]]] = {}
        for k, number in enumerate(numbers):
            for place, tree in enumerate(number.tolist()):
                trees.setdefault(tree, set()).add((k, place))
        return {frozenset(tree) for tree in trees.values()}

    after = link(other, SPACING)
    back = []
    for order, numbers in zip(orders, after, strict=True):
        number = np.empty_like(numbers)
        number[order] = numbers
        back.append(number)
    assert partition(back) == partition(link(plain, SPACING))


def test_a_bent_map_is_followed() -> None:
    xy = planted()
    bend = 0.9 * np.column_stack([np.sin(xy[:, 1] / 20), np.cos(xy[:, 0] / 15)])
    found = history(seen(xy, 1), seen(xy + bend, 2), seen(xy, 3))
    assert np.mean((found.detection == np.arange(len(xy))[:, None]).all(axis=1)[: len(xy)]) > 0.97


def test_states_of_a_tree() -> None:
    xy = planted()
    tree = in_the_middle(xy)
    rest = np.delete(xy, tree, axis=0)
    gone = history(seen(xy, 1), seen(rest, 2), seen(rest, 3))
    assert gone.state[tree].tolist() == [State.PRESENT, State.MISSING, State.MISSING]
    back = history(seen(xy, 1), seen(rest, 2), seen(xy, 3))
    assert back.state[tree].tolist() == [State.PRESENT, State.MISSING, State.PRESENT]
    late = history(seen(rest, 1), seen(xy, 2), seen(xy, 3))
    new = late.detection[:, 1] == tree
    assert late.state[new].tolist() == [[State.MISSING, State.NEW, State.PRESENT]]


def test_a_small_crown_that_stays_is_a_tree_planted_anew_and_half_a_crown_once_is_not() -> None:
    xy = planted()
    tree = in_the_middle(xy)
    rest = np.delete(xy, tree, axis=0)
    young, half = np.full(len(xy), 4.0), np.full(len(xy), 4.0)
    young[tree], half[tree] = 0.5, 1.7
    small = [seen(xy, seed, young) for seed in (3, 4)]
    assert history(seen(xy, 1), small[0], small[1]).state[tree].tolist() == [
        State.PRESENT,
        State.REPLANTED,
        State.PRESENT,
    ]
    assert history(seen(xy, 1), seen(rest, 2), small[0]).state[tree].tolist() == [
        State.PRESENT,
        State.MISSING,
        State.REPLANTED,
    ]
    assert (history(seen(xy, 1), seen(xy, 2, half), seen(xy, 3)).state == State.PRESENT).all()


def test_what_a_survey_does_not_cover_is_unseen_and_never_missing() -> None:
    xy = planted()
    part = xy[:, 1] < 30
    found = history(seen(xy, 1), seen(xy[part], 2), seen(xy, 3))
    assert (found.state[~part, 1] == State.UNSEEN).all()
    assert (found.state[part] == State.PRESENT).all()
    first = history(seen(xy[part], 1), seen(xy, 2))
    beyond = first.detection[:, 0] < 0
    assert (first.state[beyond] == [State.UNSEEN, State.PRESENT]).all(axis=1).mean() > 0.95


def test_a_detection_that_no_other_survey_confirms_is_improbable() -> None:
    rng = np.random.default_rng(5)
    xy = planted()
    surveys = []
    for seed in range(5):
        false = rng.uniform(xy.min(axis=0), xy.max(axis=0), (13, 2))
        surveys.append(seen(np.vstack([xy[rng.random(len(xy)) > 0.08], false]), seed))
    found = history(*surveys)
    alone = found.seen.sum(axis=1) == 1
    inner = found.seen[:, 1:-1].any(axis=1)
    assert found.probability[alone & inner].mean() < 0.1
    assert found.probability[found.seen.sum(axis=1) > 2].min() > 0.9


def laid(simulation: SeriesSimulation) -> list[Laid]:
    return [Laid.of(c.features, c.reference_from_source) for c in simulation.captures]


@pytest.mark.parametrize("seasons", [Seasons(), Seasons(seen=0.7, persistence=0.3), Seasons(surveys=2)], ids=str)
def test_links_are_right_and_complete(seasons: Seasons) -> None:
    scene = Scene(trees=1000, missed=0.08, false=0.08, dead=0.02, growth=1.5)
    counts = {"said": 0, "right": 0, "true": 0, "found": 0}
    for seed in range(3):
        simulation = simulate_series(scene, seed, seasons)
        found = links(simulation, range(seasons.surveys), History.of(laid(simulation), SPACING))
        counts = {name: counts[name] + found[name] for name in counts}
    assert counts["right"] >= 0.995 * counts["said"]
    assert counts["found"] >= 0.985 * counts["true"]


def test_each_detection_is_of_one_tree_and_each_tree_once_in_a_survey() -> None:
    simulation = simulate_series(Scene(trees=400, missed=0.3, false=0.5, split=0.1), 3, Seasons(surveys=3))
    found = History.of(laid(simulation), SPACING)
    for s, capture in enumerate(simulation.captures):
        shown = found.detection[found.seen[:, s], s]
        assert sorted(shown.tolist()) == list(range(len(capture.features)))
