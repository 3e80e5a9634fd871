"""`treereg misregister` from the outside: what moves, what stays, what undoes it, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from io_files import CRS, ORIGIN, collection, feature, lonlat, survey, table, trees
from raster_files import after, brightness, misplaced, north_up, painted, write

from treereg_core import io
from treereg_core.cli import main
from treereg_core.evaluation import Misregistered
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.transform import Affine, Rigid

Output = pytest.CaptureFixture[str]
GIVEN = ["--rotation", "7.3", "--translation", "-3.25", "2"]
FILE_STEP = 1.2e-4
"""Half a unit of the ninth decimal of a degree, twice, in both directions, metres; rounded up."""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    survey(Path("in"))
    boundary = {
        "type": "Polygon",
        "coordinates": [lonlat(ORIGIN + np.array([(0, 0), (9, 0), (9, 9), (0, 0)])).tolist()],
    }
    Path("in/boundary.geojson").write_text(json.dumps(boundary, indent=3))


def misregister(*arguments: Any, out: str = "out") -> int:
    return main(["misregister", *map(str, arguments), "--out", out, "-q"])


def undoing(folder: str = "out") -> Affine:
    """The transform in misregistration.json, of full coordinates."""
    return io.read_motion(Path(folder, "misregistration.json")).reference_from_source


def centroids(folder: str) -> np.ndarray:
    """Full coordinates (n, 2) of the trees' centroids."""
    read = io.read_survey(Path(folder))
    return np.asarray(read.features.xy + read.frame.origin)


@pytest.mark.parametrize("options", [GIVEN, ["--seed", 5], ["--rotation", -178, "--translation-sd", 900], []])
def test_the_recorded_transform_undoes_it(options: list[Any]) -> None:
    assert misregister("in", *options) == 0
    assert np.hypot(*(centroids("out") - centroids("in")).T).max() > 0.5
    np.testing.assert_allclose(undoing()(centroids("out")), centroids("in"), rtol=0, atol=FILE_STEP)
    assert main(["apply", "out/misregistration.json", "out/raw-detections.geojson", "--out", "back", "-q"]) == 0
    before, back = (json.loads(Path(where, "raw-detections.geojson").read_text()) for where in ("in", "back"))
    for one, other in zip(before["features"], back["features"], strict=True):
        assert one["properties"] == other["properties"]
        rings = [np.array(f["geometry"]["coordinates"]) for f in (one, other)]
        np.testing.assert_allclose(rings[0], rings[1], rtol=0, atol=1.6e-9)


def test_what_is_given_is_done_about_the_centroid_of_the_detections() -> None:
    assert misregister("in", *GIVEN) == 0
    middle = centroids("in").mean(axis=0)
    expected = Rigid.turn(7.3, about=middle, shift=(-3.25, 2))(centroids("in"))
    np.testing.assert_allclose(centroids("out"), expected, rtol=0, atol=FILE_STEP)
    said = json.loads(Path("out/misregistration.json").read_text())
    assert said["crs"] == CRS
    assert said["undoes"] == {"rotation_deg": 7.3, "translation_m": [-3.25, 2.0]}
    assert said["transform"]["model"] == "rigid"
    assert said["transform"]["rotation_deg"] == pytest.approx(-7.3)
    np.testing.assert_allclose(said["transform"]["translation_m"], (3.25, -2), atol=1e-9)


def test_the_same_seed_draws_what_evaluate_draws() -> None:
    assert misregister("in", "--seed", 4, "--rotation-sd", 2, "--translation-sd", 5) == 0
    assert misregister("in", "--seed", 4, "--rotation-sd", 2, "--translation-sd", 5, out="again") == 0
    assert Path("out/raw-detections.geojson").read_bytes() == Path("again/raw-detections.geojson").read_bytes()
    assert misregister("in", "--seed", 5, "--rotation-sd", 2, "--translation-sd", 5, out="other") == 0
    assert Path("out/raw-detections.geojson").read_bytes() != Path("other/raw-detections.geojson").read_bytes()
    read = io.read_survey(Path("in"))
    truth = Misregistered("in", read.features, read.features, 2, 5).case("in", 4).problem.truth
    assert truth is not None
    np.testing.assert_allclose(undoing().about(read.frame.origin).matrix, truth.matrix, atol=1e-7)


def test_one_quantity_given_leaves_the_draw_of_the_other() -> None:
    assert misregister("in", "--rotation", 5, "--seed", 2) == 0
    assert misregister("in", "--translation", 1, 1, "--seed", 2, out="other") == 0
    assert misregister("in", "--seed", 2, out="both") == 0
    done = {
        name: json.loads(Path(name, "misregistration.json").read_text())["undoes"] for name in ("out", "other", "both")
    }
    assert done["out"] == {"rotation_deg": 5, "translation_m": done["both"]["translation_m"]}
    assert done["other"] == {"rotation_deg": done["both"]["rotation_deg"], "translation_m": [1, 1]}


