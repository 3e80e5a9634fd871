"""Geometry from and to well-known binary, and moving it: heights stay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io.untrusted import check_nesting
from treereg_core.transform import FloatArray

Shapes = NDArray[np.object_]


def shapes(binary: list[bytes | None], path: Path) -> Shapes:
    """Geometries (n,) from well-known binary, None where there is none."""
    import shapely

    check_nesting(binary, path)
    try:
        found = shapely.from_wkb(np.array(binary, dtype=object))
    except shapely.errors.ShapelyError as error:
        raise InputError(
            f"{path} has geometry of an unknown kind ({error!s:.60}); export it without curves."
        ) from error
    return np.asarray(found, dtype=object)


def move_shapes(geometry: Shapes, move: Callable[[FloatArray], FloatArray], path: Path) -> Shapes:
    """The geometries with every position moved in the plane."""
    import shapely

    if hasattr(shapely, "has_m") and shapely.has_m(geometry).any():
        raise InputError(f"{path} has measures (M) at its positions, which are not kept; export it without.")
    xyz, owner = shapely.get_coordinates(geometry, include_z=True, return_index=True)
    if not np.isfinite(xyz[:, :2]).all():
        raise InputError(f"{path} has coordinates that are not finite numbers; mend or remove them.")
    xyz[:, :2] = move(xyz[:, :2])
    result = geometry.copy()
    high = shapely.has_z(geometry)
    for which, depth in ((~high, 2), (high, 3)):
        if which.any():
            result[which] = shapely.set_coordinates(geometry[which], xyz[which[owner], :depth])
    return result


def to_wkb(geometry: Shapes) -> list[Any]:
    """Well-known binary of each geometry, None where there is none."""
    import shapely

    found: list[Any] = shapely.to_wkb(geometry, flavor="iso", byte_order=1).tolist()
    return found
