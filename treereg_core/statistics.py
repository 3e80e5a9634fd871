"""Intervals for what was counted and measured."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from treereg_core.transform import FloatArray

Z95 = 1.959964
DRAWS = 2000
LARGEST = 1_000_000
"""So many values are drawn at once at most, so that memory does not grow with the trials."""
Statistic = Callable[[FloatArray], FloatArray]
"""Of values in the last axis, one for each of the others."""


def wilson(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    if not of:
        return 0.0, 1.0
    share, square = count / of, Z95**2 / of
    centre = (share + square / 2) / (1 + square)
    half = Z95 / (1 + square) * math.sqrt(share * (1 - share) / of + Z95**2 / (4 * of**2))
    return (max(centre - half, 0.0) if count else 0.0), (min(centre + half, 1.0) if count < of else 1.0)


def upper_bound(count: int, of: int) -> float:
    """The 95 % upper bound of a share: the rule of three when nothing was seen, else Wilson's."""
    if not of:
        return 1.0
    return min(3 / of, 1.0) if count == 0 else wilson(count, of)[1]


def bootstrap(values: ArrayLike, statistic: Statistic) -> tuple[float, float]:
    """The 95 % interval of a statistic of values (n,), n at least 1 (Efron 1979, doi:10.1214/aos/1176344552).

    Percentiles over samples from a fixed seed, so that the same values give the same interval.
    """
    given = np.asarray(values, dtype=np.float64)
    rng, at_once = np.random.default_rng(0), max(LARGEST // len(given), 1)
    sizes = [min(at_once, DRAWS - done) for done in range(0, DRAWS, at_once)]
    drawn = [statistic(given[rng.integers(len(given), size=(size, len(given)))]) for size in sizes]
    low, high = np.quantile(np.concatenate(drawn), (0.025, 0.975))
    return float(low), float(high)


def median(values: FloatArray) -> FloatArray:
    """Over the last axis."""
    return np.asarray(np.median(values, axis=-1))


def percentile_95(values: FloatArray) -> FloatArray:
    """Over the last axis."""
    return np.asarray(np.quantile(values, 0.95, axis=-1))
