"""Laws on coarse aligners."""

from __future__ import annotations

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.method import CoarseAligner
from treereg_core.pair import Pair
from treereg_core.simulate import Simulation
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import copies, moved, ordinary, scene, swapped
from treereg_core.testing.using import apart, use
from treereg_core.transform import Rigid

MANY = 100
"""More proposals than this are no help to a matcher."""


@law
def the_truth_is_among_the_proposals(method: CoarseAligner) -> None:
    """Orchards turned any way and shifted by tens of metres: one proposal is within reach of a matcher."""
    for seed in range(3):
        require_truth(method, ordinary(seed), f"seed {seed}")


@law
def noise_does_not_hide_the_truth(method: CoarseAligner) -> None:
    """The same with a quarter of the trees missed and as many false ones."""
    require_truth(method, scene("noisy"), "noisy")


@law
def it_finds_a_copy_anywhere(method: CoarseAligner) -> None:
    """An exact copy, turned by any angle and shifted by far more than the spacing, is found first."""
    features = ordinary().reference
    for angle, shift in ((0.0, (0.0, 0.0)), (13.0, (60.0, -25.0)), (90.0, (-8.0, 40.0)), (180.0, (0.0, 300.0))):
        truth = Rigid.turn(angle, shift=shift)
        pair = copies(features, truth)
        first = proposals(method, pair)[0].reference_from_source
        require_reach(apart(first, truth, pair.source.xy), features.spacing, f"turned by {angle:g} degrees")


@law
def it_proposes_a_few_distinct_placements(method: CoarseAligner) -> None:
    """Each proposal holds the very same trees, and no two lie within a tenth of the spacing of each other."""
    pair = Pair(ordinary().reference, ordinary().source)
    found = proposals(method, pair)
    require(len(found) <= MANY, f"{len(found)} proposals are too many")
    require(all(p.reference is pair.reference and p.source is pair.source for p in found), "a proposal has other trees")
    for i, one in enumerate(found):
        for other in found[:i]:
            distance = apart(one.reference_from_source, other.reference_from_source, pair.source.xy)
            require(distance > pair.reference.spacing / 10, f"two proposals are {distance:.2g} m apart")


@law
def the_sources_frame_is_irrelevant(method: CoarseAligner) -> None:
    """A source that was turned and shifted beforehand ends at the same place: its own coordinates mean nothing."""
    pair, by = Pair(ordinary().reference, ordinary().source), Rigid.turn(71.0, shift=(40.0, -90.0))
    before = proposals(method, pair)[0].reference_from_source
    after = proposals(method, Pair(pair.reference, moved(pair.source, by)))[0].reference_from_source
    require_reach(apart(after @ by, before, pair.source.xy), pair.reference.spacing, "from another frame")


@law
def swapped_surveys_give_the_inverse(method: CoarseAligner) -> None:
    """Reference and source in each other's place: the first proposal is the inverse."""
    pair = Pair(ordinary().reference, ordinary().source)
    before = proposals(method, pair)[0].reference_from_source
    after = proposals(method, swapped(pair))[0].reference_from_source
    require_reach(apart(after.inverse(), before, pair.source.xy), pair.reference.spacing, "with the surveys swapped")


def proposals(method: CoarseAligner, pair: Pair) -> tuple[Pair, ...]:
    """The proposals for a pair that has a solution; `AssertionError` when there are none."""
    found = use(method, pair)
    require(not isinstance(found, NoRegistration), f"it refused: {found}")
    require(len(found) > 0, "it proposed nothing, where a refusal is wanted")
    return tuple(found)


def require_truth(method: CoarseAligner, simulation: Simulation, name: str) -> None:
    """Require one of the proposals to lie within reach of the truth."""
    found = proposals(method, Pair(simulation.reference, simulation.source))
    errors = [simulation.error(p.reference_from_source) for p in found]
    require_reach(float(np.min(errors)), simulation.reference.spacing, f"{name}, the best of {len(found)} proposals")


def require_reach(distance_m: float, spacing: float, name: str) -> None:
    """Require a distance of at most a quarter of the spacing: half way to where a matcher goes astray."""
    require(distance_m <= spacing / 4, f"{name}: {distance_m:.2f} m off where {spacing / 4:.2f} m are allowed")
