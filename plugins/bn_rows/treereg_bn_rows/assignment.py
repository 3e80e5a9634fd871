"""The assignment of rows to rows that is most probable, when rows keep their order."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from itertools import groupby

import numpy as np

from treereg_core.features import IntArray
from treereg_core.transform import FloatArray


def in_order(i: IntArray, j: IntArray, log_odds: FloatArray) -> IntArray:
    """Which pairs (k,) of rows `i`, `j` (n,) have the greatest sum, both strictly increasing; none at or below 0.

    A row of either side may stay without a partner, which counts 0. Dynamic programming over the given pairs alone, as
    for the longest common subsequence (Hunt & Szymanski 1977, doi:10.1145/359581.359603), so that no table of all rows
    by all rows is needed. Of equally good assignments always the same, whatever the order of the pairs.
    """
    good = np.flatnonzero(log_odds > 0)
    good = good[np.lexsort((j[good], i[good]))]
    # what assignments that end at this j or before are worth at most: both ascend
    ends, worth, last = [-1], [0.0], [-1]
    before: dict[int, int] = {}
    given = zip(i[good].tolist(), j[good].tolist(), log_odds[good].tolist(), good.tolist(), strict=True)
    for _, of_row in groupby(given, key=lambda pair: pair[0]):
        longer = []
        for _, end, gain, pair in of_row:
            at = bisect_left(ends, end) - 1
            before[pair] = last[at]
            longer.append((end, worth[at] + gain, pair))
        for end, total, pair in longer:
            if worth[bisect_right(ends, end) - 1] < total:
                worse = slice(bisect_left(ends, end), bisect_left(worth, total))
                ends[worse], worth[worse], last[worse] = [end], [total], [pair]
    chosen = []
    pair = last[-1]
    while pair >= 0:
        chosen.append(pair)
        pair = before[pair]
    return np.array(chosen[::-1], dtype=np.int64)
