"""Iterative closest point and the confidence filter, beyond what the laws say of every method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from treereg_icp import ConfidenceFilter, Icp

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.simulate import Scene, simulate
from treereg_core.testing import scenes
from treereg_core.testing.laws.wholes import wrong_starts
from treereg_core.transform import Model, Rigid, Similarity

CONTEXT = Context()
NOISY = Scene(trees=500, missed=0.2, false=0.2, jitter=0.35, rotation="any", shift_sd=10)


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
def test_the_error_is_that_of_a_fit_to_the_true_pairs(name: str) -> None:
    simulations = [scenes.scene(name, seed) for seed in range(10)]
    errors = [s.error(Icp().register(scenes.near(s, s.seed), CONTEXT).transform) for s in simulations]
    assert rms(errors) <= 1.2 * rms([s.error(s.true_fit()) for s in simulations])


def test_crowns_and_confidences_help_in_noise() -> None:
    simulations = [simulate(NOISY, seed) for seed in range(16)]

    def error(icp: Icp) -> float:
        return rms([s.error(icp.register(scenes.near(s, s.seed), CONTEXT).transform) for s in simulations])

    assert error(Icp()) < error(Icp(crown_weight=0, confidence_weight=0))


def test_a_scale_is_found_by_a_similarity_and_left_by_a_rigid_fit() -> None:
    simulation = scenes.ordinary()
    truth = simulation.truth
    assert truth is not None
    centre = simulation.source.xy.mean(axis=0)
    grown = Similarity(1.01 * np.eye(2), (0, 0)).about(-centre)
    pair = scenes.near(simulation)
    pair = Pair(pair.reference, pair.source.replace(xy=grown(pair.source.xy)), pair.reference_from_source)
    scaled = Icp().register(pair, Context(model=Model.SIMILARITY)).transform
    assert scaled.scale == pytest.approx(1 / 1.01, abs=5e-4)
    assert simulation.error(scaled @ grown) < 0.03
    assert Icp().register(pair, Context(model=Model.RIGID)).transform.scale == pytest.approx(1, abs=1e-12)


def test_weights_are_probabilities_times_the_trees_own() -> None:
    pair = scenes.near(scenes.ordinary())
    plain = Icp().register(pair, CONTEXT)
    assert ((plain.weights >= 0) & (plain.weights <= 1)).all()
    doubled = replace(pair, source=pair.source.replace(weight=np.full(len(pair.source), 2.0)))
    np.testing.assert_allclose(Icp().register(doubled, CONTEXT).weights, 2 * plain.weights, rtol=1e-6, atol=1e-9)


def test_most_weight_lies_on_true_pairs() -> None:
    simulation = scenes.scene("noisy")
    found = Icp().register(scenes.near(simulation), CONTEXT)
    true = {tuple(pair) for pair in simulation.true_pairs().tolist()}
    on_true = [tuple(pair) in true for pair in found.pairs.tolist()]
    assert found.weights @ on_true >= 0.9 * found.weights.sum()


def test_pairs_are_within_reach() -> None:
    pair = scenes.near(scenes.ordinary())
    for reach in (0.4, 0.8):
        found = Icp(reach=reach).register(pair, CONTEXT)
        moved = found.transform(pair.source.xy[found.pairs[:, 1]])
        distance = np.linalg.norm(moved - pair.reference.xy[found.pairs[:, 0]], axis=1)
        assert distance.max() <= reach * pair.reference.spacing + 0.01


def test_one_tree_over_it_stays_there() -> None:
    """What it is blind to: the start and the judge are there for that."""
    simulation = scenes.ordinary()
    start = wrong_starts(simulation)["a tree over"]
    found = Icp().register(Pair(simulation.reference, simulation.source, start), CONTEXT)
    assert simulation.error(found.transform) == pytest.approx(simulation.scene.spacing, abs=0.3)


def matched(pair: Pair, offset: int) -> Pair:
    """A survey and its copy whose rows are matched with the row so many further on."""
    rows = scenes.true_rows(scenes.ordinary()).reference
    k = np.arange(len(rows) - offset)
    return replace(pair, rows=MatchedRows(rows, rows, np.column_stack([k + offset, k])))


def test_matched_rows_confine_the_pairs_and_one_transform_is_fitted_over_all() -> None:
    survey = scenes.ordinary().reference
    truth = Rigid.turn(5.0, shift=(1.0, 2.0))
    start = scenes.small_motion(survey.xy, survey.spacing) @ truth
    pair = matched(scenes.copies(survey, truth).at(start), 0)
    found = Icp(elsewhere=0).register(pair, CONTEXT)
    np.testing.assert_allclose(found.transform(pair.source.xy), truth(pair.source.xy), atol=1e-3)
    assert pair.rows is not None
    row_of = {tree: k for k, row in enumerate(pair.rows.reference.trees) for tree in row.tolist()}
    assert all(row_of[a] == row_of[b] for a, b in found.pairs.tolist())
    assert len({row_of[a] for a, _ in found.pairs.tolist()}) == len(pair.rows.matches)


def without_thirds(rows: Rows) -> Rows:
    """Rows that lost every third tree."""
    return Rows(tuple(row[np.arange(len(row)) % 3 > 0] for row in rows.trees))


def changing_lanes(rows: Rows) -> Rows:
    """Rows that go on, from their middle, where the next one does."""
    begun, ended = zip(*(np.array_split(row, 2) for row in rows.trees), strict=True)
    return Rows(tuple(np.concatenate(halves) for halves in zip(begun, (*ended[1:], ended[0]), strict=True)))


@pytest.mark.parametrize("spoilt", [without_thirds, changing_lanes])
def test_where_rows_are_wrong_the_right_pairs_are_found_in_the_end(spoilt: Callable[[Rows], Rows]) -> None:
    survey = scenes.ordinary().reference
    truth = Rigid.turn(5.0, shift=(1.0, 2.0))
    start = scenes.small_motion(survey.xy, survey.spacing) @ truth
    pair = matched(scenes.copies(survey, truth).at(start), 0)
    assert pair.rows is not None
    pair = replace(pair, rows=replace(pair.rows, source=spoilt(pair.rows.source)))
    confined, found = Icp(elsewhere=0).register(pair, CONTEXT), Icp().register(pair, CONTEXT)
    assert confined.weights.sum() < 0.8 * len(survey)
    assert found.weights.sum() > 0.95 * len(survey)
    np.testing.assert_allclose(found.transform(pair.source.xy), truth(pair.source.xy), atol=1e-3)


def test_rows_matched_with_the_next_leave_nothing_within_reach() -> None:
    survey = scenes.ordinary().reference
    with pytest.raises(NoRegistration, match="within reach"):
        Icp(reach=0.3).register(matched(Pair(survey, survey), 1), CONTEXT)


@pytest.mark.parametrize(
    ("reference", "source"),
    [([[0, 0], [3, 0]], [[0, 0], [3, 0], [6, 0]]), ([[1, 1]] * 5, [[0, 0], [3, 0], [6, 0]])],
)
def test_too_few_trees_are_refused(reference: list[list[float]], source: list[list[float]]) -> None:
    with pytest.raises(NoRegistration, match="too few trees"):
        Icp().register(Pair(FeatureSet.of(reference), FeatureSet.of(source)), CONTEXT)


def test_five_thousand_trees_are_placed_within_a_few_centimetres() -> None:
    simulation = simulate(Scene(trees=5000, rotation="any"), 0)
    assert simulation.error(Icp().register(scenes.near(simulation), CONTEXT).transform) < 0.03


CONFIDENCES = np.array([0.1, 0.95, 0.5, 0.92, 0.3, 0.99, 0.91, 0.6])
SURVEY = FeatureSet.of(np.column_stack([np.arange(8) * 3.0, np.zeros(8)]), CONFIDENCES)


def kept(settings: ConfidenceFilter, survey: FeatureSet = SURVEY, context: Context = CONTEXT) -> list[int]:
    return settings.select(Pair(survey, SURVEY), context).reference.ids.tolist()


def test_the_proposed_threshold_is_the_default() -> None:
    assert kept(ConfidenceFilter()) == [1, 3, 5, 6]
    assert kept(ConfidenceFilter(threshold=0.91)) == [1, 3, 5, 6]
    assert kept(ConfidenceFilter(threshold=0.0)) == list(range(8))


def test_the_most_confident_share() -> None:
    assert kept(ConfidenceFilter(share=0.25)) == [1, 5]
    assert kept(ConfidenceFilter(share=1.0)) == list(range(8))


def test_a_threshold_that_would_empty_an_orchard_gives_way_and_says_so() -> None:
    said: list[str] = []
    modest = SURVEY.replace(confidence=CONFIDENCES / 2)
    assert kept(ConfidenceFilter(), modest, Context(progress=said.append)) == [1, 3, 5, 6]
    assert said == ["only 0 of 8 trees reach confidence 0.9: the 4 most confident are used"]
    assert kept(ConfidenceFilter(least=0.0), modest) == []


def test_ties_at_the_cut_all_pass() -> None:
    equal = SURVEY.replace(confidence=np.full(8, 0.4))
    assert kept(ConfidenceFilter(), equal) == list(range(8))
    assert kept(ConfidenceFilter(share=0.1), equal) == list(range(8))
