"""Screening: many placements refined and scored at once on a sample of the trees, to find the few worth a full look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.evidence import Evidence
from treereg_core.features import BoolArray, IntArray, nearest
from treereg_core.transform import Affine, FloatArray


@dataclass(frozen=True, eq=False)
class Screened:
    """Placements after a brief refinement (k,), and the log-likelihood that sets each apart from all others (k,)."""

    transforms: tuple[Affine, ...]
    score: FloatArray


def screen(evidence: Evidence, transforms: tuple[Affine, ...], sample: IntArray, rounds: int = 2) -> Screened:
    """Refine placements by `rounds` of rigid motion and score them on the source trees at positions `sample`.

    The typical placement is the decoy: a score is the log-likelihood ratio of a placement's own match rate, residuals
    and agreement of attributes against the median of all, each counted only where it is better.
    """
    linear = np.array([t.linear for t in transforms])
    shift = np.array([t.shift for t in transforms])
    xy = evidence.source.features.xy[sample]
    reference = evidence.reference.features
    for last in [False] * rounds + [True]:
        moved = xy @ linear.transpose(0, 2, 1) + shift[:, None]
        distance, target = nearest(reference.tree, moved.reshape(-1, 2), evidence.gate, threads=evidence.threads)
        distance, target = distance.reshape(moved.shape[:2]), target.reshape(moved.shape[:2])
        met = target < len(reference)
        if last:
            break
        to = reference.xy[np.where(met, target, 0)]
        turn, step = _rigid_steps(moved, to, met)
        linear = turn @ linear
        shift = (turn @ shift[..., None])[..., 0] + step
    covered = evidence.reference.footprint.covers(moved.reshape(-1, 2)).reshape(met.shape) | met
    score = _score(evidence, sample, distance, target, met, covered)
    kinds = [type(t) for t in transforms]
    return Screened(tuple(k(a, s) for k, a, s in zip(kinds, linear, shift, strict=True)), score)


def _rigid_steps(moved: FloatArray, to: FloatArray, met: BoolArray) -> tuple[FloatArray, FloatArray]:
    """For each placement (k, m, 2) the rigid motion that fits its met trees best; none where fewer than three meet."""
    weight = (met / np.maximum(met.sum(axis=1, keepdims=True), 1))[:, None]
    p_mean, q_mean = (weight @ moved)[:, 0], (weight @ to)[:, 0]
    p, q = moved - p_mean[:, None], to - q_mean[:, None]
    cos = (weight @ (p * q).sum(axis=2)[..., None])[:, 0, 0]
    sin = (weight @ (p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])[..., None])[:, 0, 0]
    enough = (met.sum(axis=1) >= 3) & (cos > 0)
    angle = np.where(enough, np.arctan2(sin, np.where(enough, cos, 1)), 0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    step = np.where(enough[:, None], q_mean - (turn @ p_mean[..., None])[..., 0], 0)
    return turn, step


def _score(
    evidence: Evidence, sample: IntArray, distance: FloatArray, target: IntArray, met: BoolArray, covered: BoolArray
) -> FloatArray:
    pairs, seen = met.sum(axis=1), covered.sum(axis=1)
    rate = (pairs + 0.5) / (seen + 1)
    # Most of what meets is on the lattice; what is askew is no measure, or every lattice position would look right.
    usual = float(np.clip(_weighted_quantile(rate, pairs, 0.75), 0.02, 0.98))
    better = np.clip(rate, usual, 0.999)
    score = seen * (better * np.log(better / usual) + (1 - better) * np.log((1 - better) / (1 - usual)))
    square = np.where(met, distance, 0) ** 2
    variance = (square.sum(axis=1) + 0.02 * evidence.gate**2) / (2 * pairs + 2)
    ratio = np.minimum(variance / _weighted_quantile(variance, pairs, 0.25), 1)
    score = score + pairs * (ratio - 1 - np.log(ratio))
    for name in evidence.names:
        u = np.where(met, evidence.reference.scores[name][np.where(met, target, 0)], 0)
        v = np.where(met, evidence.source.scores[name][sample], 0)
        power = np.sqrt((u * u).sum(axis=1) * (v * v).sum(axis=1))
        r = np.clip((u * v).sum(axis=1) / np.maximum(power, 1e-9), 0, 0.95)
        score = score - pairs / 2 * np.log(1 - r * r)
    return np.asarray(score)


def _weighted_quantile(values: FloatArray, weights: FloatArray, q: float) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, q * below[-1])])
