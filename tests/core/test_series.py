"""Following trees through surveys that were laid on each other: links, states, probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.series import links
from treereg_core.features import FeatureSet
from treereg_core.series import History, State
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
    return History.of([(survey, Rigid.identity()) for survey in surveys])


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


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(-6e6, 6e6), st.sampled_from([0, 1, 9]))
def test_neither_the_order_of_trees_nor_where_they_lie_matters(seed: int, far: float, digits: int) -> None:
    rng = np.random.default_rng(seed)
    xy = planted()
    surveys = [seen(xy[rng.random(len(xy)) > 0.1], k) for k in range(3)]
    # with few digits many confidences are equal
    surveys = [survey.replace(confidence=np.round(survey.confidence, digits)) for survey in surveys]
    orders = [rng.permutation(len(survey)) for survey in surveys]
    moved = Rigid.turn(0, shift=(far, -far))
    other = History.of([(survey.take(order), moved) for survey, order in zip(surveys, orders, strict=True)])

    def trees(found: History, ids: list[np.ndarray]) -> dict[tuple[int, ...], tuple[float, tuple[int, ...]]]:
        """By the features that show a tree: its probability and its states."""
        columns = zip(ids, found.detection.T, strict=True)
        shown = np.column_stack([np.where(at >= 0, own[at], -1) for own, at in columns])
        said = zip(found.probability.round(5).tolist(), map(tuple, found.state.tolist()), strict=True)
        return dict(zip(map(tuple, shown.tolist()), said, strict=True))

    assert trees(other, orders) == trees(history(*surveys), [np.arange(len(survey)) for survey in surveys])


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


def test_surveys_of_parts_with_trees_of_other_ages_show_no_replanting() -> None:
    xy = planted()
    young = xy[:, 0] > 20
    area = np.where(young, 0.6, 6.0)
    part = young | (np.arange(len(xy)) % 9 == 0)
    found = history(seen(xy[part], 1, area[part]), seen(xy, 2, area), seen(xy, 3, area))
    assert not (found.state == State.REPLANTED).any()


def test_growth_of_all_trees_is_no_replanting_and_hides_none() -> None:
    xy = planted()
    tree = in_the_middle(xy)
    grown = np.full(len(xy), 12.0)
    grown[tree] = 0.5
    found = history(seen(xy, 1, 2.0), seen(xy, 2, grown), seen(xy, 3, grown))
    assert found.state[tree].tolist() == [State.PRESENT, State.REPLANTED, State.PRESENT]
    assert np.count_nonzero(found.state == State.REPLANTED) == 1


def test_a_survey_of_split_crowns_spoils_no_links_of_the_others() -> None:
    xy = planted()
    halves = np.vstack([xy - (0.4, 0), xy + (0.4, 0)])  # noqa: RUF005 -- coordinates, not a sequence to be longer
    clean = [seen(xy, seed) for seed in (2, 3)]
    for surveys in ([seen(halves, 1), *clean], [*clean, seen(halves, 1)]):
        found = history(*surveys)
        at = [k for k, survey in enumerate(surveys) if len(survey) == len(xy)]
        both = (found.detection[:, at] >= 0).all(axis=1)
        assert (found.detection[both][:, at[0]] == found.detection[both][:, at[1]]).all()
        assert np.count_nonzero(both) > 0.97 * len(xy)


def test_a_few_trees_that_surveys_agree_on_are_probable() -> None:
    xy = planted()[: 3 * TREES : 7]
    assert history(seen(xy, 1), seen(xy, 2)).probable.all()


def test_detections_around_the_orchard_that_no_other_survey_confirms_are_improbable() -> None:
    rng = np.random.default_rng(7)
    xy = planted()
    low, high = xy.min(axis=0) - 4, xy.max(axis=0) + 4
    surveys = []
    for seed in range(6):
        around = rng.uniform(low, high, (60, 2))
        around = around[((around < low + 3) | (around > high - 3)).any(axis=1)]
        surveys.append(seen(np.vstack([xy, around]), seed))
    found = history(*surveys)
    assert found.probable[found.seen.sum(axis=1) == 1].mean() < 0.4


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


def truly_laid(simulation: SeriesSimulation) -> History:
    return History.of([(c.features, c.reference_from_source) for c in simulation.captures])


@pytest.mark.parametrize("seasons", [Seasons(), Seasons(seen=0.7, persistence=0.3), Seasons(surveys=2)], ids=str)
def test_links_are_right_and_complete(seasons: Seasons) -> None:
    scene = Scene(trees=1000, missed=0.08, false=0.08, dead=0.02, growth=1.5)
    counts = {"said": 0, "right": 0, "true": 0, "found": 0}
    for seed in range(3):
        simulation = simulate_series(scene, seed, seasons)
        found = links(simulation, range(seasons.surveys), truly_laid(simulation))
        counts = {name: counts[name] + found[name] for name in counts}
    assert counts["right"] >= 0.995 * counts["said"]
    assert counts["found"] >= 0.985 * counts["true"]


def test_each_detection_is_of_one_tree_and_each_tree_once_in_a_survey() -> None:
    simulation = simulate_series(Scene(trees=400, missed=0.3, false=0.5, split=0.1), 3, Seasons(surveys=3))
    found = truly_laid(simulation)
    for s, capture in enumerate(simulation.captures):
        shown = found.detection[found.seen[:, s], s]
        assert sorted(shown.tolist()) == list(range(len(capture.features)))
