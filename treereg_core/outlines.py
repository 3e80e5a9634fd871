"""Outlines: the canopies of one survey as flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from treereg_core.features import IntArray, frozen_array
from treereg_core.parts import parts

if TYPE_CHECKING:
    from shapely import Geometry


@dataclass(frozen=True, eq=False)
class Outlines:
    """The rings of canopy polygons, for drawing: a tree may have several, holes and separate parts among them.

    - `xy` (k, 2): the corners of all rings, one ring after the other, each closed, counter-clockwise and holes
      clockwise; metres in the survey's working frame, in single precision, a fraction of a millimetre.
    - `ring` (k,): the ring of each corner, ascending.
    - `tree` (r,): the position of each ring's tree in the survey's arrays, ascending.
    """

    xy: NDArray[np.float32]
    ring: IntArray
    tree: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy", frozen_array(self.xy, np.float32))
        object.__setattr__(self, "ring", frozen_array(self.ring, np.int64))
        object.__setattr__(self, "tree", frozen_array(self.tree, np.int64))

    @classmethod
    def of(cls, polygons: Sequence[Geometry] | NDArray[Any]) -> Self:
        """The outlines of polygons and multipolygons, one for each tree, in the order of the trees."""
        taken = (_rings(polygons[part], part.start) for part in parts(len(polygons)))
        xy, corners, tree = zip(*taken, strict=True)
        counts = np.concatenate(corners)
        return cls(np.concatenate(xy), np.repeat(np.arange(len(counts)), counts), np.concatenate(tree))


def _rings(polygons: Sequence[Geometry] | NDArray[Any], first: int) -> tuple[NDArray[np.float32], IntArray, IntArray]:
    """The corners of the rings of some polygons, how many each has, and its tree, of which `first` is the first."""
    import shapely

    each, tree_of_part = shapely.get_parts(polygons, return_index=True)
    rings, part_of_ring = shapely.get_rings(each, return_index=True)
    outer = np.append(True, np.diff(part_of_ring) > 0)[: len(rings)]
    turned = shapely.is_ccw(rings) != outer
    rings[turned] = shapely.reverse(rings[turned])
    xy = shapely.get_coordinates(rings).astype(np.float32)
    return xy, shapely.get_num_coordinates(rings), first + tree_of_part[part_of_ring]
