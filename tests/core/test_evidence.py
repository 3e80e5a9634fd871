"""The evidence: local scores, one-to-one pairs, and what each tree says for a placement against a decoy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.core.orchards import alike, grid, off_by, pair_of, truth_of
from treereg_core.evidence import Evidence, Match, Statistics, mean_statistics, spacing_of
from treereg_core.features import FeatureSet
from treereg_core.pair import Pair
from treereg_core.side import local_scores, neighbourhoods
from treereg_core.testing import scenes
from treereg_core.transform import FloatArray, Model, Rigid

BLOCK = grid(25, 40)


def scores_of(values: FloatArray, xy: FloatArray = BLOCK) -> FloatArray:
    return local_scores(values, neighbourhoods(xy, cKDTree(xy)))


def weigh(evidence: Evidence, match: Match, decoys: list[Match]) -> float:
    """The log-likelihood ratio of a placement against these decoys."""
    decoy = mean_statistics([evidence.statistics(d) for d in decoys])
    right = evidence.statistics(match).better_than(decoy)
    return sum(float(s.sum()) for s in evidence.scores(match, right, decoy))


class TestLocalScores:
    def test_they_are_normal_scores(self) -> None:
        scores = scores_of(np.random.default_rng(0).lognormal(0, 0.3, len(BLOCK)))
        assert np.mean(scores) == pytest.approx(0, abs=0.02)
        assert np.std(scores) == pytest.approx(1, abs=0.05)
        assert np.abs(scores).max() <= 2.5

    def test_smooth_trends_are_removed(self) -> None:
        """Steep slopes and long waves change the scores of single trees by next to nothing."""
        values = np.random.default_rng(1).normal(0, 0.3, len(BLOCK))
        x, y = BLOCK.T
        for trend in (0.02 * x, -0.03 * y, np.sin(x / 40), 2 * np.cos(y / 50) * np.sin(x / 60)):
            assert np.corrcoef(scores_of(values), scores_of(values + trend))[0, 1] > 0.93
            inside = (x > 15) & (x < 102) & (y > 20) & (y < 112)  # at the edge a neighbourhood lies to one side
            assert abs(np.corrcoef(scores_of(values + trend)[inside], trend[inside])[0, 1]) < 0.15

    def test_a_trend_alone_makes_two_surveys_agree_hardly_at_all(self) -> None:
        rng = np.random.default_rng(2)
        trend = np.sin(BLOCK[:, 0] / 30)
        ours, theirs = (trend + rng.normal(0, 0.2, len(BLOCK)) for _ in range(2))
        assert np.corrcoef(ours, theirs)[0, 1] > 0.7
        assert np.corrcoef(scores_of(ours), scores_of(theirs))[0, 1] < 0.15

    def test_what_sets_single_trees_apart_stays(self) -> None:
        values = np.random.default_rng(3).normal(0, 0.3, len(BLOCK))
        assert np.corrcoef(scores_of(values), values)[0, 1] > 0.93

    def test_only_the_order_counts_and_neither_unit_nor_growth(self) -> None:
        values = np.random.default_rng(4).normal(0, 0.3, len(BLOCK))
        assert scores_of(5 * values + 100) == pytest.approx(scores_of(values))

    @pytest.mark.parametrize("value", [0.0, 1.0, 1e9])
    def test_equal_values_say_nothing(self, value: float) -> None:
        assert not scores_of(np.full(len(BLOCK), value)).any()

    def test_ties_share_a_score(self) -> None:
        """Otherwise the order of trees in the file would decide."""
        values = np.zeros(len(BLOCK))
        values[::7] = 1.0
        scores = scores_of(values)
        assert np.ptp(scores[values == 1]) < 0.1
        assert scores[values == 1].min() > scores[values == 0].max()

    @pytest.mark.parametrize("n", [0, 1, 2, 3, 5])
    def test_few_trees_are_no_trouble(self, n: int) -> None:
        scores = scores_of(np.arange(n, dtype=float), BLOCK[:n])
        assert scores.shape == (n,)
        assert np.isfinite(scores).all()

    def test_the_order_of_trees_is_of_no_account(self) -> None:
        rng = np.random.default_rng(5)
        values, order = rng.normal(0, 0.3, len(BLOCK)), rng.permutation(len(BLOCK))
        again = scores_of(values[order], BLOCK[order])
        # Trees at equal distance make up the neighbourhood in either order.
        assert np.corrcoef(again, scores_of(values)[order])[0, 1] > 0.99


class TestMatch:
    def test_pairs_are_one_to_one_and_within_the_gate(self) -> None:
        simulation = scenes.scene("noisy")
        evidence = Evidence(simulation.reference, simulation.source)
        match = evidence.match(truth_of(simulation))
        assert len(np.unique(match.reference)) == len(match.reference)
        assert len(np.unique(match.source)) == len(match.source)
        there = truth_of(simulation)(simulation.source.xy[match.source])
        apart = np.hypot(*(simulation.reference.xy[match.reference] - there).T)
        assert match.distance == pytest.approx(apart)
        assert match.distance.max() <= evidence.gate < simulation.reference.spacing / 2

    def test_of_several_claims_the_nearest_wins(self) -> None:
        reference = alike(grid(5, 5))
        extra = np.array([[0.5, 0.0], [0.2, 0.0], [0.9, 0.0]])
        source = alike(np.concatenate([extra, grid(5, 5)[1:]]))
        match = Evidence(reference, source).match(Rigid.identity())
        assert match.source[match.reference == 0].tolist() == [1]

    def test_trees_without_a_partner_stay_alone(self) -> None:
        whole = grid(12, 20)
        missing = [50, 100, 101, 180]
        match = Evidence(alike(whole), alike(np.delete(whole, missing, axis=0))).match(Rigid.identity())
        assert sorted(set(range(len(whole))) - set(match.reference.tolist())) == missing

    def test_a_tree_counts_where_the_other_survey_has_been(self) -> None:
        whole = grid(12, 40)
        left, right = alike(whole[whole[:, 0] <= 75]), alike(whole[whole[:, 0] >= 45])
        match = Evidence(left, right).match(Rigid.identity())
        assert match.covered_reference.tolist() == (left.xy[:, 0] >= 45).tolist()
        assert match.covered_source.tolist() == (right.xy[:, 0] <= 75).tolist()
        assert match.rate == 1
        assert Evidence(left, right).match(Rigid(np.eye(2), (1e4, 0.0))).rate == 0

    def test_how_far_two_placements_are_apart(self) -> None:
        simulation = scenes.ordinary()
        evidence = Evidence(simulation.reference, simulation.source)
        a, b = truth_of(simulation), Rigid.turn(7, about=(10, 20), shift=(3, -5)) @ truth_of(simulation)
        step = a(simulation.source.xy) - b(simulation.source.xy)
        assert evidence.apart(a, b) == pytest.approx(np.sqrt((step**2).sum(axis=1).mean()))
        assert evidence.apart(a, b) == pytest.approx(evidence.apart(b, a))
        assert evidence.apart(a, a) == 0


class TestRefine:
    @pytest.mark.parametrize("seed", range(3))
    def test_it_goes_to_the_truth_from_nearby(self, seed: int) -> None:
        simulation = scenes.ordinary(seed)
        start = scenes.near(simulation, seed).reference_from_source
        found = Evidence(simulation.reference, simulation.source).refine(start, Model.RIGID)
        assert simulation.error(start) > 0.3
        assert simulation.error(found) < 0.06

    def test_it_fits_the_model_asked_for(self) -> None:
        survey = scenes.ordinary().reference
        stretched = Rigid.turn(3).linear * 1.002
        pair = Pair(survey, survey.replace(xy=survey.xy @ stretched.T))
        found = Evidence(*(pair.reference, pair.source)).refine(Rigid.turn(-3), Model.SIMILARITY, rounds=5)
        assert found.scale == pytest.approx(1 / 1.002, abs=1e-6)

    def test_where_nothing_meets_it_stays(self) -> None:
        survey = scenes.ordinary().reference
        far = Rigid(np.eye(2), (1e4, 1e4))
        assert Evidence(survey, survey).refine(far, Model.RIGID) == far


class TestLikelihood:
    @pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
    @pytest.mark.parametrize("seed", range(2))
    def test_the_truth_has_more_of_it_than_its_neighbours(self, name: str, seed: int) -> None:
        simulation = scenes.scene(name, seed)
        evidence = Evidence(simulation.reference, simulation.source)
        cells = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1)]
        neighbours = [evidence.match(evidence.refine(off_by(simulation, *cell), Model.RIGID)) for cell in cells]
        right = weigh(evidence, evidence.match(truth_of(simulation)), neighbours)
        assert right > 50
        for neighbour in neighbours:
            others = [n for n in neighbours if n is not neighbour]
            assert weigh(evidence, neighbour, others) < right / 2

    def test_trees_that_are_not_covered_say_nothing(self) -> None:
        simulation = scenes.scene("half overlap")
        evidence = Evidence(simulation.reference, simulation.source)
        match = evidence.match(truth_of(simulation))
        decoy = evidence.statistics(evidence.match(off_by(simulation, 1, 0)))
        scores = evidence.scores(match, evidence.statistics(match).better_than(decoy), decoy)
        for score, covered in zip(scores, (match.covered_reference, match.covered_source), strict=True):
            assert not score[~covered].any()
            assert 0.1 < covered.mean() < 0.9
            assert np.isfinite(score).all()

    def test_a_decoy_judged_as_itself_says_nothing(self) -> None:
        """Like against like: every tree's ratio is one, but for what chance takes from the attributes."""
        survey = alike(np.delete(grid(20, 30), [40, 222, 431], axis=0))
        evidence = Evidence(survey, survey)
        match = evidence.match(Rigid(np.eye(2), (3.0, 0.0)))
        same = evidence.statistics(match)
        for score in evidence.scores(match, same.better_than(same), same):
            assert score == pytest.approx(0, abs=1e-12)

    def test_further_attributes_of_both_surveys_count(self) -> None:
        simulation = scenes.scene("noisy")
        pair, truth = pair_of(simulation), truth_of(simulation)
        girth = np.random.default_rng(0).normal(3, 0.4, len(pair.reference))
        to_source = np.random.default_rng(1).normal(3, 0.4, len(pair.source))
        plain = Evidence(pair.reference, pair.source)
        met = plain.match(truth)
        to_source[met.source] = girth[met.reference]

        def weight(reference: FeatureSet, source: FeatureSet) -> float:
            evidence = Evidence(reference, source)
            return weigh(evidence, evidence.match(truth), [evidence.match(off_by(simulation, 1, 0))])

        def having(name: str) -> tuple[FeatureSet, FeatureSet]:
            return pair.reference.replace(attributes={name: girth}), pair.source.replace(attributes={name: to_source})

        without = weight(pair.reference, pair.source)
        assert weight(having("girth")[0], pair.source) == pytest.approx(without), "an attribute of one survey only"
        assert weight(*having("girth")) > without + 100
        assert weight(*having("height")) == pytest.approx(without), (
            "what is read off a raster at the survey's own place"
        )

    def test_a_placement_is_never_rewarded_for_being_unlike_a_decoy_for_the_worse(self) -> None:
        """Two different orchards would otherwise score high."""
        better = Statistics(np.full(3, 0.9), np.full(3, 0.8), 0.1, {"area": 0.1}, 400)
        worse = Statistics(np.full(3, 0.5), np.full(3, 0.4), 0.5, {"area": -0.6}, 400)
        seen = worse.better_than(better)
        assert (seen.rate_reference >= better.rate_reference).all()
        assert (seen.rate_source >= better.rate_source).all()
        assert seen.variance <= better.variance
        assert seen.correlation["area"] >= 0

    def test_few_pairs_are_not_believed(self) -> None:
        decoy = Statistics(np.full(3, 0.5), np.full(3, 0.5), 0.5, {"area": 0.0}, 400)
        sharp = [Statistics(np.full(3, 0.95), np.full(3, 0.95), 0.1, {"area": 0.6}, n) for n in (3, 30, 3000)]
        few, some, many = (s.better_than(decoy) for s in sharp)
        assert few.rate_reference[0] < some.rate_reference[0] < many.rate_reference[0] < 0.95
        assert few.variance > some.variance > many.variance > 0.1
        assert few.correlation["area"] < some.correlation["area"] < many.correlation["area"] < 0.6

    def test_the_mean_of_decoys_leans_to_those_with_many_pairs(self) -> None:
        few = Statistics(np.full(3, 0.2), np.full(3, 0.2), 0.9, {"area": 0.5}, 0)
        many = Statistics(np.full(3, 0.8), np.full(3, 0.8), 0.3, {"area": 0.0}, 998)
        mean = mean_statistics([few, many])
        assert mean.rate_reference == pytest.approx(np.full(3, 0.8), abs=0.01)
        assert mean.variance == pytest.approx(0.3, abs=0.01)
        assert mean_statistics([few]).correlation == few.correlation

    def test_one_survey_is_prepared_once(self) -> None:
        survey = scenes.ordinary().reference
        first, second = Evidence(survey, survey), Evidence(survey, scenes.ordinary().source)
        assert first.reference is second.reference


@pytest.mark.parametrize("off_m", [0.0, 1e-7, 0.001, 0.05])
def test_trees_that_are_found_twice_do_not_make_the_spacing_that_of_doubles(off_m: float) -> None:
    xy = grid(20, 20)
    twice = FeatureSet.of(np.concatenate([xy, xy + np.array([off_m, 0.0])]))
    assert twice.spacing == pytest.approx(off_m)
    assert 0.3 < spacing_of(twice) <= 3.0
    assert spacing_of(FeatureSet.of(xy)) == FeatureSet.of(xy).spacing
