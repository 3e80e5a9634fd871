"""What a survey makes of an orchard: detections with their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from treereg_core.features import FeatureSet, IntArray
from treereg_core.simulate.orchard import Orchard
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.view import View
from treereg_core.transform import FloatArray

FALSE_DROP_SD = 2.5
"""How far the confidences of false detections lie lower, in their standard deviations, at full information."""
HALVES_APART_RADII = 0.85
"""Distance between the centroids of the two halves of a disc, in radii."""


@dataclass(frozen=True, eq=False)
class Visit:
    """One flight over an orchard: what is in view, which trees live (n,), and crown widths over the reference's.

    `missed` (n,) is how likely each tree is missed; without it all are as the scene says.
    """

    view: View
    alive: NDArray[np.bool_]
    growth: float
    missed: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Detections:
    """Features and the trees behind each: `trees` (n, 2) holds positions in the orchard, -1 for none."""

    xy: FloatArray
    area: FloatArray
    confidence: FloatArray
    trees: IntArray

    def features(self) -> FeatureSet:
        """The same as a survey would deliver it: without the truth."""
        return FeatureSet.of(self.xy, self.confidence, self.area)

    def take(self, index: IntArray) -> Detections:
        """The detections at these positions, in that order."""
        return Detections(self.xy[index], self.area[index], self.confidence[index], self.trees[index])


def detect(orchard: Orchard, scene: Scene, visit: Visit, rng: np.random.Generator) -> Detections:
    """All detections of one survey in the orchard's frame, in random order."""
    in_view = visit.alive & visit.view.sees(orchard.xy)
    found = in_view & (rng.random(len(in_view)) >= (scene.missed if visit.missed is None else visit.missed))
    measured = _measured(orchard, scene, visit.growth, rng)

    first = _first_of_merged(orchard, found, scene.merged, rng)
    second = np.roll(first, 1)
    split = found & ~first & ~second & (rng.random(len(found)) < scene.split)
    single = found & ~first & ~second & ~split

    parts = (
        measured.take(np.flatnonzero(single)),
        _merge(measured.take(np.flatnonzero(first)), measured.take(np.flatnonzero(second))),
        *_halves(measured.take(np.flatnonzero(split)), rng),
        _false(orchard, scene, visit, round(scene.false * np.count_nonzero(in_view)), rng),
    )
    together = Detections(
        np.concatenate([part.xy for part in parts]),
        np.concatenate([part.area for part in parts]),
        np.concatenate([part.confidence for part in parts]),
        np.concatenate([part.trees for part in parts]),
    )
    return together.take(rng.permutation(len(together.xy)))


def _measured(orchard: Orchard, scene: Scene, growth: float, rng: np.random.Generator) -> Detections:
    """Every tree as this survey would measure it."""
    n = len(orchard.xy)
    area_noise = scene.area_variation * math.sqrt(1 - scene.area_persistence) * rng.standard_normal(n)
    common = scene.confidence_information
    plainness = math.sqrt(common) * orchard.plainness + math.sqrt(1 - common) * rng.standard_normal(n)
    return Detections(
        xy=orchard.xy + scene.jitter * rng.standard_normal((n, 2)),
        area=orchard.area * growth**2 * np.exp(area_noise),
        confidence=_confidence(plainness, scene),
        trees=np.column_stack([np.arange(n), np.full(n, -1)]),
    )


def _confidence(plainness: FloatArray, scene: Scene) -> FloatArray:
    log_odds = math.log(scene.confidence / (1 - scene.confidence)) + scene.confidence_variation * plainness
    return np.asarray(1 / (1 + np.exp(-log_odds)))


def _first_of_merged(
    orchard: Orchard, found: NDArray[np.bool_], share: float, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which trees are joined with the next one of their row; no tree takes part twice."""
    next_to = (np.diff(orchard.row) == 0) & (np.diff(orchard.column) == 1) & found[:-1] & found[1:]
    first = np.append(next_to, False) & (rng.random(len(found)) < share)
    first[1:] &= ~first[:-1]
    return first


def _merge(first: Detections, second: Detections) -> Detections:
    area = first.area + second.area
    xy = (first.xy * first.area[:, None] + second.xy * second.area[:, None]) / area[:, None]
    trees = np.column_stack([first.trees[:, 0], second.trees[:, 0]])
    return Detections(xy, area, np.maximum(first.confidence, second.confidence), trees)


def _halves(whole: Detections, rng: np.random.Generator) -> tuple[Detections, Detections]:
    """Both parts of split canopies; their common centroid and area are those of the whole."""
    n = len(whole.xy)
    share, angle = rng.uniform(0.3, 0.7, n), rng.uniform(0, 2 * np.pi, n)
    apart = HALVES_APART_RADII * np.sqrt(whole.area / np.pi)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return (
        Detections(whole.xy + apart * (1 - share)[:, None], whole.area * share, whole.confidence, whole.trees),
        Detections(whole.xy - apart * share[:, None], whole.area * (1 - share), whole.confidence, whole.trees),
    )


def _false(orchard: Orchard, scene: Scene, visit: Visit, count: int, rng: np.random.Generator) -> Detections:
    """Detections of no tree: mostly small, less confident, uniform in view up to one spacing beyond the trees."""
    reach = max(scene.row_spacing, scene.spacing)
    ground = cKDTree(orchard.positions)
    low, high = orchard.positions.min(axis=0) - reach, orchard.positions.max(axis=0) + reach
    xy = np.zeros((0, 2))
    while len(xy) < count:
        drawn = rng.uniform(low, high, (3 * (count - len(xy)) + 16, 2))
        drawn = drawn[visit.view.sees(drawn)]
        distance, _ = ground.query(drawn, distance_upper_bound=reach)
        xy = np.concatenate([xy, drawn[np.isfinite(distance)]])
    typical = float(np.median(orchard.area)) * visit.growth**2
    plainness = rng.standard_normal(count) - FALSE_DROP_SD * scene.confidence_information
    spread = 2 * scene.area_variation
    return Detections(
        xy=xy[:count],
        area=typical * np.exp(-spread + spread * rng.standard_normal(count)),
        confidence=_confidence(plainness, scene),
        trees=np.full((count, 2), -1),
    )