def test_every_file_moves_but_the_boundary(capsys: Output) -> None:
    painted(Path("in/visible_10cm.tif"), bands=3)
    painted(Path("in/dem_10cm.tif"), "rotated", "float32", nodata=-9999.0)
    painted(Path("in/ndvi.tif"), "south up", "uint16")
    Path("in/ndvi.tif.aux.xml").write_text("<PAMDataset><Metadata><MDI key='sensor'>x</MDI></Metadata></PAMDataset>")
    Path("in/ndvi.tfw").write_text("\n".join(map(str, (1, 0, 0, -1, 0, 0))))
    Path("in/pipes.json").write_text(
        json.dumps(feature({"type": "Point", "coordinates": lonlat(np.array([ORIGIN]))[0].tolist()}))
    )
    Path("in/notes.txt").write_text("mine")
    Path("in/settings.json").write_text('{"type": "pump"}')
    Path("in/.hidden").write_text("x")
    Path("in/photos").mkdir()
    assert misregister("in", *GIVEN) == 0
    told = capsys.readouterr().err
    assert "in/notes.txt and 1 more are left out, being neither vector file nor GeoTIFF" in told
    names = {path.name for path in Path("out").iterdir()}
    stay = {"notes.txt", "settings.json", ".hidden", "photos"}
    assert names == {path.name for path in Path("in").iterdir()} - stay | {"misregistration.json"}
    assert Path("out/boundary.geojson").read_bytes() == Path("in/boundary.geojson").read_bytes()
    wrong = undoing().inverse()
    for name in ("visible_10cm.tif", "dem_10cm.tif", "ndvi.tif"):
        with rasterio.open(Path("in", name)) as old, rasterio.open(Path("out", name)) as new:
            assert np.array_equal(old.read(), new.read())
            assert (old.profile | {"transform": 0}) == (new.profile | {"transform": 0})
            assert old.tags() == new.tags()
            expected = wrong.matrix @ np.array(old.transform).reshape(3, 3)
            np.testing.assert_allclose(np.array(new.transform), expected.ravel(), rtol=0, atol=1e-8)
        assert misplaced(Path("out", name), after(wrong.about(ORIGIN))) < 0.1
    with rasterio.open("out/ndvi.tif") as file:
        a, d, b, e = map(float, Path("out/ndvi.tfw").read_text().split()[:4])
        assert (a, b, d, e) == (file.transform.a, file.transform.b, file.transform.d, file.transform.e)
    pipe = json.loads(Path("out/pipes.json").read_text())["geometry"]["coordinates"]
    np.testing.assert_allclose(pipe, lonlat(wrong([ORIGIN]))[0], rtol=0, atol=1e-9)


def test_rasters_come_back_to_the_last_digit() -> None:
    grid = painted(Path("in/visible_10cm.tif"), bands=3)
    assert misregister("in", "--rotation", 33, "--translation", 12, -7) == 0
    moving = ["apply", "out/misregistration.json", "out/visible_10cm.tif", "--lossless", "--out", "back", "-q"]
    assert main(moving) == 0
    with rasterio.open(grid) as old, rasterio.open("back/visible_10cm.tif") as new:
        np.testing.assert_allclose(np.array(new.transform), np.array(old.transform), rtol=0, atol=1e-8)


def round_trip(original: Path, values: np.ndarray, transform: str) -> np.ndarray:
    """What differs from the original's values, edges aside, after `out/` was moved back onto its pixels."""
    words = [transform, "out/visible_10cm.tif", "--grid", str(original), "--resampling", "cubic", "--overwrite"]
    assert main(["apply", *words, "--out", "back", "-q"]) == 0
    with rasterio.open("back/visible_10cm.tif") as file:
        return np.asarray(file.read(1) - values)[8:-8, 8:-8]


def test_the_round_trip_leaves_what_resampling_and_the_error_of_the_transform_leave() -> None:
    values = (20 + 200 * brightness(CRS, north_up())).astype(np.float32)
    grid = write(Path("in/visible_10cm.tif"), values[None], CRS, north_up())
    assert misregister("in", *GIVEN) == 0
    # no pixel was resampled on the way out, so the exact transform finds them all again
    assert np.abs(round_trip(grid, values, "out/misregistration.json")).max() < 1e-3
    off = np.array([0.031, -0.017])
    record = json.loads(Path("out/misregistration.json").read_text())
    wrong = Rigid(np.eye(2), off) @ undoing()
    Path("off.json").write_text(json.dumps(record | {"transform": {"matrix": wrong.matrix.tolist()}}))
    down, across = np.gradient(values, 0.2)
    expected = np.mean(((across * off[0] - down * off[1])[8:-8, 8:-8]) ** 2)
    assert np.mean(round_trip(grid, values, "off.json") ** 2) == pytest.approx(expected, rel=0.05)


