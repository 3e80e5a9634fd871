"""One placement against another: log-odds, and how far the field agrees on them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from tests.core.orchards import alike, grid, off_by, truth_of
from treereg_core.comparison import Comparison, compare, in_part_only, standard_error, standing
from treereg_core.evidence import Evidence, Match, Statistics, mean_statistics
from treereg_core.features import FeatureSet, IntArray
from treereg_core.simulate import Simulation
from treereg_core.testing import scenes
from treereg_core.transform import Model, Rigid


@dataclass(frozen=True)
class Bench:
    """A simulation with its true placement, a few neighbours, and what pairs look like at each."""

    evidence: Evidence
    match: Match
    neighbours: tuple[Match, ...]
    right: Statistics
    decoy: Statistics

    def against(self, rival: Match) -> Comparison:
        return compare(self.evidence, self.match, rival, self.right, self.decoy)


def bench(simulation: Simulation) -> Bench:
    evidence = Evidence(simulation.reference, simulation.source)
    placements = [off_by(simulation, *cell) for cell in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    neighbours = tuple(evidence.match(evidence.refine(p, Model.RIGID)) for p in placements)
    match = evidence.match(truth_of(simulation))
    decoy = mean_statistics([evidence.statistics(m) for m in neighbours])
    return Bench(evidence, match, neighbours, evidence.statistics(match).better_than(decoy), decoy)


class TestMargin:
    @pytest.mark.parametrize("log_odds", [-40.0, -3.0, 0.0, 3.0, 40.0, 1e4])
    def test_it_never_exceeds_the_log_odds_and_has_their_sign(self, log_odds: float) -> None:
        for error in (0.0, 0.1, 3.0, 1e3):
            margin = Comparison(log_odds, error).margin
            assert margin <= log_odds or log_odds < 0
            assert math.copysign(1, margin) == math.copysign(1, log_odds) or margin == 0

    def test_it_falls_as_the_field_disagrees(self) -> None:
        margins = [Comparison(30.0, error).margin for error in (0.5, 5.0, 10.0, 20.0, 60.0)]
        assert margins[0] == 30.0
        assert (np.diff(margins) <= 0).all()
        assert margins[-1] < 1

    def test_an_unknown_error_leaves_nothing(self) -> None:
        assert Comparison(100.0, math.inf).margin == 0

    @pytest.mark.parametrize("prior", [-20.0, 0.0, 7.5])
    def test_what_was_known_beforehand_comes_on_top_as_it_is(self, prior: float) -> None:
        for seen, error in ((30.0, 20.0), (-4.0, 1.0), (0.0, 0.0)):
            plain, known = Comparison(seen, error), Comparison(seen, error).plus(prior)
            assert known.margin == pytest.approx(plain.margin)
            assert known.log_odds == plain.log_odds + prior
            assert known.log_odds == pytest.approx(plain.log_odds + prior)
            assert known.standard_error == plain.standard_error
            assert known.plus(1.0).prior == prior + 1


class TestCompare:
    @pytest.mark.parametrize("name", ["ordinary", "noisy", "half overlap"])
    @pytest.mark.parametrize("seed", range(2))
    def test_the_truth_beats_its_neighbours_all_over_the_field(self, name: str, seed: int) -> None:
        b = bench(scenes.scene(name, seed))
        for neighbour in b.neighbours:
            found = b.against(neighbour)
            assert found.log_odds > 20
            assert found.log_odds > 3 * found.standard_error

    def test_turned_round_it_says_the_opposite(self) -> None:
        b = bench(scenes.ordinary())
        there = b.against(b.neighbours[0])
        back = compare(b.evidence, b.neighbours[0], b.match, b.right, b.decoy)
        assert back.log_odds == pytest.approx(-there.log_odds)
        assert back.margin < 0

    def test_a_placement_against_itself_is_undecided(self) -> None:
        b = bench(scenes.ordinary())
        assert b.against(b.match) == Comparison(0.0, 0.0)
        assert b.against(b.match).margin == 0

    def test_outlines_are_no_evidence(self) -> None:
        """Differing crops of one lattice meet in more or fewer trees, and that tells nothing."""
        whole = grid(24, 40)
        evidence = Evidence(alike(whole[whole[:, 0] < 80]), alike(whole[whole[:, 0] > 40]))
        matches = [evidence.match(Rigid(np.eye(2), (3.0 * k, 0.0))) for k in (0, 1, -1, -4)]
        decoy = mean_statistics([evidence.statistics(m) for m in matches])
        right = evidence.statistics(matches[0]).better_than(decoy)
        assert len({int(m.covered_reference.sum()) for m in matches}) == 4
        for rival in matches[1:]:
            assert compare(evidence, matches[0], rival, right, decoy).log_odds == pytest.approx(0, abs=1e-6)

    @pytest.mark.parametrize("cell", [(1, 0), (9, 0), (40, 0)])
    def test_only_trees_that_both_placements_cover_count_unless_those_are_few(self, cell: tuple[int, int]) -> None:
        simulation = scenes.scene("noisy")
        b = bench(simulation)
        rival = b.evidence.match(off_by(simulation, *cell))
        mine, its = (b.evidence.scores(m, b.right, b.decoy) for m in (b.match, rival))
        ours = np.concatenate([b.match.covered_reference, b.match.covered_source])
        theirs = np.concatenate([rival.covered_reference, rival.covered_source])
        few = bool((ours & theirs).sum() < 0.5 * ours.sum())
        assert few == (cell == (40, 0))
        gain = np.concatenate(mine) - np.concatenate(its)
        either, both = float(gain[ours | theirs].sum()), float(gain[ours & theirs].sum())
        assert both != pytest.approx(either), "the outline would make a difference"
        assert b.against(rival).log_odds == pytest.approx(either if few else both)

    def test_a_rival_elsewhere_counts_by_what_it_leaves_uncovered(self) -> None:
        b = bench(scenes.ordinary())
        nowhere = b.evidence.match(Rigid(np.eye(2), (1e5, 0.0)))
        alone = standing(b.evidence, b.match, b.right, b.decoy)
        assert b.against(nowhere).log_odds == pytest.approx(alone.log_odds)

    def test_the_truth_stands_by_itself_and_a_neighbour_does_not(self) -> None:
        b = bench(scenes.ordinary())
        alone = standing(b.evidence, b.match, b.right, b.decoy)
        assert alone.margin > 50
        rest = mean_statistics([b.evidence.statistics(m) for m in b.neighbours[1:]])
        other = b.evidence.statistics(b.neighbours[0]).better_than(rest)
        assert standing(b.evidence, b.neighbours[0], other, rest).margin < alone.margin / 5


class TestStandardError:
    """Of the sum over the trees: surveys whose gaps agree, here and there or in one corner only."""

    @staticmethod
    def weighed(gaps: IntArray) -> Comparison:
        """A lattice with these gaps (positions) seen twice, against its neighbour."""
        survey = alike(np.delete(grid(30, 40), gaps, axis=0))
        evidence = Evidence(survey, survey)
        match, rival = (evidence.match(Rigid(np.eye(2), (x, 0.0))) for x in (0.0, 3.0))
        decoy = evidence.statistics(rival)
        return compare(evidence, match, rival, evidence.statistics(match).better_than(decoy), decoy)

    def test_it_grows_when_gains_come_from_one_corner(self) -> None:
        where = np.arange(30 * 40).reshape(30, 40)
        rng = np.random.default_rng(0)
        corner = rng.choice(where[2:14, 2:18].ravel(), 36, replace=False)
        everywhere = rng.choice(where[2:-2, 2:-2].ravel(), 36, replace=False)
        clustered, spread = self.weighed(corner), self.weighed(everywhere)
        assert clustered.log_odds == pytest.approx(spread.log_odds, rel=0.35)
        assert clustered.standard_error > 1.5 * spread.standard_error
        ours, theirs = (c.log_odds / c.standard_error for c in (clustered, spread))
        assert ours < 0.7 * theirs, "the field agrees less"

    def test_it_is_that_of_the_sum_where_trees_are_independent(self) -> None:
        """Gains drawn anew: the sums stray as far as the standard error says, on average."""
        sums, errors = [], []
        for seed in range(60):
            gaps = np.flatnonzero(np.random.default_rng(seed).random(30 * 40) < 0.05)
            found = self.weighed(gaps)
            sums.append(found.log_odds)
            errors.append(found.standard_error)
        assert 0.5 < np.std(sums) / np.mean(errors) < 1.5

    def test_a_larger_field_whose_parts_differ_as_much_is_as_sure(self) -> None:
        """Where the same share of a field says less, the log-odds are as many standard errors, however many trees."""
        ratios = []
        for side in (90, 900):
            where = grid(side, side)
            reach = where[:, 0] / where[:, 0].max()
            gain = np.where(reach < 0.3, 0.2, 1.0) + np.random.default_rng(0).normal(0, 1, len(where))
            ratios.append(gain.sum() / standard_error(gain, where))
        assert ratios[1] == pytest.approx(ratios[0], rel=0.15)

    def test_a_handful_of_trees_knows_nothing_of_its_own_error(self) -> None:
        few: FeatureSet = alike(grid(1, 3))
        evidence = Evidence(few, few)
        match, rival = (evidence.match(Rigid(np.eye(2), (0.0, y))) for y in (0.0, 1.0))
        decoy = evidence.statistics(rival)
        found = compare(evidence, match, rival, evidence.statistics(match).better_than(decoy), decoy)
        assert found.standard_error == math.inf
        assert found.margin == 0


class TestInPartOnly:
    """Whether one of the maps is bent so much that a placement lays a part of the field only."""

    def laid(self, drift: float, kept: float = 1.0) -> bool:
        """For rows of which the last third drifts across by up to `drift` metres, and keeps a share of its trees."""
        rng = np.random.default_rng(1)
        xy = grid(20, 40)
        beyond = np.clip((xy[:, 0] / xy[:, 0].max() - 2 / 3) * 3, 0, None)
        there = (beyond == 0) | (rng.random(len(xy)) < kept)
        noise = rng.normal(0, 0.15, xy.shape)
        evidence = Evidence(alike(xy), alike((xy + noise + drift * np.outer(beyond, [0, 1]))[there]))
        return in_part_only(evidence, evidence.match(Rigid.identity()))

    def test_a_part_that_drifts_away_counts(self) -> None:
        assert self.laid(2.7)

    @pytest.mark.parametrize("drift", [0.0, 0.2, 1.0])
    def test_neither_a_straight_map_nor_a_slight_bend_does(self, drift: float) -> None:
        assert not self.laid(drift)

    @pytest.mark.parametrize("drift", [0.0, 0.2])
    def test_nor_does_a_part_where_trees_were_felled(self, drift: float) -> None:
        assert not self.laid(drift, kept=0.2)
