"""Displacement: how the coordinates of a survey stray from those of the orchard."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from treereg_core.simulate.scene import Scene
from treereg_core.simulate.smooth import SmoothField
from treereg_core.transform import Affine, FloatArray, Rigid

ROUNDS = 30
"""Of the fixed-point iteration that undoes a distortion; the smooth ones of a scene need far fewer."""
CLOSE_M = 1e-6


@dataclass(frozen=True, eq=False)
class Displacement:
    """A smooth distortion and then a rigid misplacement: takes the orchard's coordinates to the survey's, metres.

    `fields` displace east and north, by `metres` RMS each; None without a distortion.
    """

    misplaced: Rigid
    fields: tuple[SmoothField, SmoothField] | None = None
    metres: float = 0.0

    @classmethod
    def drawn(cls, scene: Scene, misplaced: Rigid, positions: FloatArray, rng: np.random.Generator) -> Displacement:
        """One with the scene's distortion over `positions` (n, 2): nine trees in ten move less than it says."""
        if scene.distortion == 0:
            return cls(misplaced)
        fields = SmoothField.over(positions, rng), SmoothField.over(positions, rng)
        return cls(misplaced, fields, scene.distortion / math.sqrt(2 * math.log(10)))

    def __call__(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) of the orchard where the survey has them."""
        return self.misplaced(points + self._bend(points))

    def inverse(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) of the survey where they are in the orchard."""
        straight = self.misplaced.inverse()(points)
        found = straight
        for _ in range(ROUNDS):
            before, found = found, straight - self._bend(found)
            if np.abs(found - before).max(initial=0.0) < CLOSE_M:
                break
        return found

    def then(self, moved: Affine) -> Displacement:
        """The same with a further misplacement after it, a rigid one."""
        return replace(self, misplaced=Rigid.from_matrix((moved @ self.misplaced).matrix))

    def _bend(self, points: FloatArray) -> FloatArray:
        if self.fields is None:
            return np.zeros_like(points)
        return self.metres * np.column_stack([field(points) for field in self.fields])
