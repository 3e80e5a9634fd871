"""Moved rasters: where things come to lie, what is kept, and that the same comes out however the work is cut up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from io_files import CRS
from raster_files import GRIDS, MOTION, SIZE, after, misplaced, north_up, painted, placed, write
from rasterio.enums import ColorInterp, MaskFlags

from treereg_core.io import pieces, warping
from treereg_core.io.grid import Motion, PixelMap, affine_of
from treereg_core.io.raster import read_raster
from treereg_core.io.rasters import Extent, RasterOptions, raster_job
from treereg_core.io.resampling import Resampling
from treereg_core.transform import Affine

METHODS = [method for method in Resampling if method is not Resampling.AUTO]


def move(path: Path, onto: Path | None = None, motion: Motion = MOTION, **options: Any) -> Path:
    """Move a raster into `out` beside it."""
    target = path.parent / "out" / path.name
    target.parent.mkdir(exist_ok=True)
    grid = read_raster(onto).grid if onto else None
    raster_job(read_raster(path), motion, grid, RasterOptions(**options), target.parent).write(target)
    return target


def pixels(path: Path) -> np.ndarray:
    with rasterio.open(path) as file:
        return np.asarray(file.read())


def mask(path: Path) -> np.ndarray:
    with rasterio.open(path) as file:
        return np.asarray(file.dataset_mask() > 0)


def test_the_spots_are_where_they_are_said_to_be(tmp_path: Path) -> None:
    for name in GRIDS:
        assert misplaced(painted(tmp_path / "a.tif", name)) < 0.03


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.value)
@pytest.mark.parametrize("name", GRIDS)
def test_things_come_to_lie_where_they_belong(tmp_path: Path, name: str, method: Resampling) -> None:
    source = painted(tmp_path / "a.tif", name, "float32")
    onto = painted(tmp_path / "grid.tif")
    assert misplaced(move(source, onto, resampling=method), after()) < 0.1
    assert misplaced(move(source, resampling=method), after()) < 0.1


@pytest.mark.parametrize("name", GRIDS)
def test_onto_any_grid(tmp_path: Path, name: str) -> None:
    source, onto = painted(tmp_path / "a.tif"), painted(tmp_path / "grid.tif", name)
    for extent in Extent:
        target = move(source, onto, extent=extent)
        assert misplaced(target, after()) < 0.1
        with rasterio.open(target) as found, rasterio.open(onto) as grid:
            assert found.crs == grid.crs
            first = affine_of(grid.transform).inverse()([(found.transform.c, found.transform.f)])
            np.testing.assert_allclose(first, np.round(first), atol=1e-4)
            if extent is Extent.REFERENCE:
                assert (found.transform, found.shape) == (grid.transform, grid.shape)


def test_nothing_of_the_source_is_lost_with_its_own_extent(tmp_path: Path) -> None:
    source = write(tmp_path / "a.tif", np.full((1, SIZE, SIZE), 200, np.uint8), CRS, north_up())
    small = write(tmp_path / "grid.tif", np.zeros((1, 20, 20), np.uint8), CRS, north_up())
    for onto in (None, small):
        target = move(source, onto, extent=Extent.SOURCE)
        assert abs(mask(target).sum() / SIZE**2 - 1) < 0.001
        assert (pixels(target)[:, mask(target)] == 200).all()


def test_a_raster_that_does_not_move_stays_as_it_is(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 255, (3, 100, 130), dtype=np.uint8)
    source = write(tmp_path / "a.tif", values, CRS, north_up())
    for method in METHODS:
        target = move(source, motion=Motion(CRS, Affine.identity()), resampling=method)
        assert np.array_equal(pixels(target), values)
        with rasterio.open(source) as old, rasterio.open(target) as new:
            assert (old.transform, old.shape, new.mask_flag_enums) == (new.transform, new.shape, old.mask_flag_enums)


KINDS = {
    "rgb": {"dtype": "uint8", "bands": 3, "photometric": "RGB"},
    "uint16": {"dtype": "uint16", "bands": 5},
    "heights": {"dtype": "float32", "nodata": -9999.0},
    "doubles": {"dtype": "float64", "bands": 2},
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_type_keeps_type_bands_and_nodata(tmp_path: Path, kind: str) -> None:
    source = painted(tmp_path / "a.tif", **KINDS[kind])
    target = move(source, painted(tmp_path / "grid.tif"))
    with rasterio.open(source) as old, rasterio.open(target) as new:
        assert (old.count, old.dtypes, old.colorinterp) == (new.count, new.dtypes, new.colorinterp)
        expected = old.nodata if old.nodata is not None or old.dtypes[0][0] == "u" else np.nan
        np.testing.assert_equal(new.nodata, expected)
        assert new.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
    for band in range(1, KINDS[kind].get("bands", 1) + 1):
        assert misplaced(target, after(), band) < 0.1
    outside = ~mask(target)
    assert 0.02 < outside.mean() < 0.3
    assert len(np.unique(pixels(target)[:, outside])) == 1


def test_the_outside_is_masked_where_nothing_else_can_say_it(tmp_path: Path) -> None:
    target = move(painted(tmp_path / "a.tif", bands=3), painted(tmp_path / "grid.tif"))
    with rasterio.open(target) as file:
        assert file.mask_flag_enums[0] == [MaskFlags.per_dataset]
        assert file.nodata is None
    assert pixels(target)[:, mask(target)].min() >= 15


def test_alpha_is_weighed_and_the_outside_transparent(tmp_path: Path) -> None:
    crs, transform = placed("north up")
    with rasterio.open(painted(tmp_path / "p.tif", bands=4)) as file:
        values = file.read()
    values[3] = 255
    values[:3, :, :60] = 255
    values[3, :, :60] = 0

    source = write(tmp_path / "a.tif", values, crs, transform, photometric="RGB", alpha="YES")
    target = move(source, painted(tmp_path / "grid.tif"))
    found = pixels(target)
    assert (found[:3, found[3] == 0] == 0).all()
    assert found[:3, found[3] > 0].max() < 235, "what cannot be seen shines through"
    with rasterio.open(target) as file:
        assert file.colorinterp[3] is ColorInterp.alpha


def test_a_mask_is_moved_and_what_it_hides_does_not_shine_through(tmp_path: Path) -> None:
    crs, transform = placed("north up")
    hidden = np.zeros((SIZE, SIZE), bool)
    hidden[100:140, 100:200] = True
    with rasterio.open(painted(tmp_path / "p.tif", bands=3)) as file:
        values = np.where(hidden, 255, file.read()).astype(np.uint8)
    source = write(tmp_path / "a.tif", values, crs, transform, finish=lambda file: file.write_mask(~hidden))
    for method in METHODS:
        target = move(source, painted(tmp_path / "grid.tif"), resampling=method)
        shown = mask(target)
        assert pixels(target)[:, shown].max() < 245
        assert abs((~shown[20:-20, 20:-20]).sum() - hidden.sum()) < 60


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.value)
def test_nodata_never_leaks_into_heights(tmp_path: Path, method: Resampling) -> None:
    crs, transform = placed("north up")
    values = np.full((1, SIZE, SIZE), 390.0, np.float32)
    values[0, 90:110, 90:110] = -9999
    values[0, 130:150, 90:110] = np.nan
    source = write(tmp_path / "a.tif", values, crs, transform, nodata=-9999)
    target = move(source, painted(tmp_path / "grid.tif"), resampling=method)
    found = pixels(target)
    assert np.allclose(found[found != -9999], 390, atol=1e-3)
    assert abs((found[0, 40:-40, 40:-40] == -9999).sum() - 800) < 40


def test_data_that_come_out_as_nodata_are_data_all_the_same(tmp_path: Path) -> None:
    values = np.ones((1, SIZE, SIZE), np.uint8)
    values[0, ::2] = 3
    values[0, 100:104] = 0
    source = write(tmp_path / "a.tif", values, CRS, north_up(), nodata=0)
    target = move(source, painted(tmp_path / "grid.tif"), resampling=Resampling.LANCZOS)
    assert abs((pixels(target)[0, 40:-40, 40:-40] == 0).sum() - 4 * (SIZE - 80)) < 40


def test_a_palette_keeps_its_classes_and_colours(tmp_path: Path) -> None:
    values = np.random.default_rng(0).choice(np.array([3, 90, 200], np.uint8), (1, SIZE // 8, SIZE // 8))
    colours = {3: (10, 20, 30, 255), 90: (1, 2, 3, 255), 200: (200, 0, 0, 255)}
    source = write(
        tmp_path / "a.tif",
        values.repeat(8, axis=1).repeat(8, axis=2),
        *placed("north up"),
        photometric="PALETTE",
        finish=lambda file: file.write_colormap(1, colours),
    )
    target = move(source, write(tmp_path / "grid.tif", np.zeros((1, 900, 900), np.uint8), CRS, north_up(900, 0.05)))
    assert set(np.unique(pixels(target)[:, mask(target)])) == set(colours)
    with rasterio.open(target) as file:
        assert {value: file.colormap(1)[value] for value in colours} == colours
        assert set(np.unique(file.read(1, out_shape=(450, 450)))) <= {0, *colours}


def test_what_a_raster_says_of_itself_is_kept_and_what_is_outdated_is_not(tmp_path: Path) -> None:
    def describe(file: Any) -> None:
        file.update_tags(CAMERA="X", AREA_OR_POINT="Point")
        file.update_tags(1, STATISTICS_MEAN="5", FILTER="red")
        file.set_band_description(1, "height")
        file.set_band_unit(1, "m")
        file.scales, file.offsets = (0.5, 1.0), (7.0, 0.0)

    source = painted(tmp_path / "a.tif", dtype="uint16", bands=2, finish=describe)
    target = move(source, painted(tmp_path / "grid.tif"))
    assert misplaced(target, after()) < 0.1
    with rasterio.open(target) as file:
        assert file.tags()["CAMERA"] == "X"
        assert file.tags()["AREA_OR_POINT"] == "Point"
        assert file.tags(1) == {"FILTER": "red"}
        assert (file.descriptions, file.units) == (("height", None), ("m", None))
        assert (file.scales, file.offsets) == ((0.5, 1.0), (7.0, 0.0))
    assert [entry.name for entry in target.parent.iterdir()] == ["a.tif"]


def test_tags_of_other_namespaces_are_kept(tmp_path: Path) -> None:
    def describe(file: Any) -> None:
        file.update_tags(ns="MINE", A="1")
        file.update_tags(1, ns="MINE", B="2")

    with rasterio.open(move(painted(tmp_path / "a.tif", finish=describe))) as file:
        assert (file.tags(ns="MINE"), file.tags(1, ns="MINE")) == ({"A": "1"}, {"B": "2"})


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.value)
@pytest.mark.parametrize("name", ["rotated", "degrees"])
def test_no_seam_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: Resampling, name: str) -> None:
    rng = np.random.default_rng(1)
    values = rng.integers(1, 255, (2, SIZE, SIZE), dtype=np.uint8)
    values[:, 70:90, 70:90] = 0
    source = write(tmp_path / "a.tif", values, *placed(name), nodata=0)
    onto = painted(tmp_path / "grid.tif")
    whole = pixels(move(source, onto, resampling=method)).astype(int)
    monkeypatch.setattr(warping, "block_size", lambda _: 16)
    pieced = pixels(move(source, onto, resampling=method)).astype(int)
    if name == "rotated":
        assert np.array_equal(whole, pieced)
    else:
        assert np.percentile(np.abs(whole - pieced), 99) <= (0 if method is Resampling.NEAREST else 2)


def test_pieces_of_another_crs_are_as_exact_as_they_must_be(tmp_path: Path) -> None:
    crs, transform = placed("degrees")
    wide = write(tmp_path / "a.tif", np.zeros((1, 9000, 9000), np.uint8), crs, transform, sparse_ok=True)
    onto = write(tmp_path / "grid.tif", np.zeros((1, 9000, 9000), np.uint8), CRS, north_up(9000), sparse_ok=True)
    there = PixelMap(read_raster(onto).grid, read_raster(wide).grid, MOTION)
    found = list(pieces.cut(there, 8192, (3, 3), 1))
    assert len(found) > 4
    shown = np.zeros((9000, 9000), bool)
    for piece in found:
        window = piece.target
        at = window.points(np.random.default_rng(0).random((50, 2)))
        assert np.abs(piece.source_from_target(at) - there(at)).max() < 1.5 * pieces.WORST_ERROR
        part = shown[window.row : window.row + window.height, window.column : window.column + window.width]
        assert not part.any()
        part[:] = True


@pytest.mark.parametrize("method", [Resampling.AVERAGE, Resampling.CUBIC, Resampling.BILINEAR])
def test_a_coarser_grid_averages(tmp_path: Path, method: Resampling, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).normal(100, 20, (1, 800, 800)).clip(0, 255).astype(np.uint8)
    source = write(tmp_path / "a.tif", values, CRS, north_up(800, 0.05))
    onto = write(tmp_path / "grid.tif", np.zeros((1, 40, 40), np.uint8), CRS, north_up(40, 1.0))
    target = move(source, onto, resampling=method)
    whole = pixels(target)
    assert whole[0, 5:-5, 5:-5].std() < 3
    monkeypatch.setattr(pieces, "MOST_SOURCE_BYTES", 20_000)
    assert np.array_equal(pixels(move(source, onto, resampling=method)), whole)


def test_the_same_bytes_at_any_number_of_threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warping, "block_size", lambda _: 32)
    source, onto = painted(tmp_path / "a.tif", bands=3), painted(tmp_path / "grid.tif", "degrees")
    first = move(source, onto).read_bytes()
    assert all(move(source, onto, threads=threads).read_bytes() == first for threads in (2, 5))


@pytest.mark.parametrize("dtype", ["int64", "uint64"])
def test_numbers_too_large_for_floating_point_are_kept(tmp_path: Path, dtype: str) -> None:
    values = (2**60 + np.arange(SIZE * SIZE)).reshape(1, SIZE, SIZE).astype(dtype)
    source = write(tmp_path / "a.tif", values, *placed("rotated"))
    small = write(tmp_path / "b.tif", (values - 2**60).astype("uint32"), *placed("rotated"))
    onto = painted(tmp_path / "grid.tif")
    found, expected = (move(path, onto, resampling=Resampling.NEAREST) for path in (source, small))
    assert np.array_equal(mask(found), mask(expected))
    assert np.array_equal(pixels(found)[:, mask(found)] - 2**60, pixels(expected)[:, mask(expected)])


@pytest.mark.parametrize("dtype", ["int8", "int16", "uint32", "int32", "float64", "complex64"])
def test_other_types(tmp_path: Path, dtype: str) -> None:
    with rasterio.open(painted(tmp_path / "p.tif", dtype="uint16")) as file:
        values = (file.read() // 256).astype(dtype)
    target = move(write(tmp_path / "a.tif", values, *placed("north up")))
    with rasterio.open(target) as file:
        assert file.dtypes == (dtype,)
    assert dtype == "complex64" or misplaced(target, after()) < 0.1


def test_auto_takes_what_suits_the_raster(tmp_path: Path) -> None:
    def method(**more: Any) -> str:
        return Resampling.AUTO.for_raster(read_raster(painted(tmp_path / "a.tif", **more))).value

    assert method() == "cubic"
    assert method(dtype="uint16", bands=4) == "cubic"
    assert method(dtype="float32") == "bilinear"
    assert method(finish=lambda file: file.update_tags(1, LAYER_TYPE="thematic")) == "nearest"
