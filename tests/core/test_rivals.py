"""The judge's own rivals: near, turned and far placements that could be mistaken for a given one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.core.orchards import CONTEXT, alike, grid, off_by, truth_of
from treereg_core.evidence import Evidence
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.rivals import Rivals, find_rivals
from treereg_core.simulate import Scene, Simulation, simulate, simulate_family
from treereg_core.testing import scenes
from treereg_core.testing.scenes import moved
from treereg_core.transform import Affine, Rigid, Similarity


def rivals_of(simulation: Simulation, context: Context = CONTEXT, *others: Affine) -> tuple[Evidence, Rivals]:
    evidence = Evidence(simulation.reference, simulation.source, context.threads)
    return evidence, find_rivals(evidence, truth_of(simulation), others, context)


@pytest.mark.parametrize("family", ["rotation_any", "noisy", "overlap_50", "small_60", "square_any", "distortion_1"])
def test_they_differ_from_the_placement_and_from_each_other(family: str) -> None:
    for seed in range(2):
        simulation = simulate_family(family, seed)
        evidence, rivals = rivals_of(simulation)
        assert rivals.dangerous
        assert rivals.decoys
        dangerous = [m.transform for m in rivals.dangerous]
        for a, b in itertools.combinations([truth_of(simulation), *dangerous], 2):
            assert evidence.apart(a, b) > evidence.gate
        for decoy in rivals.decoys:
            assert evidence.apart(truth_of(simulation), decoy.transform) > evidence.gate


def test_the_decoys_are_neighbouring_cells() -> None:
    for seed in range(3):
        simulation = simulate(Scene(trees=800, rotation="any"), seed)
        evidence, rivals = rivals_of(simulation)
        cells = [off_by(simulation, i, j) for i in range(-4, 5) for j in range(-4, 5) if (i, j) != (0, 0)]
        for decoy in rivals.decoys:
            assert min(evidence.apart(decoy.transform, cell) for cell in cells) < evidence.spacing / 8
            assert decoy.rate > 0.75, "they meet the planting pattern"


@pytest.mark.parametrize("turn_deg", [0.0, 50.0])
def test_neighbouring_rows_are_dangerous_where_each_is_planted_like_the_last(turn_deg: float) -> None:
    rng = np.random.default_rng(1)
    shift = [rng.normal(0, 0.4, (30, 2))]
    for _ in range(19):
        shift.append(0.9 * shift[-1] + np.sqrt(1 - 0.9**2) * rng.normal(0, 0.4, (30, 2)))
    survey = alike(grid(20, 30) + np.concatenate(shift))
    motion = Rigid.turn(turn_deg, shift=(30.0, 5.0))
    evidence = Evidence(survey, moved(survey, motion.inverse()))
    dangerous = [m.transform for m in find_rivals(evidence, motion, (), CONTEXT).dangerous]
    for step in (5.5, -5.5):
        next_row = Rigid(np.eye(2), (0.0, step)) @ motion
        assert min(evidence.apart(t, next_row) for t in dangerous) < evidence.gate / 2


def test_on_an_exact_lattice_they_are_cells_and_half_turns() -> None:
    survey = alike(grid(20, 30))
    evidence = Evidence(survey, survey)
    rivals = find_rivals(evidence, Rigid.identity(), (), CONTEXT)
    for match in (*rivals.dangerous, *rivals.decoys):
        assert match.distance.max() < 1e-6, "every tree that meets any meets it exactly"
        assert match.rate > 0.99
        assert abs(np.sin(np.radians(match.transform.rotation_deg))) < 1e-9


def symmetric(order: int) -> FeatureSet:
    """An irregular square orchard, trees and crowns, that a turn by 360/order degrees leaves as it is."""
    rng = np.random.default_rng(order)
    lattice = grid(24, 24, 4.0, 4.0) - 46.0
    xy, area = lattice + rng.normal(0, 0.3, lattice.shape), rng.lognormal(1.6, 0.3, len(lattice))
    sector = np.arctan2(lattice[:, 1], lattice[:, 0]) % (2 * np.pi) < 2 * np.pi / order
    some = sector & (rng.random(len(xy)) > 0.1)
    turned = [Rigid.turn(360.0 / order * k)(xy[some]) for k in range(order)]
    return FeatureSet.of(np.concatenate(turned), area=np.tile(area[some], order))


@pytest.mark.parametrize(("order", "turns_deg"), [(2, [180]), (4, [90, -90, 180])])
@pytest.mark.parametrize("motion", [Rigid.identity(), Rigid.turn(37, shift=(20.0, -9.0))])
def test_turns_that_leave_the_orchard_the_same_are_found(order: int, turns_deg: list[float], motion: Rigid) -> None:
    survey = symmetric(order)
    evidence = Evidence(survey, moved(survey, motion.inverse()))
    dangerous = [m.transform for m in find_rivals(evidence, motion, (), CONTEXT).dangerous]
    for turn in turns_deg:
        twin = Rigid.turn(turn) @ motion
        assert min(evidence.apart(t, twin) for t in dangerous) < evidence.gate / 4, f"{turn} degrees"


def test_what_others_ended_on_is_considered() -> None:
    """A copy of the block, planted again 1.15 times as wide: no shift or turn of the placement itself leads there."""
    rng = np.random.default_rng(0)
    block = grid(16, 20) + rng.normal(0, 0.2, (320, 2))
    area = rng.lognormal(1.6, 0.3, 320)
    wider = Similarity(Rigid.turn(64.0).linear * 1.15, (300.0, 40.0))
    reference = FeatureSet.of(np.concatenate([block, wider(block)]), area=np.tile(area, 2))
    evidence = Evidence(reference, FeatureSet.of(block, area=area))
    without, considered = (find_rivals(evidence, Rigid.identity(), others, CONTEXT) for others in ((), (wider,)))
    assert evidence.apart(considered.dangerous[0].transform, wider) < 0.05
    assert all(evidence.apart(m.transform, wider) > 1 for m in without.dangerous)


def test_the_placement_itself_among_the_others_is_no_rival() -> None:
    simulation = scenes.ordinary()
    nudge = Rigid(np.eye(2), (0.1, 0.1))
    evidence, rivals = rivals_of(simulation, CONTEXT, truth_of(simulation), nudge @ truth_of(simulation))
    for match in rivals.dangerous:
        assert evidence.apart(match.transform, truth_of(simulation)) > evidence.gate


def test_a_wrong_placement_meets_the_truth_as_its_rival() -> None:
    for seed in range(3):
        simulation = scenes.ordinary(seed)
        evidence = Evidence(simulation.reference, simulation.source)
        half_turn = Rigid.turn(180, about=truth_of(simulation)(simulation.source.xy).mean(axis=0))
        for wrong in (off_by(simulation, 1, 0), off_by(simulation, 0, 1), half_turn @ truth_of(simulation)):
            first = find_rivals(evidence, wrong, (), CONTEXT).dangerous[0]
            assert simulation.error(first.transform) < 0.2


def test_without_a_lattice_there_are_decoys_on_all_sides() -> None:
    rng = np.random.default_rng(3)
    scattered = FeatureSet.of(rng.uniform(0, 60, (60, 2)), area=rng.lognormal(1.6, 0.3, 60))
    rivals = find_rivals(Evidence(scattered, scattered), Rigid.identity(), (), CONTEXT)
    assert len(rivals.decoys) >= 3


def test_they_are_the_same_at_any_number_of_threads() -> None:
    simulation = scenes.ordinary()
    ours, theirs = (rivals_of(simulation, Context(threads=n))[1] for n in (1, 2))
    assert [m.transform for m in ours.dangerous] == [m.transform for m in theirs.dangerous]
    assert [m.transform for m in ours.decoys] == [m.transform for m in theirs.decoys]
