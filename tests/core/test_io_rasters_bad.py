"""Rasters that cannot be moved: a sentence before the work, and nothing left behind."""

from __future__ import annotations

import math
import shutil
import time
import warnings
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from io_files import CRS, ORIGIN
from raster_files import GRIDS, MOTION, after, misplaced, north_up, painted, placed, write
from rasterio.transform import Affine as Geotransform

from treereg_core.errors import InputError
from treereg_core.io.grid import Motion
from treereg_core.io.raster import read_raster
from treereg_core.io.rasters import RasterOptions, raster_job
from treereg_core.transform import Affine

TREES = np.array([(0.0, 0.0), (48, 48)]) + ORIGIN


def job(path: Path, **options: Any) -> Any:
    return raster_job(read_raster(path), MOTION, None, RasterOptions(**options), path.parent)


def refused(path: Path, *words: str, **options: Any) -> None:
    """Moving it is refused with these words, and nothing is written."""
    before = sorted(path.parent.iterdir())
    with pytest.raises(InputError) as error:
        job(path, **options).write(path.parent / "moved.tif")
    assert str(path) in str(error.value) or "moved.tif" in str(error.value)
    assert all(word in str(error.value) for word in words), error.value
    assert sorted(path.parent.iterdir()) == before


def test_without_a_crs_it_is_taken_to_lie_among_the_trees_or_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", np.zeros((1, 240, 240), np.uint8), None, north_up())
    refused(path, "has no CRS", "assign it")
    found = read_raster(path, (CRS, TREES))
    assert found.grid.crs == CRS
    assert found.warnings == (f"{path} has no CRS; it is taken to be in {CRS}, in which it lies at the trees.",)
    with pytest.raises(InputError, match="it would not lie at the trees"):
        read_raster(path, (CRS, TREES + 1000))
    assert read_raster(path, (CRS, None)).warnings
    far = write(tmp_path / "b.tif", np.zeros((1, 240, 240), np.uint8), None, Geotransform(1, 0, 0, 0, -1, 9))
    with pytest.raises(InputError, match="not lie at where EPSG:32734 is used"):
        read_raster(far, (CRS, None))


def test_without_georeference(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(tmp_path / "a.tif", "w", driver="GTiff", width=9, height=9, count=1, dtype="uint8") as file:
            file.write(np.ones((1, 9, 9), np.uint8))
    refused(tmp_path / "a.tif", "no georeference")


@pytest.mark.parametrize("content", [b"", b"II*\0nonsense", b"\x89PNG\r\n\x1a\n", b"no raster"])
def test_no_raster_at_all(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.tif").write_bytes(content)
    refused(tmp_path / "a.tif", "cannot be read as a raster")


@pytest.mark.parametrize("lossless", [True, False])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
def test_cut_off(tmp_path: Path, share: float, lossless: bool) -> None:
    path = painted(tmp_path / "a.tif", bands=3, compress="deflate")
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    refused(path, "cut off", lossless=lossless)


def test_damaged_inside(tmp_path: Path) -> None:
    path = painted(tmp_path / "a.tif", bands=3, compress="deflate")
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 3000] = b"\0" * 3000
    path.write_bytes(content)
    refused(path, "damaged near row")


def test_bombs(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "count": 3, "dtype": "uint8", "crs": CRS, "sparse_ok": True, "compress": "deflate"}
    with rasterio.open(
        tmp_path / "a.tif", "w", width=1_000_000, height=1_000_000, transform=north_up(), tiled=True,
        blockxsize=4096, blockysize=4096, bigtiff="YES", **profile
    ):  # fmt: skip
        pass
    refused(tmp_path / "a.tif", "claims 1000000 x 1000000 pixels")
    with rasterio.open(
        tmp_path / "b.tif", "w", width=20_000, height=20_000, transform=north_up(), tiled=True,
        blockxsize=16_384, blockysize=16_384, **profile
    ):  # fmt: skip
        pass
    refused(tmp_path / "b.tif", "pieces of 16384 x 16384 pixels", "export it again in tiles")


def test_a_disk_that_is_too_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = painted(tmp_path / "a.tif")
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**9, 10**9, 1000))
    refused(path, "MB are free")
    refused(path, "MB are free", lossless=True)


def test_a_disk_that_fills_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rasterio.shutil.copy", full)
    refused(painted(tmp_path / "a.tif"), "no space left on device", "free space")


def test_what_is_not_as_it_was_written_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from treereg_core.io import rasters

    def wrong(plain: Path, path: Path, *_: object) -> None:
        shutil.copy(plain, path)
        with rasterio.open(path, "r+") as file:
            file.write(np.full((1, 1), 7, np.uint8), 1, window=((100, 101), (100, 101)))

    monkeypatch.setattr(rasters, "write_cog", wrong)
    refused(painted(tmp_path / "a.tif"), "not written as it should be")


def test_beside_the_grid(tmp_path: Path) -> None:
    onto = read_raster(write(tmp_path / "g.tif", np.zeros((1, 9, 9), np.uint8), CRS, Geotransform(1, 0, 5, 0, -1, 5)))
    with pytest.raises(InputError, match="shows nothing of the ground"):
        raster_job(read_raster(painted(tmp_path / "a.tif")), MOTION, onto.grid, RasterOptions(), tmp_path)


def test_all_nodata_is_moved_with_a_warning(tmp_path: Path) -> None:
    path = write(tmp_path / "a.tif", np.full((1, 240, 240), -9999, np.float32), *placed("north up"), nodata=-9999)
    assert job(path).write(tmp_path / "moved.tif") == (
        f"{path} holds no data where it was moved; check what it shows.",
    )
    with rasterio.open(tmp_path / "moved.tif") as file:
        assert (file.read() == -9999).all()


