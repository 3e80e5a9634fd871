"""View: the part of the orchard that a survey sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from treereg_core.simulate.orchard import Orchard
from treereg_core.simulate.scene import Scene
from treereg_core.transform import FloatArray, Rigid

LARGEST_TILT_DEG = 5.0
TRIM = 0.03
"""Share of the orchard beyond the outer edges of strips and windows, where neither sees the orchard's own end."""

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class View:
    """All points between pairs of parallel lines: `low <= p . direction <= high` for each of k `directions` (k, 2)."""

    directions: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def everything(cls) -> View:
        """A view without limits."""
        return cls(np.zeros((0, 2)), np.zeros(0), np.zeros(0))

    def sees(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which of the points (n, 2), metres, lie in view."""
        along = points @ self.directions.T
        return np.asarray(((along >= self.low) & (along <= self.high)).all(axis=1))


def views(scene: Scene, orchard: Orchard, rng: np.random.Generator) -> tuple[View, View]:
    """What reference and source see of an orchard: cut across a random direction, each with a small tilt of its own."""
    first_deg = rng.uniform(0, 360)
    tilts_deg = rng.uniform(-LARGEST_TILT_DEG, LARGEST_TILT_DEG, (2, 2))
    if scene.overlap == 1:
        return View.everything(), View.everything()
    square = _half_of_square_inside(orchard.outline, first_deg) if scene.crop == "windows" else None

    def cut(tilt_deg: FloatArray, shares: list[Interval]) -> View:
        angles = np.radians(first_deg + np.array([0, 90]) + tilt_deg)[: len(shares)]
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        # Shares count planting positions, those of windows lengths of the square.
        along = orchard.positions @ directions.T if square is None else np.array([[-square] * 2, [square] * 2])
        # The outermost positions are no edge of the view: false detections lie beyond them.
        low = [np.quantile(a, s[0]) if s[0] > 0 else -np.inf for a, s in zip(along.T, shares, strict=True)]
        high = [np.quantile(a, s[1]) if s[1] < 1 else np.inf for a, s in zip(along.T, shares, strict=True)]
        return View(directions, np.array(low), np.array(high))

    reference, source = _shares(scene)
    return cut(tilts_deg[0], reference), cut(tilts_deg[1], source)


def _half_of_square_inside(outline: FloatArray, turned_deg: float) -> float:
    """Half the side of a square about the orchard's centre, turned so, that stays inside even when tilted; metres."""
    return 0.9 * float(np.abs(Rigid.turn(-turned_deg)(outline)).max(axis=1).min())


def _shares(scene: Scene) -> tuple[list[Interval], list[Interval]]:
    """For each direction what reference and source see, as shares of the positions counted along it."""
    match scene.crop:
        case "part":
            return [(0.0, 1.0)], [(0.5 - scene.overlap / 2, 0.5 + scene.overlap / 2)]
        case "ends":
            seen = 1 / (2 - scene.overlap)
            return [(0.0, seen)], [(1 - seen, 1.0)]
        case "strips":
            one = _strips(scene.overlap)
            return [one[0]], [one[1]]
        case "windows":
            one = _strips(math.sqrt(scene.overlap))
            return [one[0]] * 2, [one[1]] * 2


def _strips(overlap: float) -> tuple[Interval, Interval]:
    """Two equal strips inside the orchard that share this part of each."""
    seen = (1 - 2 * TRIM) / (2 - overlap)
    return (TRIM, TRIM + seen), (1 - TRIM - seen, 1 - TRIM)
