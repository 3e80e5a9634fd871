"""Rasters through `treereg run`: where they come to lie, which are written, and what is refused before the work."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from io_files import CRS, ORIGIN
from raster_files import brightness, misplaced, write
from rasterio.transform import Affine as Geotransform

from treereg_core.cli import main
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.transform import Affine

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=500, jitter=0.1, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)
PIXEL = 0.5
SIZE = 360


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder)
    return folder


@pytest.fixture
def orchard(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two surveys with an image and heights each, in which twenty trees are bright; the source's heights are turned."""
    for name in ("reference", "source"):
        (tmp_path / name).mkdir()
        for file in (made / name).iterdir():
            (tmp_path / name / file.name).write_bytes(file.read_bytes())
    (tmp_path / "truth.json").write_bytes((made / "truth.json").read_bytes())
    spots, truth = trees(tmp_path), transform(tmp_path / "truth.json")
    back = truth.inverse()(spots)
    corner, side = ORIGIN - np.array([90.0, 90.0]), PIXEL
    plain = Geotransform(side, 0, corner[0], 0, -side, corner[1] + SIZE * side)
    turned = Geotransform(0.4, 0.3, corner[0] - 36, 0.3, -0.4, corner[1] + 108)
    paint(tmp_path / "reference" / "visible_50cm.tif", plain, spots, np.uint8)
    paint(tmp_path / "reference" / "dem_50cm.tif", plain, spots, np.float32)
    paint(tmp_path / "source" / "visible_50cm.tif", plain, back, np.uint8)
    paint(tmp_path / "source" / "dem_50cm.tif", turned, back, np.float32)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def paint(path: Path, grid: Geotransform, spots: np.ndarray, dtype: Any) -> None:
    bands = 3 if dtype is np.uint8 else 1
    values = np.repeat(20 + 200 * brightness(CRS, grid, SIZE, spots)[None], bands, axis=0)
    write(path, values.round().astype(dtype), CRS, grid)


def trees(folder: Path) -> np.ndarray:
    """Twenty trees that stand apart, metres about `ORIGIN`, in the reference."""
    xy = np.array([tree["xy"] for tree in json.loads((folder / "truth.json").read_text())["trees"]]) - ORIGIN
    chosen: list[np.ndarray] = []
    for point in xy:
        if np.abs(point).max() < 65 and all(np.hypot(*(point - other)) > 22 for other in chosen):
            chosen.append(point)
    return np.array(chosen[:20])


def transform(path: Path) -> Affine:
    return Affine.from_matrix(json.loads(path.read_text())["transform"]["matrix"]).about(ORIGIN)


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


VECTORS = ["detections_registered.geojson", "registration.json", "tree_matches.geojson"]
RASTERS = ["dem_registered.tif", "visible_registered.tif"]


def test_rasters_come_to_lie_on_the_references_grid(orchard: Path, capsys: Output) -> None:
    assert main(["run", "reference", "source"]) == 0
    out = Path("treereg-out")
    assert names(out) == sorted(VECTORS + RASTERS)
    stdout, stderr = capsys.readouterr()
    assert "treereg-out/dem_registered.tif" in stdout
    assert "%" not in stderr
    found = json.loads((out / "registration.json").read_text())
    assert found["timings_s"]["rasters"] > 0
    placed = transform(out / "registration.json")(transform(Path("truth.json")).inverse()(trees(orchard)))
    for kind in ("visible", "dem"):
        assert misplaced(out / f"{kind}_registered.tif", placed) < 0.1
        with rasterio.open(out / f"{kind}_registered.tif") as new, rasterio.open(f"reference/{kind}_50cm.tif") as old:
            assert (new.transform, new.shape, new.crs) == (old.transform, old.shape, old.crs)


def test_lossless_other_extents_and_none(orchard: Path) -> None:
    runs = {
        "lossless": ["--rasters", "lossless", "--world-file", "--gcp-points"],
        "wide": ["--extent", "source", "--resampling", "lanczos"],
        "none": ["--rasters", "none"],
    }
    for name, options in runs.items():
        assert main(["run", "reference", "source", "-q", "--out", name, *options]) == 0
    assert names(Path("none")) == VECTORS
    more = [
        "dem_registered.tfw",
        "dem_registered.tif.points",
        "visible_registered.tfw",
        "visible_registered.tif.points",
    ]
    assert names(Path("lossless")) == sorted(VECTORS + RASTERS + more)
    placed = transform(Path("lossless/registration.json"))(transform(Path("truth.json")).inverse()(trees(orchard)))
    for name in ("lossless", "wide"):
        assert misplaced(Path(name) / "visible_registered.tif", placed) < 0.1
        assert misplaced(Path(name) / "dem_registered.tif", placed) < 0.1
    assert main(["run", "reference", "source", "-q", "--out", "lossless", "--overwrite", "--rasters", "none"]) == 0
    assert names(Path("lossless")) == VECTORS


