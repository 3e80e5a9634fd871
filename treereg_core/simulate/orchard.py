"""The orchard itself: where trees stand, how large they are and how plainly they show."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

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
ROUNDS = 12
"""Of the fixed-point iteration that straightens contour rows; each leaves a quarter of the error at most."""


@dataclass(frozen=True, eq=False)
class RowFrame:
    """Where the rows' own frame lies in the orchard, in which they are straight: x along them, y across, metres.

    `first` is the y of the first place of a row; the others follow at distances of `apart`. Calling it takes points
    (n, 2) of the rows' frame to the orchard, `inverse` takes them back. Headland rows do not fit into it.
    """

    heading_deg: float
    bow: float
    length: float
    sway: Callable[[FloatArray], FloatArray]
    first: float
    apart: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Where points (n, 2) of the rows' own frame are in the orchard."""
        aside = self._bowed(points) + self.sway(points)
        return Rigid.turn(self.heading_deg)(points + np.column_stack([np.zeros(len(points)), aside])) - self.centre

    def inverse(self, points: FloatArray) -> FloatArray:
        """Where points (n, 2) of the orchard are in the rows' own frame."""
        bent = Rigid.turn(-self.heading_deg)(points + self.centre)
        bent[:, 1] -= self._bowed(bent)
        found = bent.copy()
        for _ in range(ROUNDS):
            found[:, 1] = bent[:, 1] - self.sway(found)
        return found

    def _bowed(self, points: FloatArray) -> FloatArray:
        return np.asarray(self.bow * (1 - (2 * points[:, 0] / self.length) ** 2))


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
    - `rows`: where the rows' own straight frame lies.
    """

    xy: FloatArray
    row: IntArray
    column: IntArray
    area: FloatArray
    plainness: FloatArray
    positions: FloatArray
    outline: FloatArray
    rows: RowFrame


def plant(scene: Scene, rng: np.random.Generator) -> Orchard:
    """Plant a scene's orchard.

    Raises `UsageError` when gaps and holes leave fewer than 3 trees, or when it is too small for its contour rows.
    """
    (bending,) = rng.spawn(1)
    layout = lay_out(scene, rng)
    heading_deg = rng.uniform(0, 360)
    sway = contour(scene, layout.positions, bending)

    second_of_two = scene.rows_together == 2 and layout.row[0] // (scene.paths + 1) % 2
    first = layout.positions[0, 1] + (-1 if second_of_two else 1) * scene.hedgerow / 2
    place = RowFrame(heading_deg, scene.curve, layout.length, sway, first, scene.row_spacing)
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
        rows=replace(place, centre=(float(centre[0]), float(centre[1]))),
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
