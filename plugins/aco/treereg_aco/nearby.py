"""The trees around each tree, some trees at a time: arrays of all of them at once would fill gigabytes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.transform import FloatArray

# So many trees are looked at at a time.
AT_A_TIME = 10_000


def nearby(features: FeatureSet, ranks: Sequence[int]) -> Iterator[tuple[IntArray, FloatArray, IntArray]]:
    """Positions of some trees (m,), distances in metres and positions (m, k) of the trees of these ranks around each.

    Rank 1 is the nearest, mostly the tree itself. Trees come in the order of space, in which they are found fastest.
    """
    order = np.asarray(features.tree.indices, dtype=np.int64)
    for begin in range(0, len(order), AT_A_TIME):
        some = order[begin : begin + AT_A_TIME]
        distance, near = features.tree.query(features.xy[some], k=list(ranks))
        yield some, np.asarray(distance), np.asarray(near, dtype=np.int64)