def test_the_same_bytes_at_any_number_of_threads(orchard: Path) -> None:
    for threads in ("1", "2"):
        assert main(["run", "reference", "source", "-q", "--threads", threads, "--out", threads]) == 0
    for name in RASTERS:
        assert Path("1", name).read_bytes() == Path("2", name).read_bytes()


def test_only_what_is_accepted_is_moved_unless_forced(orchard: Path) -> None:
    arguments = ["run", "reference", "reference", "-q", "--max-failure", "0"]
    code = main(arguments)
    assert ("visible_registered.tif" in names(Path("treereg-out"))) == (code == 0)
    assert main([*arguments, "--force"]) == code
    assert "visible_registered.tif" in names(Path("treereg-out"))


def test_other_layouts_are_kept_with_a_warning(orchard: Path, capsys: Output) -> None:
    with rasterio.open("source/dem_50cm.tif") as file:
        values, grid = file.read(), file.transform
    write(Path("source/dem_50cm.tif"), np.concatenate([values, values]).astype(np.float64), CRS, grid)
    assert main(["run", "reference", "source", "-q"]) == 0
    assert "2 bands of float64, but reference/dem_50cm.tif 1 band of float32" in capsys.readouterr().err
    with rasterio.open("treereg-out/dem_registered.tif") as file:
        assert file.dtypes == ("float64", "float64")


def test_without_a_raster_of_the_reference_it_covers_all(orchard: Path) -> None:
    Path("reference/visible_50cm.tif").unlink()
    assert main(["run", "reference", "source", "-q"]) == 0
    placed = transform(Path("treereg-out/registration.json"))
    spots = placed(transform(Path("truth.json")).inverse()(trees(orchard)))
    assert misplaced(Path("treereg-out/visible_registered.tif"), spots) < 0.1


def test_a_raster_without_crs_is_taken_to_lie_among_its_trees(orchard: Path, capsys: Output) -> None:
    with rasterio.open("source/visible_50cm.tif") as file:
        values, grid = file.read(), file.transform
    write(Path("source/visible_50cm.tif"), values, None, grid)
    assert main(["run", "reference", "source", "-q"]) == 0
    assert "warning: source/visible_50cm.tif has no CRS; it is taken to be in EPSG:32734" in capsys.readouterr().err
    assert "visible_registered.tif" in names(Path("treereg-out"))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-2000])


def elsewhere(path: Path) -> None:
    with rasterio.open(path, "r+") as file:
        file.transform = Geotransform(1, 0, 0, 0, -1, 5)


BAD = {"cut off": cut, "does not lie where the trees": elsewhere, "cannot be read": lambda path: path.write_text("no")}


@pytest.mark.parametrize("words", BAD)
@pytest.mark.parametrize("survey", ["reference", "source"])
def test_bad_rasters_are_refused_before_the_work(orchard: Path, capsys: Output, survey: str, words: str) -> None:
    path = orchard / survey / "dem_50cm.tif"
    BAD[words](path)
    before = names(orchard)
    assert main(["run", "reference", "source"]) == 2
    stderr = capsys.readouterr().err
    assert words in stderr
    assert f"{survey}/dem_50cm.tif" in stderr
    assert "match:" not in stderr
    assert names(orchard) == before
    if words != "cannot be read":
        assert main(["run", "reference", "source", "-q", "--rasters", "none"]) == 0


@pytest.mark.parametrize("where", ["treereg_core.io.cog.rasterio.shutil.copy", "treereg_core.io.rasters.verify"])
def test_an_interruption_leaves_nothing(orchard: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where.replace("treereg_core.io.cog.", ""), interrupted)
    before = names(orchard)
    assert main(["run", "reference", "source", "-q"]) == 130
    assert names(orchard) == before


def test_a_raster_that_breaks_in_the_middle_leaves_nothing(orchard: Path, capsys: Output) -> None:
    path = orchard / "source" / "visible_50cm.tif"
    with rasterio.open(path) as file:
        write(path, file.read(), CRS, file.transform, compress="deflate")
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 2000] = b"\0" * 2000
    path.write_bytes(content)
    before = names(orchard)
    assert main(["run", "reference", "source", "-q"]) == 2
    assert "source/visible_50cm.tif is damaged near row" in capsys.readouterr().err
    assert names(orchard) == before
