"""FeatureSet: the trees of one survey, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from treereg_core.threads import concurrently
from treereg_core.transform import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Points from which threads gain more than they cost.
WORTH_THREADS = 20_000


def frozen_array(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only array; a copy, unless `values` already is one."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable:
        array = array.copy()
        array.setflags(write=False)
    return array


def largest(values: FloatArray, count: int) -> IntArray:
    """Positions of the `count` largest of `values` (n,), largest first and of equal ones the first first."""
    if count >= len(values):
        return np.argsort(-values, kind="stable")
    among = np.flatnonzero(values >= np.partition(values, -count)[-count]) if count else np.arange(0)
    return among[np.argsort(-values[among], kind="stable")][:count]


def nearest(
    tree: cKDTree,
    points: FloatArray,
    within: float,
    count: int = 1,
    threads: int = 1,
    order: IntArray | None = None,
) -> tuple[FloatArray, IntArray]:
    """Distances and indices of the points of a tree nearest to `points` (n, 2 or 3): (n,), or (n, count) if several.

    One that is missing within the distance `within` has an infinite distance and the index `tree.n`. `order` (n,) is
    that in which the points are looked up: one that keeps neighbours together, such as the `indices` of a tree of
    these points, makes the search in large fields several times faster.
    """
    if order is not None:
        distance, index = nearest(tree, points[order], within, count, threads)
        back = np.empty(len(order), dtype=np.int64)
        back[order] = np.arange(len(order))
        return distance[back], index[back]

    def query(some: FloatArray) -> tuple[FloatArray, IntArray]:
        distance, index = tree.query(some, k=count, distance_upper_bound=within)
        return np.asarray(distance), np.asarray(index, dtype=np.int64)

    if threads == 1 or len(points) <= WORTH_THREADS:
        return query(points)
    # scipy's own threads (`workers`) go on writing into freed memory when a user interrupts; a pool waits for its own
    distances, indices = zip(*concurrently(query, np.array_split(points, threads), threads), strict=True)
    return np.concatenate(distances), np.concatenate(indices)


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """The trees of one survey: one entry per usable detection, in the order of the input file.

    - `ids` (n,): index of the feature in its file; unique, and kept when trees are filtered out.
    - `xy` (n, 2): centroid, metres, in the survey's own working frame.
    - `confidence` (n,): the detector's, 0 to 1.
    - `area` (n,): of the canopy polygon, square metres, positive.
    - `weight` (n,): how much a fit should trust the tree, 0 or more; 1 unless a filter says otherwise.
    - `attributes`: further arrays (n,) by name, such as a height.

    All arrays are read-only. Use `take` for a subset and `replace` for other values. Raises `ValueError` when lengths
    differ, a number is not finite, or ids repeat.
    """

    ids: IntArray
    xy: FloatArray
    confidence: FloatArray
    area: FloatArray
    weight: FloatArray
    attributes: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.ids)
        set_ = object.__setattr__
        set_(self, "ids", frozen_array(self.ids, np.int64))
        for name in ("xy", "confidence", "area", "weight"):
            array = frozen_array(getattr(self, name))
            if array.shape != ((n, 2) if name == "xy" else (n,)):
                raise ValueError(f"{name} has shape {array.shape}, but there are {n} trees")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} holds a number that is not finite")
            set_(self, name, array)
        if len(np.unique(self.ids)) != n:
            raise ValueError("tree ids repeat")
        named = {name: frozen_array(values) for name, values in self.attributes.items()}
        for name, array in named.items():
            if array.shape != (n,):
                raise ValueError(f"attribute {name!r} has shape {array.shape}, but there are {n} trees")
        set_(self, "attributes", MappingProxyType(named))

    @classmethod
    def of(
        cls,
        xy: ArrayLike,
        confidence: ArrayLike | None = None,
        area: ArrayLike | None = None,
        **attributes: ArrayLike,
    ) -> FeatureSet:
        """From plain arrays: ids count from 0, missing confidences are 1, missing areas 1 square metre."""
        points = np.asarray(xy, dtype=np.float64)
        points = points if points.size else np.empty((0, 2))
        n = len(points)
        return cls(
            ids=np.arange(n),
            xy=points,
            confidence=np.ones(n) if confidence is None else np.asarray(confidence, dtype=np.float64),
            area=np.ones(n) if area is None else np.asarray(area, dtype=np.float64),
            weight=np.ones(n),
            attributes={name: np.asarray(values, dtype=np.float64) for name, values in attributes.items()},
        )

    def __len__(self) -> int:
        return len(self.ids)

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, f.name) for f in fields(self)]
        return type(self), (*values[:-1], dict(self.attributes))

    def take(self, index: ArrayLike) -> FeatureSet:
        """The trees at these positions (or under this mask), in that order, ids kept."""
        i = np.asarray(index)
        return FeatureSet(
            self.ids[i],
            self.xy[i],
            self.confidence[i],
            self.area[i],
            self.weight[i],
            {name: values[i] for name, values in self.attributes.items()},
        )

    def replace(self, **changes: Any) -> FeatureSet:
        """The same trees with some fields changed, `features.replace(weight=w)`."""
        return FeatureSet(**{**{f.name: getattr(self, f.name) for f in fields(self)}, **changes})

    def positions(self, ids: ArrayLike) -> IntArray:
        """Where these ids stand in the arrays, -1 for an id that is not here."""
        wanted = np.asarray(ids, dtype=np.int64)
        if len(self) == 0:
            return np.full(wanted.shape, -1, dtype=np.int64)
        slot = np.minimum(np.searchsorted(self.ids, wanted, sorter=self._by_id), len(self) - 1)
        found = self._by_id[slot]
        return np.where(self.ids[found] == wanted, found, -1)

    @cached_property
    def _by_id(self) -> IntArray:
        """The positions in the order of the ids; rows ask one after the other where their trees stand."""
        return np.argsort(self.ids)

    @cached_property
    def tree(self) -> cKDTree:
        """A k-d tree over `xy`, built once."""
        return cKDTree(self.xy)

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """What others derive from these trees and will want again, by a key of their own; it goes when the trees go."""
        return {}

    @cached_property
    def spacing(self) -> float:
        """Median distance to the nearest other tree, metres; 0 when no two trees stand apart."""
        if len(self) < 2:
            return 0.0
        distance, _ = nearest(self.tree, self.xy[self.tree.indices], np.inf, 2)
        return float(np.median(distance[:, 1]))