@pytest.mark.parametrize("name", GRIDS)
def test_lossless_changes_nothing_but_the_georeference(tmp_path: Path, name: str) -> None:
    path = painted(tmp_path / "a.tif", name, bands=3, finish=lambda file: file.update_tags(CAMERA="X"))
    made = job(path, lossless=True)
    assert made.warnings == ()
    made.write(tmp_path / "moved.tif")
    with rasterio.open(path) as old, rasterio.open(tmp_path / "moved.tif") as new:
        assert np.array_equal(old.read(), new.read())
        assert (old.crs, old.tags(), old.profile["blockxsize"]) == (new.crs, new.tags(), new.profile["blockxsize"])
    assert misplaced(tmp_path / "moved.tif", after()) < 0.1


def test_lossless_reads_no_pixel(tmp_path: Path) -> None:
    path = painted(tmp_path / "a.tif", bands=3, compress="deflate")
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 3000] = b"\0" * 3000
    path.write_bytes(content)
    job(path, lossless=True).write(tmp_path / "moved.tif")
    assert bytes(content[2000:]) in (tmp_path / "moved.tif").read_bytes()


def test_lossless_of_a_huge_empty_file_is_instant(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "width": 40_000, "height": 40_000, "count": 3, "dtype": "uint8", "crs": CRS}
    with rasterio.open(tmp_path / "a.tif", "w", transform=north_up(), bigtiff="YES", **profile) as file:
        file.write(np.ones((3, 1, 1), np.uint8), window=((39_999, 40_000), (0, 1)))
    if (tmp_path / "a.tif").stat().st_blocks * 512 > 10**9:
        pytest.skip("needs a file system with holes")
    begin = time.process_time()
    job(tmp_path / "a.tif", lossless=True).write(tmp_path / "moved.tif")
    assert time.process_time() - begin < 2
    assert (tmp_path / "moved.tif").stat().st_blocks * 512 < 10**9
    with rasterio.open(tmp_path / "moved.tif") as file:
        assert file.read(1, window=((39_999, 40_000), (0, 2))).tolist() == [[1, 0]]


def test_lossless_takes_along_what_belongs_to_the_file(tmp_path: Path) -> None:
    path = painted(tmp_path / "a.tif", dtype="uint16", bands=2)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False, TIFF_USE_OVR=True), rasterio.open(path, "r+") as file:
        file.write_mask(np.arange(240 * 240).reshape(240, 240) % 3 > 0)
        file.build_overviews([2])
    assert {entry.name for entry in tmp_path.iterdir()} >= {"a.tif", "a.tif.msk", "a.tif.ovr"}
    job(path, lossless=True).write(tmp_path / "moved.tif")
    with rasterio.open(path) as old, rasterio.open(tmp_path / "moved.tif") as new:
        assert new.overviews(1) == [2]
        assert np.array_equal(old.dataset_mask(), new.dataset_mask())


def test_lossless_of_a_cog_and_of_what_is_no_geotiff(tmp_path: Path) -> None:
    path = painted(tmp_path / "a.tif")
    job(path).write(tmp_path / "cog.tif")
    raster_job(
        read_raster(tmp_path / "cog.tif"),
        Motion(CRS, MOTION.reference_from_source.inverse()),
        None,
        RasterOptions(lossless=True),
        tmp_path,
    ).write(tmp_path / "back.tif")
    assert misplaced(tmp_path / "back.tif") < 0.1
    with rasterio.open(path) as file:
        profile = {**file.profile, "driver": "PNG"}
        with rasterio.open(
            tmp_path / "a.png", "w", **{k: profile[k] for k in profile if not k.startswith("block")}
        ) as png:
            png.write(file.read())
    refused(tmp_path / "a.png", "no GeoTIFF", lossless=True)


def test_lossless_in_degrees_says_how_far_off_it_is(tmp_path: Path) -> None:
    wide = write(
        tmp_path / "a.tif", np.zeros((1, 9000, 9000), np.uint8), *placed("degrees"), sparse_ok=True, bigtiff="NO"
    )
    turned = Motion(CRS, Affine([[0, -1], [1, 0]], (0, 0)).about(-np.array(ORIGIN)))
    found = raster_job(read_raster(wide), turned, None, RasterOptions(lossless=True), tmp_path)
    assert "pixels off" in found.warnings[0]


def test_a_world_file_and_points_say_the_same(tmp_path: Path) -> None:
    path = painted(tmp_path / "a.tif", "degrees")
    made = job(path, world_file=True, gcp_points=True)
    made.write(tmp_path / "moved.tif")
    a, d, b, e, c, f = map(float, (tmp_path / "moved.tfw").read_text().split())
    with rasterio.open(tmp_path / "moved.tif") as file:
        assert tuple(file.transform)[:6] == pytest.approx((a, b, c - (a + b) / 2, d, e, f - (d + e) / 2), rel=1e-12)
    head, names, *lines = (tmp_path / "moved.tif.points").read_text().splitlines()
    assert head.startswith('#CRS: GEOGCS["WGS 84"')
    assert names == "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"
    points = np.array([line.split(",")[:4] for line in lines], float)
    assert len(points) == 16
    back = made.raster.grid.map_from_pixel.inverse()(points[:, 2:])
    from treereg_core.io.grid import PixelMap

    np.testing.assert_allclose(PixelMap(made.grid, made.raster.grid, MOTION).forward(back), points[:, :2], atol=1e-12)
    assert math.isfinite(points.sum())
