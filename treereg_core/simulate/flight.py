"""Flight: what the detections and the images of one simulated survey have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import IntArray
from treereg_core.simulate.detect import Detections, Visit
from treereg_core.simulate.displacement import Displacement
from treereg_core.simulate.ground import DATUM_SD_M, Ground, tree_heights
from treereg_core.simulate.orchard import Orchard
from treereg_core.simulate.scene import Scene
from treereg_core.transform import FloatArray, Rigid

_HEIGHTS, _GROUND, _DATUM = 1, 2, 6
"""Random streams beside the one of the seed alone, so that what is drawn from them changes nothing else."""


@dataclass(frozen=True, eq=False)
class Flight:
    """One flight over an orchard, as it truly was.

    - `orchard`, `ground`: what was flown over, in the orchard's own frame.
    - `visit`: what of it is in view, which trees stand, and how far crowns have grown.
    - `height` (n,): of each tree of the orchard at that time, metres.
    - `trees` (m, 2): for each feature of the survey the trees that it shows, as positions in the orchard, -1 for none.
    - `datum`: what its elevations have too much, metres.
    - `displacement`: takes the orchard's coordinates to those of the survey.
    """

    orchard: Orchard
    ground: Ground
    visit: Visit
    height: FloatArray
    trees: IntArray
    datum: float
    displacement: Displacement


def flights_of(
    scene: Scene,
    seed: int,
    orchards: tuple[Orchard, Orchard],
    surveys: tuple[tuple[Visit, Detections], tuple[Visit, Detections]],
    displaced: Displacement,
) -> tuple[Flight, Flight]:
    """What is true of both surveys besides their detections; where they show one orchard, ground and trees are too."""
    flights = []
    datum = np.random.default_rng([seed, _DATUM]).normal(0, DATUM_SD_M, 2).tolist()
    places = (Displacement(Rigid.identity()), displaced)
    for when, (orchard, (visit, found), place) in enumerate(zip(orchards, surveys, places, strict=True)):
        which = when if orchards[0] is not orchards[1] else 0
        heights = tree_heights(scene, orchard.area, scene.growth, np.random.default_rng([seed, _HEIGHTS, which]))
        ground = Ground.of(scene, orchard.positions, np.random.default_rng([seed, _GROUND, which]))
        flights.append(Flight(orchard, ground, visit, heights[when], found.trees, datum[when], place))
    return flights[0], flights[1]
