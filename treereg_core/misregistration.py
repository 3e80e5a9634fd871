"""Misregistration on purpose: trees turned about their centroid, then shifted; what trials and whole surveys share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from treereg_core.features import FeatureSet
from treereg_core.transform import FloatArray, Rigid

ROTATION_SD_DEG, TRANSLATION_SD_M = 1.0, 3.0
"""How far surveys are misregistered where nobody says it: 1 sd, the shift's for each axis."""


def drawn(seed: int, rotation_sd: float, translation_sd: float) -> tuple[float, FloatArray]:
    """A turn, degrees, and a shift (2,), metres for each axis, from normal distributions; the same for the same seed.

    Standard deviations only scale what is drawn.
    """
    rng = np.random.default_rng(seed)
    return rotation_sd * float(rng.standard_normal()), translation_sd * rng.standard_normal(2)


def misregistration(source: FeatureSet, rotation_deg: float, shift: ArrayLike) -> Rigid:
    """A turn about the trees' centroid, degrees, counter-clockwise, then a shift (2,), metres."""
    return Rigid.turn(rotation_deg, about=source.xy.mean(axis=0), shift=shift)
