"""Counts for the network's tables, from trees of which it is known, or half known, what they are."""

from __future__ import annotations

import numpy as np

from treereg_bn_landmarks.structure import EVIDENCE, OPTIONAL, PARENTS, STATES, shape
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

MOST_COUNTED = 2000
"""More trees count as if they were so many, so that no single survey outweighs what others taught."""


def count(evidence: IntArray, real: FloatArray, landmark: FloatArray) -> dict[str, FloatArray]:
    """How often each node's states go with those of its parents, for trees with this evidence (n, nodes).

    `real` and `landmark` (n,) are the probabilities of the hidden nodes: 0 or 1 where the truth is known, else each
    tree counts in parts (expectation maximisation).
    """
    cases = ((0, 0, 1 - real), (1, 0, real - landmark), (1, 1, landmark))
    counts = {node: np.zeros(shape(node)) for node in STATES}
    for is_real, is_landmark, weight in cases:
        states = dict(zip(EVIDENCE, evidence.T, strict=True))
        states["real"] = np.full(len(evidence), is_real)
        states["landmark"] = np.full(len(evidence), is_landmark)
        for node, table in counts.items():
            names = (*PARENTS[node], node)
            known = np.ones(len(evidence), dtype=bool)
            for name in set(names) & set(OPTIONAL):
                known &= states[name] < len(STATES[name])
            flat = np.ravel_multi_index([states[name][known] for name in names], table.shape)
            table += np.bincount(flat, weight[known], table.size).reshape(table.shape)
    return counts


def tempered(counts: dict[str, FloatArray], trees: int) -> dict[str, FloatArray]:
    """The counts of so many trees, scaled down where there are more than `MOST_COUNTED`."""
    scale = min(1.0, MOST_COUNTED / max(trees, 1))
    return {node: scale * table for node, table in counts.items()}
