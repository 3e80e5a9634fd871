"""Rotation between two surveys from the vectors between their own trees, before any shift is known."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from treereg_core.features import FeatureSet
from treereg_core.transform import FloatArray

# Directions over a half turn, and distances in tree spacings.
BINS = 720
RINGS = np.arange(0.6, 10.01, 0.2)
RADIUS = (RINGS[:-1] + RINGS[1:]) / 2
# Pairs of trees that are looked at, at most about.
PAIRS = 200_000
# Error of a vector between two trees, in tree spacings: it blurs directions the more the nearer they stand.
NOISE = 0.08
# Degrees between two rotations that are told apart.
APART = 2.0


def vector_rose(features: FeatureSet, spacing: float, rng: np.random.Generator) -> FloatArray:
    """How often two trees stand at a distance and in a direction, (rings, bins).

    Rings are a fifth of a spacing wide, from 0.6 to 10 spacings; bins divide a half turn, since every pair of trees
    looks both ways. Large surveys are sampled.
    """
    xy, reach = features.xy, RINGS[-1] * spacing
    probe = cKDTree(xy[:: max(1, len(xy) // 50)])
    per_tree = max(features.tree.count_neighbors(probe, reach) / probe.n, 1.0)
    anchors = xy
    if len(xy) * per_tree / 2 > PAIRS:
        anchors = xy[rng.choice(len(xy), min(len(xy), int(PAIRS / per_tree) + 1), replace=False)]
    if anchors is xy:
        i, j = features.tree.query_pairs(reach, output_type="ndarray").T
    else:
        near = cKDTree(anchors).sparse_distance_matrix(features.tree, reach, output_type="ndarray")
        i, j = near["i"], near["j"]
    vector = xy[j] - anchors[i]
    ring = np.floor((np.hypot(*vector.T) / spacing - RINGS[0]) / (RINGS[1] - RINGS[0])).astype(np.int64)
    keep = (ring >= 0) & (ring < len(RADIUS))
    ring, vector = ring[keep], vector[keep]
    angle = np.arctan2(vector[:, 1], vector[:, 0]) * (BINS / np.pi)
    low = np.floor(angle).astype(np.int64)
    part = angle - low
    at = ring * BINS
    size = len(RADIUS) * BINS
    rose = np.bincount(at + low % BINS, weights=1 - part, minlength=size)
    rose += np.bincount(at + (low + 1) % BINS, weights=part, minlength=size)
    return np.asarray(rose, dtype=np.float64).reshape(-1, BINS)


def rotations(
    reference: FeatureSet, source: FeatureSet, spacing: float, rng: np.random.Generator, count: int
) -> tuple[FloatArray, FloatArray]:
    """The likeliest rotations of source onto reference, degrees in 0..180 and how well each fits, best first.

    The half turn cannot be told from directions of pairs: each rotation stands for itself and its twin. The two roses
    are correlated ring by ring, each blurred by the noise of tree positions at its radius.
    """
    a = np.fft.rfft(vector_rose(reference, spacing, rng), axis=1)
    b = a if source is reference else np.fft.rfft(vector_rose(source, spacing, rng), axis=1)
    noise = NOISE / RADIUS * BINS / np.pi
    blur = np.exp(-2 * (np.pi * np.outer(noise, np.arange(a.shape[1]) / BINS)) ** 2)
    a, b = a * blur, b * blur
    a[:, 0] = b[:, 0] = 0
    energy = np.sqrt((np.abs(a) ** 2).sum(axis=1) * (np.abs(b) ** 2).sum(axis=1))
    curve = np.fft.irfft((a * np.conj(b) / np.maximum(energy, 1e-12)[:, None]).sum(axis=0), n=BINS)
    before, after = np.roll(curve, 1), np.roll(curve, -1)
    tops = np.flatnonzero((curve > before) & (curve >= after))
    chosen: list[int] = []
    for i in tops[np.argsort(-curve[tops])]:
        if all(min((i - j) % BINS, (j - i) % BINS) > APART * BINS / 180 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == count:
            break
    at = np.array(chosen, dtype=np.int64)
    bend = before[at] - 2 * curve[at] + after[at]
    fine = at + np.clip((before[at] - after[at]) / (2 * np.where(bend < 0, bend, -1)), -0.5, 0.5)
    return fine * (180 / BINS), curve[at]