def test_the_round_trip_of_a_resampled_raster_leaves_what_resampling_twice_leaves() -> None:
    values = (20 + 200 * brightness(CRS, north_up())).astype(np.float32)
    grid = write(Path("in/visible_10cm.tif"), values[None], CRS, north_up())
    assert misregister("in", *GIVEN) == 0
    Path("still.json").write_text(json.dumps({"crs": CRS, "transform": {"matrix": np.eye(3).tolist()}}))
    words = ["still.json", "out/visible_10cm.tif", "--resampling", "cubic", "--out", "north-up", "-q"]
    assert main(["apply", *words]) == 0
    Path("north-up/visible_10cm.tif").replace("out/visible_10cm.tif")
    left = round_trip(grid, values, "out/misregistration.json")
    # the cubic kernel (Keys 1981, doi:10.1109/TASSP.1981.1163711) misses at most 0.016 of the third derivative, which
    # is at most 1.38 / s^3 of a spot's 200, s being four pixels; along two axes, on the way out and on the way back
    assert 0 < np.abs(left).max() < 4 * 0.016 * 1.38 * 200 / 4**3


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_other_formats(suffix: str) -> None:
    Path("in/raw-detections.geojson").unlink()
    table(Path("in"), suffix, "EPSG:32733")
    assert misregister("in", *GIVEN) == 0
    np.testing.assert_allclose(undoing()(centroids("out")), centroids("in"), rtol=0, atol=1e-4)


def test_run_finds_what_is_recorded() -> None:
    write_simulation(simulate(Scene(trees=300, jitter=0.1, area_persistence=0.9), 2), Path())
    assert misregister("reference", "--seed", 6) == 0
    for start in ("coarse", "out/misregistration.json"):
        words = ["run", "reference", "out", "--method", "icp", "--start", start, "--out", "found", "--overwrite", "-q"]
        assert main(words) == 0
        found = io.read_motion(Path("found/registration.json")).reference_from_source
        apart = np.hypot(*(found(centroids("out")) - undoing()(centroids("out"))).T)
        assert np.sqrt(np.mean(apart**2)) < 0.002


def test_overwrite_replaces_files_of_the_same_names_only(capsys: Output) -> None:
    assert misregister("in") == 0
    Path("out/mine.txt").write_text("keep")
    assert misregister("in") == 2
    assert "out is in use" in capsys.readouterr().err
    assert misregister("in", "--seed", 1, "--overwrite") == 0
    assert Path("out/mine.txt").read_text() == "keep"
    np.testing.assert_allclose(undoing()(centroids("out")), centroids("in"), rtol=0, atol=FILE_STEP)


BAD: list[tuple[list[str], str]] = [
    (["in", "--rotation", "1", "--rotation-sd", "1"], "--rotation and --rotation-sd exclude each other"),
    (["in", "--translation", "1", "1", "--translation-sd", "0"], "--translation and --translation-sd exclude"),
    (["in", "--rotation-sd", "-1"], "--rotation-sd"),
    (["in", "--translation-sd", "inf"], "--translation-sd must be finite"),
    (["in", "--rotation", "nan"], "--rotation must be finite"),
    (["in", "--translation", "1", "-inf"], "--translation must be finite"),
    (["in", "--translation", "1"], "--translation"),
    (["in", "--seed", "-1"], "--seed"),
    (["in", "--translation", "1e12", "0"], "lies where the transform's CRS does not reach"),
    (["absent"], "absent: there is no such folder"),
    (["empty"], "empty has no detections"),
    (["cut"], "cut/visible_10cm.tif is cut off"),
    (["image"], "image/visible_10cm.tif is no GeoTIFF, so that its georeference alone cannot be rewritten; export it"),
    (["broken"], "broken/more.json is not JSON, or is cut off"),
]


@pytest.mark.parametrize(("arguments", "sentence"), BAD, ids=lambda value: str(value)[:60])
def test_what_is_refused_is_one_sentence_and_leaves_nothing(
    arguments: list[str], sentence: str, capsys: Output
) -> None:
    Path("empty").mkdir()
    for name in ("cut", "image", "broken"):
        survey(Path(name))
    whole = painted(Path("a.tif"), compress="deflate")
    Path("cut/visible_10cm.tif").write_bytes(whole.read_bytes()[:-500])
    rasterio.shutil.copy("a.tif", "a.png", driver="PNG", worldfile=True)
    Path("a.png").rename("image/visible_10cm.tif")
    Path("a.wld").rename("image/visible_10cm.wld")
    Path("broken/more.json").write_text('{"type": ')
    assert misregister(*arguments) == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert not Path("out").exists()
    assert not list(Path().glob(".treereg*"))


@pytest.mark.parametrize("out", ["in", "."])
def test_never_over_its_own_input(out: str, capsys: Output) -> None:
    before = {path: path.read_bytes() for path in Path("in").iterdir()}
    assert misregister("in", "--overwrite", out=out) == 2
    assert "is or contains the input folder" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in Path("in").iterdir()} == before


def test_features_that_are_no_trees_move_too() -> None:
    shapes = [*trees(), feature(None, confidence=0.2), trees()[0] | {"id": "twin"}]
    Path("in/raw-detections.geojson").write_text(json.dumps(collection(shapes, name="survey")))
    assert misregister("in", *GIVEN) == 0
    found = json.loads(Path("out/raw-detections.geojson").read_text())
    assert found["name"] == "survey"
    assert [f["properties"] for f in found["features"]] == [f["properties"] for f in shapes]
    assert found["features"][-2]["geometry"] is None
    assert found["features"][-1]["geometry"] == found["features"][0]["geometry"]
