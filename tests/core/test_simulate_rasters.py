"""The images of a simulation show what its detections and its truth say, where and how high these say it is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from scipy.ndimage import map_coordinates

from treereg_core.cli import main
from treereg_core.simulate import Scene, simulate, simulate_family, write_simulation
from treereg_core.simulate.canopy import canopies
from treereg_core.simulate.displacement import Displacement
from treereg_core.simulate.grid import CELL, Grid, Nodes
from treereg_core.simulate.orchard import plant
from treereg_core.transform import Rigid

ORIGIN = np.array([343_000.0, 6_306_000.0])
SAME = {"growth": 1.0, "dead": 0.0, "height_persistence": 1.0, "area_persistence": 1.0, "false": 0.0}
EXACT = Scene(trees=80, jitter=0, split=0, merged=0, missed=0, rotation=7.3, shift=(3.21, -2.47), **SAME)
SURVEYS = ("reference", "source")


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    """A simulation without errors, and its folder."""
    folder = tmp_path_factory.mktemp("exact")
    simulation = simulate(EXACT, 1)
    write_simulation(simulation, folder, rasters=True)
    return simulation, folder


def opened(folder, survey, name="dem"):
    """The values of a raster (bands, h, w), NaN for nodata, and its transform."""
    with rasterio.open(folder / survey / f"{name}_10cm.tif") as dataset:
        values = dataset.read().astype(float)
        values[values == dataset.nodata] = np.nan
        return values, dataset.transform


def sampled(values, transform, points):
    """Values (h, w) at points (n, 2) about the origin, bilinear."""
    columns, rows = ((points + ORIGIN - [transform.c, transform.f]) / [transform.a, transform.e]).T
    return map_coordinates(values, [rows - 0.5, columns - 0.5], order=1, cval=np.nan)


def test_the_truth_lays_the_elevations_on_each_other(exact):
    simulation, folder = exact
    reference, at = opened(folder, "reference")
    source, its = opened(folder, "source")
    reach = np.abs(simulation.trees.xy).max(axis=0)
    points = np.random.default_rng(0).uniform(-reach, reach, (20_000, 2))
    level = sampled(reference[0], at, points)

    def differ(right, up):
        moved = simulation.truth.inverse()(points + np.array([right, up]))
        return np.nanstd(sampled(source[0], its, moved) - level)

    steps = np.array([-0.1, -0.05, 0, 0.05, 0.1])
    for along in (lambda step: differ(step, 0), lambda step: differ(0, step)):
        a, b, _ = np.polyfit(steps, [along(step) ** 2 for step in steps], 2)
        assert a > 0
        # half a pixel is 0.05
        assert -b / (2 * a) == pytest.approx(0, abs=0.01)
    offset = json.loads((folder / "truth.json").read_text())["vertical_offset_m"]
    moved = sampled(source[0], its, simulation.truth.inverse()(points))
    assert np.nanmedian(level - moved) == pytest.approx(offset, abs=0.02)
    assert abs(offset) > 0.1


@pytest.mark.parametrize("survey", SURVEYS)
def test_outlines_fit_what_the_images_show(exact, survey):
    simulation, folder = exact
    flight = simulation.flights[SURVEYS.index(survey)]
    features = getattr(simulation, survey)
    rings = canopies(features, np.random.default_rng(simulation.seed).spawn(2)[SURVEYS.index(survey)])
    elevation, transform = opened(folder, survey)
    high = []
    for share in (0.6, 1.0, 1.5):
        points = (features.xy[:, None] + share * (rings - features.xy[:, None])).reshape(-1, 2)
        ground = flight.ground(flight.displacement.inverse(points)) + flight.datum
        high.append(np.mean(sampled(elevation[0], transform, points) - ground > 0.5))
    inside, edge, outside = high
    assert inside > 0.99
    assert 0.3 < edge < 0.9
    assert outside < 0.25


@pytest.mark.parametrize("survey", SURVEYS)
def test_both_images_of_a_survey_have_one_grid_and_show_the_same(exact, survey):
    simulation, folder = exact
    flight = simulation.flights[SURVEYS.index(survey)]
    elevation, transform = opened(folder, survey)
    colours, same = opened(folder, survey, "visible")
    assert transform == same
    assert (transform.a, transform.b, transform.d, transform.e) == (CELL, 0, 0, -CELL)
    assert transform.c / CELL == pytest.approx(round(transform.c / CELL), abs=1e-5)
    assert np.array_equal(np.isnan(elevation[0]), np.isnan(colours[0]))
    trees = flight.displacement(flight.orchard.xy)
    dark = [sampled(band, transform, trees) for band in colours]
    beside = [np.nanmedian(band) for band in colours]
    assert np.median(dark[0]) < 0.8 * beside[0]
    assert np.mean((dark[1] > dark[0]) & (dark[1] > dark[2])) > 0.95


def test_heights_and_the_ground_are_in_the_elevations(exact):
    simulation, folder = exact
    truth = json.loads((folder / "truth.json").read_text())["trees"]
    for survey, member, flight in zip(SURVEYS, ("height", "source_height"), simulation.flights, strict=True):
        assert [tree[member] for tree in truth] == np.round(flight.height, 4).tolist()
        elevation, transform = opened(folder, survey)
        here = flight.displacement(flight.orchard.xy)[:, None] + np.random.default_rng(0).normal(0, 0.15, (1, 50, 2))
        top = sampled(elevation[0], transform, here.reshape(-1, 2)).reshape(-1, 50).max(axis=1)
        off = top - flight.ground(flight.orchard.xy) - flight.datum - flight.height
        assert np.median(np.abs(off)) < 0.15
        assert np.abs(np.median(off)) < 0.1


def test_heights_last_and_grow():
    flights = simulate(Scene(trees=5000, growth=1.44, height_persistence=0.7, area_variation=0, vigour=0), 3).flights
    before, after = np.log([flight.height for flight in flights])
    assert before.std() == pytest.approx(0.12, rel=0.05)
    assert np.corrcoef(before, after)[0, 1] == pytest.approx(0.7, abs=0.03)
    assert np.exp(np.median(after - before)) == pytest.approx(1.2, rel=0.01)
    assert np.exp(np.median(before)) == pytest.approx(3.0, rel=0.01)
    alike = simulate(Scene(periodic=True), 3).flights[0].height
    assert np.ptp(alike) < 1e-9


def test_dead_trees_and_those_of_another_orchard_have_no_height():
    simulation = simulate(Scene(trees=500, dead=0.2), 1)
    assert np.isfinite(simulation.heights()[:, 0]).all()
    assert np.isnan(simulation.heights()[:, 1]).mean() == pytest.approx(0.2, abs=0.06)
    other = simulate(Scene(trees=100, same_orchard=False, dead=0), 1)
    known = np.isfinite(other.heights())
    assert (known.sum(axis=1) == 1).all()
    assert known[other.source_trees[other.source_trees >= 0], 1].all()
    assert other.vertical_offset() is None


def test_what_was_not_flown_over_is_nodata(tmp_path):
    simulation = simulate(Scene(trees=400, crop="ends", overlap=0.5, rotation=30), 2)
    write_simulation(simulation, tmp_path, rasters=True)
    for survey, flight in zip(SURVEYS, simulation.flights, strict=True):
        elevation, transform = opened(tmp_path, survey)
        trees = flight.orchard.xy
        here = sampled(elevation[0], transform, flight.displacement(trees))
        assert np.isfinite(here[flight.visit.view.sees(trees)]).all()
        assert 0.1 < np.isnan(here).mean() < 0.5
        assert np.nanmin(here) > 0


def test_the_same_seed_gives_the_same_bytes_and_images_change_no_detection(tmp_path):
    for name, rasters in (("a", True), ("b", True), ("c", False)):
        write_simulation(simulate_family("small_60", 3), tmp_path / name, rasters=rasters)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.*"))
    assert len(files) == 9
    for file in files:
        content = (tmp_path / "a" / file).read_bytes()
        assert content == (tmp_path / "b" / file).read_bytes()
        if file.suffix != ".tif":
            assert content == (tmp_path / "c" / file).read_bytes()
    assert not list((tmp_path / "c").rglob("*.tif"))


@pytest.mark.parametrize(
    "scene",
    [
        {"same_orchard": False, "other_scale": 1.3},
        {"distortion": 1.5, "rotation": "any"},
        {"periodic": True},
        {"hedgerow": 2, "paths": 1, "headlands": 1, "curve": 5},
        {"crop": "windows", "overlap": 0.3},
    ],
)
def test_every_kind_of_scene_has_images(scene, tmp_path):
    simulation = simulate(Scene(trees=120, **scene), 4)
    write_simulation(simulation, tmp_path, rasters=True)
    for survey, flight in zip(SURVEYS, simulation.flights, strict=True):
        elevation, transform = opened(tmp_path, survey)
        standing = flight.orchard.xy[flight.visit.alive]
        seen = flight.visit.view.sees(standing)
        trees, height = standing[seen], flight.height[flight.visit.alive][seen]
        off = sampled(elevation[0], transform, flight.displacement(trees)) - flight.ground(trees) - flight.datum
        assert np.median(np.abs(off - height)) < 0.3


def test_the_command_makes_images_unless_told_not_to(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    scene = ["--trees", "30", "-q"]
    assert main(["simulate", "with", *scene]) == 0
    assert main(["simulate", "without", *scene, "--no-rasters"]) == 0
    assert len(list(Path("with").rglob("*.tif"))) == 4
    assert not list(Path("without").rglob("*.tif"))
    assert main(["simulate", "with", *scene, "--no-rasters", "--overwrite"]) == 0
    assert not list(Path("with").rglob("*.tif"))


@pytest.mark.parametrize("metres", [0.0, 0.35, 2.0])
def test_a_displacement_is_undone(metres):
    points = np.random.default_rng(1).uniform(-80, 80, (300, 2))
    misplaced = Rigid.turn(33, shift=(5, -3))
    displaced = Displacement.drawn(Scene(distortion=metres), misplaced, points, np.random.default_rng(2))
    np.testing.assert_allclose(displaced.inverse(displaced(points)), points, atol=1e-5)
    moved = displaced.then(Rigid.turn(-5, shift=(1, 1)))
    np.testing.assert_allclose(moved(points), Rigid.turn(-5, shift=(1, 1))(displaced(points)), atol=1e-9)


@pytest.mark.parametrize("scene", [{}, {"curve": 12}, {"contour": 3}, {"hedgerow": 2, "outline": "irregular"}])
def test_the_frame_of_the_rows_is_undone_and_has_rows_where_trees_are(scene):
    orchard = plant(Scene(**scene), np.random.default_rng(5))
    own = orchard.rows.inverse(orchard.positions)
    np.testing.assert_allclose(orchard.rows(own), orchard.positions, atol=1e-4)
    places = (own[:, 1] - orchard.rows.first) / orchard.rows.apart
    off = np.abs(places - np.round(places)) * orchard.rows.apart
    np.testing.assert_allclose(off, scene.get("hedgerow", 0) / 2, atol=1e-3)


def test_nodes_spread_smooth_functions():
    grid = Grid(-3.0, 4.0, 83, 131)
    nodes = Nodes.of(grid)
    x, y = np.meshgrid(grid.x, grid.y)
    np.testing.assert_allclose(nodes.spread(nodes.points @ [0.3, -0.7] + 2), 0.3 * x - 0.7 * y + 2, atol=1e-5)
    parts = {(row, column): (tile.height, tile.width) for row, column, tile in grid.tiles(64)}
    assert parts == {
        (0, 0): (64, 64),
        (0, 64): (64, 64),
        (0, 128): (64, 3),
        **{(64, c): (19, min(64, 131 - c)) for c in (0, 64, 128)},
    }
