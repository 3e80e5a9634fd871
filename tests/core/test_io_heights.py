"""Heights from elevation rasters: right on any ground and in any raster, and unknown where a raster does not tell."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import rasterio
from rasterio.warp import transform_bounds
from scipy.spatial import cKDTree

from tests.core.io_files import CRS, ORIGIN, feature, polygon, raw, square, survey, trees
from treereg_core import register
from treereg_core.cli import main
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.heights import HEIGHT, Heights, vertical_offset
from treereg_core.io import read_survey, read_surveys
from treereg_core.io.crs import converter
from treereg_core.simulate import Scene, simulate, write_simulation

ROWS, IN_ROW = 6, 9
XY = np.array([(3.5 * i, 5.5 * j) for j in range(ROWS) for i in range(IN_ROW)])
HEIGHTS = np.random.default_rng(3).uniform(1.5, 4.5, len(XY))
LEVEL = 320.0
RADIUS = 1.1


def surface(points, slope=(0.0, 0.0)):
    """Elevations at points (n, 2) about the origin, metres: a plane, and on it a dome for each tree."""
    distance, tree = cKDTree(XY).query(points)
    dome = np.where(distance < RADIUS, HEIGHTS[tree] * (1 - 0.5 * (distance / RADIUS) ** 2), 0)
    return LEVEL + points @ np.asarray(slope) + dome


def write_dem(folder, crs=CRS, turn_deg=0.0, side=0.1, south_up=False, values=surface, kind="float32", **form):
    """An elevation raster over the trees, its pixels `side` metres wide."""
    low, high = XY.min(axis=0) - 6 + ORIGIN, XY.max(axis=0) + 6 + ORIGIN
    if crs not in (CRS, None):
        west, south, east, north = transform_bounds(CRS, crs, *low, *high)
        low, high = np.array([west, south]), np.array([east, north])
    step = np.array([side, side])
    if crs == "EPSG:4326":
        step = step / [111_320 * np.cos(np.radians(high[1])), 110_900]
    width, height = np.ceil((high - low) / step).astype(int)
    at = rasterio.Affine(step[0], 0, low[0], 0, -step[1], high[1])
    if south_up:
        at = rasterio.Affine(step[0], 0, low[0], 0, step[1], low[1])
    if turn_deg:
        middle = (low + high) / 2
        width = height = int(np.hypot(width, height))
        cos, sin = np.cos(np.radians(turn_deg)) * side, np.sin(np.radians(turn_deg)) * side
        corner = middle - (np.array([cos - -sin, sin + -cos]) * width / 2)
        at = rasterio.Affine(cos, sin, corner[0], sin, -cos, corner[1])
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    x, y = at.a * columns + at.b * rows + at.c, at.d * columns + at.e * rows + at.f
    points = np.column_stack([x.ravel(), y.ravel()])
    full = points if crs in (CRS, None) else converter(crs, CRS)(points)
    with rasterio.open(
        folder / "dem_10cm.tif", "w", driver="GTiff", width=width, height=height, count=1, dtype=kind, crs=crs,
        transform=at, **form,
    ) as dataset:  # fmt: skip
        dataset.write(values(full - ORIGIN).reshape(height, width).astype(kind), 1)
    return folder


@pytest.fixture
def folder(tmp_path):
    """A survey of these trees, without a raster."""
    return survey(tmp_path / "s", trees(XY))


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"south_up": True},
        {"turn_deg": 33.0},
        {"turn_deg": -120.0},
        {"crs": "EPSG:32735"},
        {"crs": "EPSG:4326"},
        {"crs": "EPSG:3857"},
        {"side": 0.03},
        {"side": 0.4},
    ],
    ids=str,
)
def test_heights_in_any_raster(folder, form):
    write_dem(folder, **form)
    read = read_survey(folder)
    np.testing.assert_allclose(read.heights.height, HEIGHTS, atol=0.35 if form.get("side", 0.1) > 0.1 else 0.12)
    np.testing.assert_allclose(read.heights.ground, LEVEL, atol=1e-3)
    assert np.array_equal(read.features.attributes[HEIGHT], read.heights.height)
    assert read.warnings == ()


@pytest.mark.parametrize("turn_deg", [0.0, 50.0])
@pytest.mark.parametrize("slope", [(0.2, 0.0), (-0.15, 0.25)], ids=str)
def test_heights_on_a_slope(folder, slope, turn_deg):
    write_dem(folder, turn_deg=turn_deg, values=lambda points: surface(points, slope))
    read = read_survey(folder)
    np.testing.assert_allclose(read.heights.ground, LEVEL + XY @ slope, atol=0.1)
    assert np.median(np.abs(read.heights.height - HEIGHTS)) < 0.2


def test_crowns_that_no_canopy_tells_of_are_not_the_ground(tmp_path):
    shown = np.random.default_rng(0).random(len(XY)) < 0.5
    folder = write_dem(survey(tmp_path / "s", trees(XY[shown])))
    np.testing.assert_allclose(read_survey(folder).heights.height, HEIGHTS[shown], atol=0.15)


def test_noise_and_a_fault_in_a_crown_change_little(folder):
    def noisy(points):
        rng = np.random.default_rng(1)
        return surface(points) + rng.normal(0, 0.05, len(points)) + 50 * (rng.random(len(points)) < 0.002)

    off = read_survey(write_dem(folder, values=noisy)).heights.height - HEIGHTS
    assert np.median(np.abs(off)) < 0.1
    assert np.abs(off).max() < 0.4


def half(points):
    """Elevations in the west only."""
    return np.where(points[:, 0] < 16, surface(points), -9999)


@pytest.mark.parametrize("kind", ["nodata", "nan", "small"])
def test_a_raster_that_covers_a_part_tells_of_that_part(folder, kind):
    if kind == "small":
        write_dem(folder)
        with rasterio.open(folder / "dem_10cm.tif") as dataset:
            profile = dataset.profile | {"width": round((16 + 6) / 0.1)}
            values = dataset.read(window=((0, profile["height"]), (0, profile["width"])))
        with rasterio.open(folder / "dem_10cm.tif", "w", **profile) as dataset:
            dataset.write(values)
    elif kind == "nan":
        write_dem(folder, values=lambda points: np.where(half(points) > 0, half(points), np.nan))
    else:
        write_dem(folder, values=half, nodata=-9999)
    read = read_survey(folder)
    known = np.isfinite(read.heights.height)
    assert known[XY[:, 0] < 14].all()
    assert not known[XY[:, 0] > 17].any()
    assert np.array_equal(known, np.isfinite(read.heights.ground))
    np.testing.assert_allclose(read.heights.height[known], HEIGHTS[known], atol=0.15)
    assert HEIGHT not in read.features.attributes
    (told,) = read.warnings
    assert told == f"{folder / 'dem_10cm.tif'} does not tell the height of {(~known).sum()} of {len(XY)} trees."


def test_scale_and_offset_of_whole_numbers(folder):
    write_dem(folder, values=lambda points: (surface(points) - 300) * 100, kind="int16")
    with rasterio.open(folder / "dem_10cm.tif", "r+") as dataset:
        dataset.scales, dataset.offsets = (0.01,), (300.0,)
    np.testing.assert_allclose(read_survey(folder).heights.height, HEIGHTS, atol=0.12)


def test_canopies_that_overlap_or_are_no_tree(tmp_path):
    everything = [*trees(XY), feature(polygon(square((0, 0), side=200)), confidence=0.5)]
    everything.append(feature(polygon(square(XY[10] + 0.3, side=1.0)), confidence=0.5))
    read = read_survey(write_dem(survey(tmp_path / "s", everything)))
    assert np.isnan(read.heights.height[len(XY)])
    np.testing.assert_allclose(read.heights.height[: len(XY)], HEIGHTS, atol=0.2)
    assert read.heights.height[-1] == pytest.approx(HEIGHTS[10], abs=0.4)
    assert np.isfinite(read.features.attributes[HEIGHT]).all()


def test_a_survey_without_elevations_has_no_heights(folder):
    read = read_survey(folder)
    assert read.heights is None
    assert HEIGHT not in read.features.attributes


def test_a_broken_raster_is_one_sentence(folder):
    raw(folder, b"II*\0nonsense", "dem_10cm.tif")
    with pytest.raises(InputError, match=r"dem_10cm\.tif cannot be read as a raster .*; export it again\.$"):
        read_survey(folder)


def test_a_raster_that_is_cut_off_is_one_sentence(folder, capsys):
    write_dem(folder)
    path = folder / "dem_10cm.tif"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["rows", str(folder), "--out", str(folder / "rows.geojson")]) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert "dem_10cm.tif cannot be read as a raster" in message
    assert not (folder / "rows.geojson").exists()


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        ({"crs": None}, "names no CRS, so heights are not taken from it; export it with its CRS."),
        ({"values": lambda points: np.full(len(points), -1.0), "nodata": -1.0}, "shows no tree with ground around it"),
    ],
)
def test_a_raster_of_no_use_is_a_warning(folder, form, sentence):
    write_dem(folder, **form)
    read = read_survey(folder)
    assert read.heights is None
    (told,) = read.warnings
    assert sentence in told
    assert "dem_10cm.tif" in told


def test_a_raster_elsewhere_is_a_warning(tmp_path):
    folder = write_dem(survey(tmp_path / "s", trees(XY + 500)))
    assert "shows no tree" in read_survey(folder).warnings[0]


def test_a_raster_of_slivers_is_a_warning(folder):
    write_dem(folder)
    with rasterio.open(folder / "dem_10cm.tif", "r+") as dataset:
        at = dataset.transform
        dataset.transform = rasterio.Affine(at.a, 0, at.c, 0, at.e * 1e-9, at.f)
    assert "shows no tree" in read_survey(folder).warnings[0]


def test_trees_without_a_height_get_that_of_their_neighbours():
    xy = np.array([(float(i), float(j)) for j in range(10) for i in range(10)])
    height = 2 + 0.1 * xy[:, 0]
    height[[5, 50, 99]] = np.nan
    told = Heights(height, np.zeros(100)).attribute(FeatureSet.of(xy))
    assert np.array_equal(told[np.isfinite(height)], height[np.isfinite(height)])
    np.testing.assert_allclose(told[[5, 50, 99]], 2 + 0.1 * xy[[5, 50, 99], 0], atol=0.15)
    height[:30] = np.nan
    assert Heights(height, np.zeros(100)).attribute(FeatureSet.of(xy)) is None


def test_the_vertical_offset_and_its_spread():
    rng = np.random.default_rng(2)
    ground = rng.uniform(300, 320, 400)
    reference, source = Heights(np.ones(400), ground), Heights(np.ones(400), ground - 2.5 + rng.normal(0, 0.1, 400))
    pairs = np.column_stack([np.arange(400)] * 2)
    wrong = pairs.copy()
    wrong[:20, 1] = wrong[20:40, 1]
    for some in (pairs, wrong):
        offset = vertical_offset(reference, source, some)
        assert offset.median == pytest.approx(2.5, abs=0.03)
        assert offset.spread == pytest.approx(0.1, rel=0.2)
        assert offset.trees == 400
    unknown = Heights(np.full(400, np.nan), np.full(400, np.nan))
    assert vertical_offset(reference, unknown, pairs) is None


SLOPING = Scene(trees=300, slope=0.15, undulation=1.0)


@pytest.fixture(scope="module")
def sloping(tmp_path_factory):
    """A simulated orchard on a slope, with its images."""
    folder = tmp_path_factory.mktemp("sloping")
    simulation = simulate(SLOPING, 6)
    write_simulation(simulation, folder, rasters=True)
    return simulation, folder


@pytest.mark.parametrize("which", [0, 1])
def test_heights_of_a_simulated_survey_are_within_two_decimetres(sloping, which):
    simulation, folder = sloping
    read = read_survey(folder / ("reference", "source")[which])
    shown = (simulation.reference_trees, simulation.source_trees)[which]
    whole = (shown[:, 0] >= 0) & (shown[:, 1] < 0)
    off = read.heights.height[whole] - simulation.heights()[shown[whole, 0], which]
    assert np.isfinite(off).mean() > 0.98
    assert np.nanmedian(np.abs(off)) < 0.2
    assert abs(np.nanmedian(off)) < 0.1


def test_the_vertical_offset_is_told_and_not_applied(sloping, monkeypatch, tmp_path, capsys):
    _, folder = sloping
    monkeypatch.chdir(tmp_path)
    surveys = [str(folder / "reference"), str(folder / "source")]
    assert main(["run", *surveys, "-q"]) == 0
    printed = capsys.readouterr().out
    said = json.loads(Path("treereg-out/registration.json").read_text())["vertical_offset_m"]
    truth = json.loads((folder / "truth.json").read_text())["vertical_offset_m"]
    assert said["median"] == pytest.approx(truth, abs=0.1)
    assert 0 < said["spread"] < 0.3
    assert 150 < said["trees"] <= 300
    assert f"vertical offset      {said['median']:+.2f} m" in printed
    assert "not applied" in printed


def test_one_raster_in_both_surveys_makes_no_placement_look_right(monkeypatch, tmp_path):
    simulation = simulate(Scene(trees=300, shift=(5, 3), rotation=2), 9)
    write_simulation(simulation, tmp_path, rasters=True)
    shutil.copy(tmp_path / "reference" / "dem_10cm.tif", tmp_path / "source" / "dem_10cm.tif")
    reference, source = read_surveys(tmp_path / "reference", tmp_path / "source")
    assert {HEIGHT} == set(reference.features.attributes) == set(source.features.attributes)
    for start in ("identity", "coarse"):
        result = register(reference, source, method="icp", start=start)
        assert result.accepted == (start == "coarse")
    assert np.hypot(*result.transform.shift) > 4


def test_a_series_has_the_heights(sloping, monkeypatch, tmp_path):
    simulation, folder = sloping
    monkeypatch.chdir(tmp_path)
    assert main(["series", str(folder / "reference"), str(folder / "source"), "-q", "--method", "icp"]) == 0
    table = pd.read_parquet(Path("treereg-out/trees.parquet"))
    heights = read_survey(folder / "source").heights.height
    shown = table[(table.survey == "source") & table.feature.notna()]
    np.testing.assert_allclose(shown.height_m, heights[shown.feature.astype(int)], atol=1e-4)
    assert table[table.feature.isna()].height_m.isna().all()
    assert len(simulation.source) > 200
