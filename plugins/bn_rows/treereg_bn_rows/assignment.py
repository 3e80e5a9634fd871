"""The assignment of rows to rows that is most probable, when rows keep their order."""

from __future__ import annotations

import numpy as np

from treereg_core.features import IntArray
from treereg_core.transform import FloatArray


def in_order(log_odds: FloatArray) -> IntArray:
    """Positions (k, 2) in `log_odds` (n, m) of greatest sum, both strictly increasing; whatever is not above 0 is left.

    A row of either side may stay without a partner, which counts 0. Dynamic programming (Needleman & Wunsch 1970,
    doi:10.1016/0022-2836(70)90057-4), in time n m. Of equally good assignments always the same.
    """
    n, m = log_odds.shape
    best = np.zeros((n + 1, m + 1))
    for i in range(n):
        row = np.maximum(best[i, 1:], best[i, :-1] + np.maximum(log_odds[i], 0.0))
        best[i + 1, 1:] = np.maximum.accumulate(row)
    chosen = []
    i, j = n, m
    while i and j:
        if best[i, j] == best[i - 1, j]:
            i -= 1
        elif best[i, j] == best[i, j - 1]:
            j -= 1
        else:
            i, j = i - 1, j - 1
            chosen.append((i, j))
    return np.array(chosen[::-1], dtype=np.int64).reshape(-1, 2)
