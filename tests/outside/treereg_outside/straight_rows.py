"""Rows of orchards that were planted straight."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from treereg_core.features import FeatureSet
from treereg_core.method import Context, RowDetector
from treereg_core.pair import Rows


class StraightRows(RowDetector):
    """Straight rows by the Hough transform (Duda & Hart 1972, doi:10.1145/361237.361242).

    Good for straight and parallel rows only.
    """

    name = "straight_rows"

    width: float = Field(
        0.3,
        gt=0,
        le=1,
        description="farthest a tree is from the row's middle",
        json_schema_extra={"unit": "tree spacings"},
    )

    def detect(self, features: FeatureSet, context: Context) -> Rows:
        """The direction in which the trees' profile is sharpest, and its peaks."""
        spacing = features.spacing
        if spacing == 0:
            return Rows(())
        xy = features.xy - features.xy.mean(axis=0)
        radius = float(np.hypot(*xy.T).max())
        angles = np.linspace(0, np.pi, int(np.ceil(np.pi * radius / (spacing / 6))), endpoint=False)
        sharpness = [(self._profile(self._across(xy, a), spacing)[1] ** 2).sum() for a in angles]
        angle = angles[int(np.argmax(sharpness))]
        across = self._across(xy, angle)
        grid, density = self._profile(across, spacing)
        peaks = grid[find_peaks(np.pad(density, 1), distance=10)[0] - 1]
        row = np.abs(across[:, None] - peaks).argmin(axis=1)
        row[np.abs(across - peaks[row]) > self.width * spacing] = -1
        along = self._across(xy, angle - np.pi / 2)
        order = np.argsort(along, kind="stable")
        trees = (features.ids[order[row[order] == k]] for k in range(len(peaks)))
        return Rows(tuple(ids for ids in trees if len(ids) > 1))

    @staticmethod
    def _across(xy: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
        return np.asarray(xy @ np.array([-np.sin(angle), np.cos(angle)]))

    @staticmethod
    def _profile(across: NDArray[np.float64], spacing: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        step = spacing / 12
        start = across.min() - spacing
        count = np.bincount(np.round((across - start) / step).astype(int))
        density = gaussian_filter1d(np.pad(count, (0, 12)).astype(float), 1.5)
        return start + step * np.arange(len(density)), density
