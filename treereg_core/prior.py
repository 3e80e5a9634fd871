"""What the files' own georeference says about a placement beforehand."""

from __future__ import annotations

import math

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.transform import Affine, FloatArray

ROTATION_SD_DEG = 5.0


def log_prior(reference_from_source: Affine, source: FeatureSet, georeference_sd: float | None) -> float:
    """Natural log of the prior density of a placement, up to a constant; 0 when nothing is known of the georeference.

    The shift of the source's centroid is normal with `georeference_sd` metres per axis. Maps are turned by far less
    than they are shifted, but a turn is not bounded by a shift: the rotation has a Student density (3 degrees of
    freedom, scale 5 degrees), which makes a half turn unlikely and never impossible.
    """
    shift = np.asarray(reference_from_source.shift)[None]
    return float(log_priors(reference_from_source, shift, source, georeference_sd)[0])


def log_priors(template: Affine, shifts: FloatArray, source: FeatureSet, georeference_sd: float | None) -> FloatArray:
    """The same of many placements (k,), which have the linear part of `template` and these shifts (k, 2), metres."""
    if georeference_sd is None:
        return np.zeros(len(shifts))
    centroid = source.xy.mean(axis=0)
    moved = template.linear @ centroid + shifts - centroid
    turn = template.rotation_deg / ROTATION_SD_DEG
    return np.asarray(-(moved**2).sum(axis=1) / (2 * georeference_sd**2) - 2 * math.log1p(turn * turn / 3))


def log_prior_at_home(
    reference_from_source: Affine, source: FeatureSet, georeference_sd: float | None, within: float
) -> float:
    """Log-odds beforehand that the truth lies within a distance, metres, of a placement; at least 0.

    From the same density of the shift, which falls off from the files' own georeference on all sides.
    """
    if georeference_sd is None:
        return 0.0
    centroid = source.xy.mean(axis=0)
    shift = reference_from_source(centroid[None])[0] - centroid
    return max((within**2 - float(shift @ shift)) / (2 * georeference_sd**2), 0.0)
