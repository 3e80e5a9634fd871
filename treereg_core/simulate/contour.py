"""Contour rows: rows that follow a slope and so bend one way and the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from treereg_core.errors import UsageError
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.smooth import WAVES, SmoothField
from treereg_core.transform import FloatArray

LONGEST_STEP = 1.1
"""How many times farther apart the trees of a row may be than in a straight one."""
ROOM_CHANGE = 0.25
"""How much wider or narrower the room between two rows may be than between straight ones."""
TRIES = 500


def contour(scene: Scene, positions: FloatArray, rng: np.random.Generator) -> Callable[[FloatArray], FloatArray]:
    """How far contour rows take points (n, 2) of the rows' own frame across, (n,) metres: RMS `scene.contour`.

    Waves of 0.4 to 1.2 times the field's length along the rows and longer ones across. Of the waves drawn the first
    are taken with which rows stay nearly parallel. Raises `UsageError` when there are none: the field is too small.
    """
    if scene.contour == 0:
        return lambda points: np.zeros(len(points))
    for _ in range(TRIES):
        field = _waves(positions, rng)
        along, across = scene.contour * field.gradient(positions)
        step = np.hypot(1, along)
        room = (1 + across) / step
        if step.max() <= LONGEST_STEP and np.abs(room - 1).max() <= ROOM_CHANGE:
            return lambda points: scene.contour * field(points)
    length = np.ptp(positions[:, 0])
    raise UsageError(
        f"The contour of {scene.contour:g} m bends rows of {length:.0f} m so much that they would run into each other: "
        "ask for a smaller contour, or for more trees."
    )


def _waves(positions: FloatArray, rng: np.random.Generator) -> SmoothField:
    length, width = np.maximum(np.ptp(positions, axis=0), 1e-6)
    along = rng.uniform(0.4, 1.2, WAVES) * length
    across = rng.uniform(1.5, 3.0, WAVES) * max(length, width) * rng.choice([-1, 1], WAVES)
    waves = 2 * np.pi / np.array([along, across])
    return SmoothField.of(waves, rng.uniform(0, 2 * np.pi, WAVES), positions)
