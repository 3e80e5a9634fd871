"""The ground of an orchard, and how high its trees stand above it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from treereg_core.simulate.scene import Scene
from treereg_core.simulate.smooth import SmoothField
from treereg_core.transform import FloatArray

LEVEL_M = (150.0, 900.0)
DATUM_SD_M = 3.0
"""Of the error that all elevations of one survey have in common."""
ALLOMETRY = 0.25
"""Exponent of the crown's area in a tree's height: trees twice as wide are 1.4 times as high."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Elevations of the ground: a slope with gentle waves on it, about a level in metres.

    `rise` (2,) is the slope along x and y, metres per metre; `waves` metres, RMS.
    """

    level: float
    rise: FloatArray
    waves: float
    field: SmoothField

    @classmethod
    def of(cls, scene: Scene, positions: FloatArray, rng: np.random.Generator) -> Ground:
        """The ground of a scene under `positions` (n, 2): the slope falls in any direction."""
        downhill = rng.uniform(0, 2 * np.pi)
        rise = scene.slope * np.array([np.cos(downhill), np.sin(downhill)])
        return cls(rng.uniform(*LEVEL_M), rise, scene.undulation, SmoothField.over(positions, rng))

    def __call__(self, points: FloatArray) -> FloatArray:
        """The elevation at points (n, 2) of the orchard, metres (n,)."""
        return np.asarray(self.level + points @ self.rise + self.waves * self.field(points))


def tree_heights(
    scene: Scene, area: FloatArray, growth: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Heights (n,), metres, of trees with these crown areas at the time of the reference, and when crowns have grown.

    Larger crowns are higher, and on top of that each tree has a height of its own, most of which lasts.
    """
    own, first, second = rng.standard_normal((3, len(area)))
    lasting = math.sqrt(scene.height_persistence) * own
    passing = math.sqrt(1 - scene.height_persistence)
    usual = scene.height * (area / np.median(area)) ** ALLOMETRY
    before, after = (usual * np.exp(scene.height_variation * (lasting + passing * new)) for new in (first, second))
    return before, after * growth ** (2 * ALLOMETRY)
