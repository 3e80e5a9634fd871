"""Smooth random functions over a field: vigour, distortion, contour rows."""

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
        return cls.of(
            number * np.array([np.cos(direction), np.sin(direction)]), rng.uniform(0, 2 * np.pi, WAVES), points
        )

    @classmethod
    def of(cls, waves: FloatArray, phases: FloatArray, points: FloatArray) -> SmoothField:
        """The one of these waves and phases, over `points` (n, 2) metres."""
        values = cls(waves, phases)(points)
        return cls(waves, phases, float(values.mean()), max(float(values.std()), 1e-9))

    def __call__(self, points: ArrayLike) -> FloatArray:
        """The values at `points` (n, 2) metres, shape (n,)."""
        total = np.cos(np.asarray(points, dtype=np.float64) @ self.waves + self.phases).sum(axis=1)
        return np.asarray((total - self.mean) / self.rms)

    def gradient(self, points: FloatArray) -> FloatArray:
        """The slopes along x and y at `points` (n, 2) metres, per metre, shape (2, n)."""
        return np.asarray(-(self.waves @ np.sin(points @ self.waves + self.phases).T) / self.rms)
