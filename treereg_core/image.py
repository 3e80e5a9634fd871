"""Image: a picture of a survey in its working frame, small enough to be held, and how well two agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import frozen_array
from treereg_core.transform import Affine, FloatArray

LEAST_COMMON = 0.02
"""Images that share less than this part of the reference's valid area are not compared."""


@dataclass(frozen=True, eq=False)
class Image:
    """Grey values (rows, columns), NaN where there is no picture.

    `frame_from_pixel` takes (column, row), counted at the centres of pixels, to the working frame, metres.
    """

    grey: FloatArray
    frame_from_pixel: Affine

    def __post_init__(self) -> None:
        object.__setattr__(self, "grey", frozen_array(self.grey, np.float32))

    def moved(self, transform: Affine) -> Image:
        """The same picture elsewhere in the frame."""
        return Image(self.grey, transform @ self.frame_from_pixel)


def agreement(reference: Image, source: Image, reference_from_source: Affine) -> tuple[float, float] | None:
    """Mean squared difference and normalised cross-correlation over the area that both show.

    The source is resampled bilinearly at the reference's pixels. None when they share too little, or one of them shows
    nothing there.
    """
    from scipy.ndimage import map_coordinates

    row, column = np.nonzero(np.isfinite(reference.grey))
    source_from_frame = (reference_from_source @ source.frame_from_pixel).inverse()
    at = source_from_frame(reference.frame_from_pixel(np.column_stack([column, row]).astype(np.float64)))
    values = map_coordinates(source.grey, at.T[::-1], order=1, mode="constant", cval=np.nan)
    both = np.isfinite(values)
    if np.count_nonzero(both) < max(LEAST_COMMON * len(row), 2):
        return None
    a, b = reference.grey[row[both], column[both]].astype(np.float64), values[both].astype(np.float64)
    mse = float(np.mean((a - b) ** 2))
    a, b = a - a.mean(), b - b.mean()
    power = float(np.sqrt((a @ a) * (b @ b)))
    return (mse, float(a @ b) / power) if power > 0 else None
