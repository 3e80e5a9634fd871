"""Canopy outlines with exactly the centroid and area that a detection has."""

from __future__ import annotations

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.transform import FloatArray

CORNERS = 20


def canopies(features: FeatureSet, rng: np.random.Generator) -> FloatArray:
    """A blobby polygon for each of n features: (n, CORNERS, 2) metres, counter-clockwise, first corner not repeated.

    A circle with a few smooth waves, then moved and scaled until the polygon's own centroid and area are those of the
    feature.
    """
    n = len(features)
    angle = np.arange(CORNERS) * (2 * np.pi / CORNERS)
    radius = np.ones((n, CORNERS))
    for order in (2, 3, 4):
        phase = rng.uniform(0, 2 * np.pi, (n, 1))
        radius += rng.uniform(0.02, 0.3 / order, (n, 1)) * np.cos(order * angle + phase)
    ring = radius[:, :, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    area, centroid = _area_and_centroid(ring)
    scale = np.sqrt(features.area / area)
    return np.asarray((ring - centroid[:, None]) * scale[:, None, None] + features.xy[:, None])


def _area_and_centroid(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of each polygon (n, k, 2): area (n,) and centroid (n, 2), by the shoelace formula."""
    after = np.roll(ring, -1, axis=1)
    cross = ring[:, :, 0] * after[:, :, 1] - ring[:, :, 1] * after[:, :, 0]
    area = cross.sum(axis=1) / 2
    return area, ((ring + after) * cross[:, :, None]).sum(axis=1) / (6 * area[:, None])
