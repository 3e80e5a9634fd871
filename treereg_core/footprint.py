"""Footprint: the area in which a survey would have shown a tree, known from its trees alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from treereg_core.features import IntArray
from treereg_core.transform import FloatArray


@dataclass(frozen=True, eq=False)
class Footprint:
    """The ground that a survey's trees cover, gaps and enclosed holes included, on a grid.

    It ends at the outermost trees: what lies outside may be another orchard, a road, or simply not flown, so that
    nothing may be concluded from a tree that is missing there. `covers` answers for any point.
    """

    origin: FloatArray
    cell: float
    mask: NDArray[np.bool_]

    @classmethod
    def of(cls, xy: ArrayLike, reach: float) -> Footprint:
        """The closing of the trees `xy` (n, 2) by a disc of radius `reach` metres, its holes filled.

        Gaps narrower than twice the reach belong to it; its edge runs within a tenth of the reach of the outermost
        trees.
        """
        points = np.asarray(xy, dtype=np.float64)
        cell = reach / 5
        size = np.ptp(points, axis=0)
        cell = max(cell, float(np.sqrt(np.prod(size + 2 * reach) / 4e6)))
        margin = int(np.ceil(reach / cell)) + 2
        origin = points.min(axis=0) - margin * cell
        shape = tuple(np.ceil(size / cell).astype(int) + 2 * margin + 1)
        free = np.ones(shape, dtype=bool)
        i, j = np.round((points - origin) / cell).astype(int).T
        free[i, j] = False
        near = ndimage.distance_transform_edt(free) <= reach / cell
        closed = ndimage.distance_transform_edt(near) >= 0.9 * reach / cell
        return cls(origin, cell, ndimage.binary_fill_holes(closed))

    @property
    def points(self) -> FloatArray:
        """The centres of its cells, (n, 2) metres."""
        return np.argwhere(self.mask) * self.cell + self.origin

    def covers(self, xy: FloatArray) -> NDArray[np.bool_]:
        """Which of the points (n, 2) lie in it."""
        i: IntArray = np.round((xy - self.origin) / self.cell).astype(np.int64)
        inside = ((i >= 0) & (i < self.mask.shape)).all(axis=1)
        result = np.zeros(len(xy), dtype=bool)
        k = i[inside]
        result[inside] = self.mask[k[:, 0], k[:, 1]]
        return result
