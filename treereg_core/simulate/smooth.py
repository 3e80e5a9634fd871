"""Smooth random functions over a field: vigour, distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from treereg_core.transform import FloatArray

WAVES = 6


@dataclass(frozen=True, eq=False)
class SmoothField:
    """A sum of plane waves with mean 0 and RMS 1 over the points that it was made for.

    `waves` (2, k) in radians per metre, `phases` (k,) in radians.
    """

    waves: FloatArray
    phases: FloatArray
    mean: float = 0.0
    rms: float = 1.0

    @classmethod
    def over(cls, points: FloatArray, rng: np.random.Generator) -> SmoothField:
        """A new one over `points` (n, 2) metres, with wavelengths of 0.5 to 1.5 times their larger extent."""
        size = max(float(np.ptp(points, axis=0).max()), 1e-6)
        number = 2 * np.pi / (size * rng.uniform(0.5, 1.5, WAVES))
        direction = rng.uniform(0, 2 * np.pi, WAVES)
        raw = cls(number * np.array([np.cos(direction), np.sin(direction)]), rng.uniform(0, 2 * np.pi, WAVES))
        values = raw(points)
        return cls(raw.waves, raw.phases, float(values.mean()), max(float(values.std()), 1e-9))

    def __call__(self, points: ArrayLike) -> FloatArray:
        """The values at `points` (n, 2) metres, shape (n,)."""
        total = np.cos(np.asarray(points, dtype=np.float64) @ self.waves + self.phases).sum(axis=1)
        return np.asarray((total - self.mean) / self.rms)
