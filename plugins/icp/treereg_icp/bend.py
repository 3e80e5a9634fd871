"""Smooth displacement between two surveys, so that trees find their partners where no single transform fits all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from treereg_core.transform import FloatArray

CELLS = 3
FIRM = 1.0


@dataclass(frozen=True, eq=False)
class Bend:
    """The local mean of residuals: `displacement` (n, 2) metres at each place asked for, and its noise.

    `signal` is the mean square of the displacement over what chance alone would give.
    """

    displacement: FloatArray
    signal: float


def local_bend(places: FloatArray, residual: FloatArray, weight: FloatArray, at: FloatArray, width: float) -> Bend:
    """Mean of residuals (n, 2) at places (n, 2), by weight, under a Gaussian window of `width` metres, at `at` (m, 2).

    A kernel regression (Nadaraya 1964, doi:10.1137/1109020) on a grid, drawn towards 0 where little is known.
    """
    cell = width / CELLS
    low = np.minimum(places.min(axis=0), at.min(axis=0)) - cell
    shape = tuple(np.ceil((np.maximum(places.max(axis=0), at.max(axis=0)) - low) / cell).astype(int) + 2)
    i, j = np.round((places - low) / cell).astype(int).T
    peak = 2 * np.pi * CELLS**2

    def spread(values: FloatArray) -> FloatArray:
        grid = np.bincount(i * shape[1] + j, values, shape[0] * shape[1]).reshape(shape)
        return np.asarray(ndimage.gaussian_filter(grid, CELLS, mode="constant", truncate=3)) * peak

    known = spread(weight)
    k, m = np.round((at - low) / cell).astype(int).T
    mean = np.column_stack([(spread(weight * r) / (known + FIRM))[k, m] for r in residual.T])
    variance = float(weight @ (residual**2).sum(axis=1) / (2 * weight.sum()))
    chance = variance / (known[k, m] + FIRM)
    return Bend(mean, float((mean**2).sum(axis=1).mean() / max(float(chance.mean()), 1e-12)))
