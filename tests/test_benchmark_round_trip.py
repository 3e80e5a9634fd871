"""The benchmark of the round trip: its figures are those of images that are off by what it says."""

from __future__ import annotations

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine as Geotransform

from benchmarks import round_trip
from treereg_core.io import read_raster
from treereg_core.transform import Affine, Rigid


def wave(shift):
    """A smooth image (3, 200, 300) of long waves, moved along columns by so many pixels."""
    row, column = np.mgrid[:200, :300]
    grey = 120 + 60 * np.sin((column - shift) / 11) + 40 * np.cos(row / 7)
    return np.repeat(grey[None], 3, axis=0).astype(np.float32)


def test_a_shift_leaves_what_the_slope_of_the_image_makes_of_it(tmp_path):
    paths = []
    for name, shift in (("original", 0.0), ("exact", 0.0), ("found", 0.2)):
        paths.append(tmp_path / f"{name}.tif")
        grid = Geotransform(0.1, 0, 343_000, 0, -0.1, 6_306_000)
        profile = {"driver": "GTiff", "width": 300, "height": 200, "count": 3, "dtype": "float32"}
        with rasterio.open(paths[-1], "w", **profile, crs="EPSG:32734", transform=grid) as file:
            file.write(wave(shift))
    moved = Rigid(np.eye(2), (0.02, 0.0))
    away = round_trip.off(read_raster(paths[0]).grid, Affine.identity(), moved)
    np.testing.assert_allclose(away, np.broadcast_to((0.2, 0.0), (200, 300, 2)), atol=1e-6)
    left = round_trip.left("wave", tuple(paths), away)
    assert left.error == pytest.approx(0.2, rel=1e-4)
    assert left.exact == 0
    assert left.found == left.between == pytest.approx(left.expected, rel=0.02)


def test_the_round_trip_leaves_what_resampling_leaves():
    own, resampled, other = round_trip.trials(3, 120, "icp")
    assert own.error < 0.01
    assert own.found == own.exact == 0
    assert resampled.exact > 0
    assert resampled.found == pytest.approx(resampled.exact, rel=0.001)
    assert 0.01 < other.error < 2
    assert 0.4 < other.between / other.expected < 2.5
    assert other.found - other.exact < 0.1 * other.exact
