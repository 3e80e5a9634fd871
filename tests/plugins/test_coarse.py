"""The global search, beyond what the laws say of every coarse aligner."""

from __future__ import annotations

import numpy as np
import pytest
from treereg_coarse import Coarse

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.simulate import Scene, Simulation, simulate, simulate_family
from treereg_core.testing import scenes
from treereg_core.transform import Rigid

CONTEXT = Context()


def best(simulation: Simulation, settings: Coarse | None = None, context: Context = CONTEXT) -> float:
    """Error in metres of the best proposal."""
    found = (settings or Coarse()).propose(Pair(simulation.reference, simulation.source), context)
    return min(simulation.error(p.reference_from_source) for p in found)


@pytest.mark.parametrize(
    "family",
    [
        "shift_15",
        "rotation_any",
        "noisy",
        "curved",
        "bare_rectangle",
        "overlap_60",
        "distortion_035",
        "small_150",
        "square_any",
        "heavy_noise",
        "overlap_25",
    ],
)
def test_the_truth_is_proposed_in_every_family(family: str) -> None:
    for seed in range(2):
        simulation = simulate_family(family, 900 + seed)
        assert best(simulation) <= simulation.reference.spacing / 4, f"seed {900 + seed}"


@pytest.mark.parametrize("turn_deg", [0.0, 0.4, 45.0, 90.0, 179.9, -120.0])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (400.0, -250.0)])
def test_any_turn_and_any_shift(turn_deg: float, shift: tuple[float, float]) -> None:
    scene = Scene(trees=500, rotation=turn_deg, shift=shift, missed=0.1, false=0.1)
    assert best(simulate(scene, 1)) < 0.3


def test_the_first_proposal_is_the_right_one_in_ordinary_orchards() -> None:
    for seed in range(6):
        simulation = scenes.ordinary(seed)
        first = Coarse().propose(Pair(simulation.reference, simulation.source), CONTEXT)[0]
        assert simulation.error(first.reference_from_source) < 0.3


def test_a_start_of_the_pair_is_of_no_account() -> None:
    pair = Pair(scenes.ordinary().reference, scenes.ordinary().source)
    elsewhere = pair.at(Rigid.turn(77.0, shift=(1e3, 1e3)))
    ours, theirs = (
        [p.reference_from_source.matrix.tolist() for p in Coarse().propose(p, CONTEXT)] for p in (pair, elsewhere)
    )
    assert ours == theirs


def test_the_number_of_proposals_is_a_setting() -> None:
    pair = scenes.lattices()["a lattice and another crop of it"]
    assert len(Coarse(proposals=1).propose(pair, CONTEXT)) == 1
    assert 1 < len(Coarse(proposals=6).propose(pair, CONTEXT)) <= 6


def test_a_good_georeference_leaves_no_half_turns() -> None:
    survey = scenes.lattices()["a lattice and itself"].reference
    pair = Pair(survey, scenes.moved(survey, Rigid(np.eye(2), (2.0, -1.0))))

    def turns(context: Context) -> list[float]:
        return [abs(p.reference_from_source.rotation_deg) for p in Coarse().propose(pair, context)]

    assert max(turns(CONTEXT)) > 179
    assert max(turns(Context(georeference_sd=2.0))) < 1


def test_trees_that_do_not_stand_apart_are_refused() -> None:
    survey = scenes.ordinary().reference
    point = FeatureSet.of(np.zeros((9, 2)))
    for pair in (Pair(survey, point), Pair(point, survey), Pair(survey, survey.take([0, 1]))):
        with pytest.raises(NoRegistration, match="too few trees"):
            Coarse().propose(pair, CONTEXT)


def test_equal_areas_and_confidences_are_no_obstacle() -> None:
    simulation = scenes.ordinary()
    reference, source = (
        f.replace(area=np.ones(len(f)), confidence=np.ones(len(f))) for f in (simulation.reference, simulation.source)
    )
    found = Coarse().propose(Pair(reference, source), CONTEXT)
    assert min(simulation.error(p.reference_from_source) for p in found) < 0.3
