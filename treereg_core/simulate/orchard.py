"""The orchard itself: where trees stand, how large they are and how plainly they show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import UsageError
from treereg_core.features import IntArray
from treereg_core.simulate.contour import contour
from treereg_core.simulate.layout import lay_out
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.smooth import SmoothField
from treereg_core.transform import FloatArray, Rigid

LARGEST_MEDIAN_CROWN_M2 = 25.0


@dataclass(frozen=True, eq=False)
class Orchard:
    """The trees of an orchard, ordered by row and along it, about a local origin in its centre.

    - `xy` (n, 2): where each tree stands, metres.
    - `row`, `column` (n,): its row and its planting position in the row. Two trees are neighbours when they are of one
      row and their columns follow on each other; a missing number is a gap. Rows count from 0 across the field. A path
      ends a row: what lies beyond is the row of the next number, in which columns count on. Headland rows come last.
    - `area` (n,): crown area that lasts, at the time of the reference, square metres.
    - `plainness` (n,): standard normal; what a tree's confidences have in common.
    - `positions` (m, 2): all planting positions, gaps included, metres.
    - `outline` (k, 2): points along the block's edge, metres, counter-clockwise, first one not repeated.
    """

    xy: FloatArray
    row: IntArray
    column: IntArray
    area: FloatArray
    plainness: FloatArray
    positions: FloatArray
    outline: FloatArray


def plant(scene: Scene, rng: np.random.Generator) -> Orchard:
    """Plant a scene's orchard.

    Raises `UsageError` when gaps and holes leave fewer than 3 trees, or when it is too small for its contour rows.
    """
    (bending,) = rng.spawn(1)
    layout = lay_out(scene, rng)
    heading_deg = rng.uniform(0, 360)
    sway = contour(scene, layout.positions, bending)

    def place(points: FloatArray) -> FloatArray:
        bow = scene.curve * (1 - (2 * points[:, 0] / layout.length) ** 2)
        return Rigid.turn(heading_deg)(points + np.column_stack([np.zeros(len(points)), bow + sway(points)]))

    positions = place(layout.positions)
    centre = positions.mean(axis=0)
    positions = positions - centre
    standing = (rng.random(len(positions)) >= scene.gaps) & ~_in_holes(positions, scene, rng)
    if np.count_nonzero(standing) < 3:
        raise UsageError("The scene leaves fewer than 3 trees: ask for more trees, or for fewer gaps and holes.")
    xy = positions[standing] + scene.planting_jitter * rng.standard_normal((np.count_nonzero(standing), 2))
    individual = scene.area_variation * math.sqrt(scene.area_persistence) * rng.standard_normal(len(xy))
    median = min(scene.crown_cover * scene.row_spacing * scene.spacing / scene.rows_together, LARGEST_MEDIAN_CROWN_M2)
    return Orchard(
        xy=xy,
        row=np.unique(layout.row[standing], return_inverse=True)[1].astype(np.int64),
        column=layout.column[standing],
        area=median * np.exp(scene.vigour * SmoothField.over(positions, rng)(xy) + individual),
        plainness=rng.standard_normal(len(xy)),
        positions=positions,
        outline=place(layout.outline) - centre,
    )


def _in_holes(positions: FloatArray, scene: Scene, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which positions lie in one of the scene's holes: discs of 0.5 to 2 % of the orchard's area."""
    inside = np.zeros(len(positions), dtype=bool)
    for share in rng.uniform(0.005, 0.02, scene.holes):
        centre = positions[rng.integers(len(positions))]
        orchard_m2 = len(positions) / scene.rows_together * scene.row_spacing * scene.spacing
        radius = math.sqrt(share * orchard_m2 / math.pi)
        inside |= ((positions - centre) ** 2).sum(axis=1) < radius**2
    return inside
