"""Texture: a random pattern that covers the plane, for soil, grass and leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]
"""Values per pixel; single precision, because there are millions."""
CELLS = 1024


@dataclass(frozen=True, eq=False)
class Texture:
    """A pattern of mean 0 and sd 1, repeated over the plane: `values` (CELLS, CELLS), a cell `cell` metres wide."""

    values: Picture
    cell: float

    @classmethod
    def drawn(cls, lengths: tuple[float, float], cell: float, rng: np.random.Generator) -> Texture:
        """A fractal pattern whose details have `lengths` from the first to the second, metres, long ones stronger."""
        shortest, longest = lengths
        spectrum = np.fft.rfft2(rng.standard_normal((CELLS, CELLS), dtype=np.float32))
        number = np.hypot(np.fft.fftfreq(CELLS, cell)[:, None], np.fft.rfftfreq(CELLS, cell))
        number[0, 0] = np.inf
        strength = np.where(number < 1 / longest, longest, 1 / number) ** 1.4 * np.exp(-((number * shortest / 2) ** 2))
        values = np.fft.irfft2(spectrum * strength).astype(np.float32)
        return cls((values - values.mean()) / values.std(), cell)

    def __call__(self, x: Picture, y: Picture) -> Picture:
        """The pattern at points, metres; in steps of a cell."""
        column = np.floor(x / np.float32(self.cell)).astype(np.int32) & (CELLS - 1)
        row = np.floor(y / np.float32(self.cell)).astype(np.int32) & (CELLS - 1)
        return np.asarray(self.values[row, column])
