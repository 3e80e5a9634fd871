"""`treereg series` from the outside: files, states, streams, exit codes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pandas as pd
import pytest
import rasterio
from rasterio import Affine

from treereg_core import io
from treereg_core.cli import main
from treereg_core.errors import UsageError
from treereg_core.series import Series, register_series
from treereg_core.simulate import Scene, Seasons, SeriesSimulation, simulate_series, write_series

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=4.0, rotation_sd=2.0, dead=0.03)
COLUMNS = [
    *("tree", "survey", "feature", "row_index", "tree_index", "state", "area_m2", "height_m", "confidence", "x", "y"),
    *("probability", "geometry"),
]
CRS = "EPSG:32734"
STATES = {"present", "missing", "new", "replanted", "unseen"}


@pytest.fixture(scope="module")
def orchard() -> SeriesSimulation:
    return simulate_series(CLEAR, 3, Seasons(surveys=3, seen=0.8))


@pytest.fixture(scope="module")
def folders(orchard: SeriesSimulation, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return [str(folder) for folder in write_series(orchard, tmp_path_factory.mktemp("series"))]


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A survey of another orchard on the same ground."""
    other = simulate_series(CLEAR, 99, Seasons(surveys=2))
    return str(write_series(other, tmp_path_factory.mktemp("other"))[1].rename(tmp_path_factory.mktemp("x") / "other"))


@pytest.fixture(scope="module")
def done(folders: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a series with a method that learns."""
    out = tmp_path_factory.mktemp("results") / "out"
    assert main(["series", *folders, "--method", "bn_landmarks+icp", "--out", str(out), "-q"]) == 0
    return out


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def files(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


def read(path: Path) -> Any:
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))


def test_a_series_writes_a_folder_for_each_survey_the_trees_and_what_was_learned(done: Path) -> None:
    registered = {"registration.json", "detections_registered.geojson", "tree_matches.geojson"}
    assert files(done) == {
        *("series.json", "series.html", "trees.parquet", "trees.geojson"),
        *(f"{survey}/{name}" for survey in ("2022", "2023") for name in registered),
        *("memory/memory.json", "memory/bn_landmarks.xml", "memory/.lock"),
    }
    memory = read(done / "memory" / "memory.json")
    assert {survey["name"] for survey in memory["surveys"].values()} == {"2021", "2022", "2023"}
    assert len(memory["methods"]["bn_landmarks"]["pairs"]) == 2


def test_the_table_has_a_line_for_each_tree_and_survey(
    done: Path, folders: list[str], orchard: SeriesSimulation
) -> None:
    trees = geopandas.read_parquet(done / "trees.parquet")
    assert list(trees.columns) == COLUMNS
    assert trees.crs.to_authority() == ("EPSG", "32734")
    assert len(trees) == 3 * trees.tree.nunique()
    assert (trees.groupby("tree").survey.apply(list).map(tuple) == ("2021", "2022", "2023")).all()
    assert set(trees.state) <= STATES
    shown = trees.state.isin(["present", "new", "replanted"])
    assert (shown == trees.feature.notna()).all()
    assert (shown == trees.area_m2.notna()).all()
    assert trees.height_m.isna().all()
    for survey, capture in zip(("2021", "2022", "2023"), orchard.captures, strict=True):
        feature = trees.feature[(trees.survey == survey) & shown]
        assert sorted(feature.tolist()) == list(range(len(capture.features)))


def test_the_page_holds_the_probable_trees_of_the_table(done: Path) -> None:
    text = (done / "series.html").read_text()
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found
    data = json.loads(found[1], parse_constant=pytest.fail)
    assert {**data["series"], "memory": read(done / "series.json")["memory"]} == read(done / "series.json")
    table = geopandas.read_parquet(done / "trees.parquet")
    table = table[table.probability >= 0.5]
    assert data["trees"]["number"] == table.tree.unique().tolist()
    for survey, shown in zip(("2021", "2022", "2023"), data["history"], strict=True):
        lines = table[table.survey == survey]
        states = [data["states"][state] for state in shown["state"]]
        assert [state.replace("not seen yet", "missing") for state in states] == lines.state.tolist()
        assert np.allclose(np.array(shown["area_m2"], dtype=float), lines.area_m2, atol=0.006, equal_nan=True)
        assert set(shown["height_m"]) == {None}
        counts = {state: states.count(state) for state in STATES}
        assert counts == next(said["states"] for said in data["series"]["surveys"] if said["name"] == survey)


def test_places_are_in_the_first_surveys_crs(done: Path, folders: list[str]) -> None:
    trees = geopandas.read_parquet(done / "trees.parquet")
    first = io.read_survey(Path(folders[0]))
    mine = trees[(trees.survey == "2021") & trees.feature.notna()].sort_values("feature")
    assert np.allclose(mine[["x", "y"]], first.features.xy + first.frame.origin, atol=1e-3)
    assert np.allclose(mine.area_m2, first.features.area, atol=1e-3)
    assert np.allclose(trees[["x", "y"]], trees.geometry.get_coordinates(), atol=0)
    other = trees[(trees.survey == "2022") & trees.feature.notna()]
    home = trees[trees.survey == "2021"].set_index("tree").loc[other.tree]
    assert np.median(np.hypot(*(other[["x", "y"]].to_numpy() - home[["x", "y"]].to_numpy()).T)) < 0.3


def test_the_geojson_says_the_same(done: Path) -> None:
    table = geopandas.read_parquet(done / "trees.parquet")
    points = read(done / "trees.geojson")["features"]
    assert len(points) == len(table)
    for point, line in zip(points[:50], table.drop(columns="geometry").to_dict("records"), strict=False):
        assert {name: value for name, value in point["properties"].items() if value is not None} == pytest.approx(
            {name: value for name, value in line.items() if not pd.isna(value)}
        )
    lonlat = np.array([point["geometry"]["coordinates"] for point in points])
    assert np.abs(lonlat - table.geometry.to_crs("EPSG:4326").get_coordinates().to_numpy()).max() < 2e-9


def test_rows_are_counted_from_0_and_run_through_the_trees(done: Path) -> None:
    trees = geopandas.read_parquet(done / "trees.parquet").drop_duplicates("tree")
    placed = trees[trees.row_index.notna()]
    assert len(placed) > 0.9 * (trees.probability >= 0.5).sum()
    for _, row in placed.groupby("row_index"):
        assert sorted(row.tree_index.tolist()) == list(range(len(row)))
    assert sorted(placed.row_index.unique().tolist()) == list(range(placed.row_index.nunique()))


def test_states_agree_with_the_truth(done: Path, orchard: SeriesSimulation) -> None:
    trees = geopandas.read_parquet(done / "trees.parquet")
    lives = orchard.lives
    for survey, capture in zip(("2022", "2023"), orchard.captures[1:], strict=True):
        first = trees[(trees.survey == "2021") & trees.feature.notna()].set_index("tree").feature
        now = trees[trees.survey == survey].set_index("tree").loc[first.index].state
        stem = orchard.captures[0].trees[first.to_numpy(dtype=int), 0]
        outside = (stem >= 0) & ~capture.covered[stem]
        assert not (now[outside] == "missing").any()
        dead = (stem >= 0) & capture.covered[stem] & (lives.died[stem] <= int(survey) - 2021)
        anew = np.isin(lives.spot[stem], lives.spot[capture.alive & (lives.born > 0)])
        assert now[dead & ~anew].isin(["missing", "unseen"]).mean() > 0.8


def test_it_says_what_came_of_each_survey(done: Path, folders: list[str], capsys: Output) -> None:
    said = read(done / "series.json")
    assert said["schema"] == "treereg/series/1"
    assert [survey["verdict"] for survey in said["surveys"]] == ["reference", "accepted", "accepted"]
    assert main(["series", *folders, "--method", "icp", "--overwrite", "--out", "again"]) == 0
    stdout, stderr = capsys.readouterr()
    assert stdout.startswith("2 of 2 surveys registered onto 2021")
    assert "[2/3] 2022: judge" in stderr
    assert main(["series", *folders, "--method", "icp", "--out", "json", "--json", "-q"]) == 0
    stdout, stderr = capsys.readouterr()
    assert stdout == Path("json/series.json").read_text()
    assert stderr == ""


def test_threads_change_nothing(folders: list[str]) -> None:
    for threads in ("1", "2"):
        arguments = ["series", *folders, "--method", "bn_landmarks+icp", "--threads", threads, "--out", threads, "-q"]
        assert main(arguments) == 0
    for name in ("trees.parquet", "trees.geojson", "series.json", "memory/memory.json"):
        assert Path("1", name).read_bytes() == Path("2", name).read_bytes()


@pytest.mark.parametrize("bad", ["other", "broken"])
def test_one_survey_that_fails_stops_nothing(folders: list[str], elsewhere: str, bad: str, capsys: Output) -> None:
    survey = elsewhere
    if bad == "broken":
        Path("broken").mkdir()
        Path("broken/raw-detections.geojson").write_text('{"type": "FeatureCollection", "fea')
        survey = "broken"
    assert main(["series", folders[0], survey, folders[2], "--method", "icp", "--out", "out", "-q"]) == 3
    stdout, stderr = capsys.readouterr()
    assert stdout.startswith("1 of 2 surveys registered onto 2021")
    assert stderr.count("\n") == 1
    assert f"warning: {Path(survey).name} adds no trees" in stderr
    trees = geopandas.read_parquet("out/trees.parquet")
    assert set(trees.survey) == {"2021", "2023"}
    verdicts = [survey["verdict"] for survey in read(Path("out/series.json"))["surveys"]]
    assert verdicts[::2] == ["reference", "accepted"]
    assert verdicts[1] in ({"unusable"} if bad == "broken" else {"failed", "ambiguous"})
    assert Path("out", Path(survey).name, "registration.json").exists() == (bad == "other")
    assert not Path("out", Path(survey).name, "detections_registered.geojson").exists()


def test_the_first_survey_has_to_be_right(folders: list[str], capsys: Output) -> None:
    Path("broken").mkdir()
    Path("broken/raw-detections.geojson").write_text("no")
    assert main(["series", "broken", *folders, "--method", "icp", "--out", "out"]) == 2
    assert "broken/raw-detections.geojson" in capsys.readouterr().err.splitlines()[-1]
    assert not Path("out").exists()


def test_wrong_arguments_are_refused_before_work(folders: list[str], tmp_path: Path, capsys: Output) -> None:
    shutil.copytree(folders[1], "twin/2021")
    for name in ("memory", "series.html", "line\nfeed", ".hidden"):
        shutil.copytree(folders[1], name)
    Path("link").symlink_to(folders[0])
    for arguments, word in (
        (folders[:1], "two surveys or more"),
        ([folders[0], "nowhere"], "nowhere is not a folder"),
        ([folders[0], "twin/2021"], "have the same name"),
        ([folders[0], "memory"], "rename it"),
        ([folders[0], "series.html"], "rename it"),
        ([folders[0], "line\nfeed"], "rename it"),
        ([folders[0], ".hidden"], "rename it"),
        ([folders[0], folders[0]], "are one folder"),
        ([folders[0], "link"], "are one folder"),
        ([folders[0], "/"], "rename it"),
        ([*folders, "--start", "start.json"], "no start for several surveys"),
        ([*folders, "--method", "icq"], "icp"),
        ([*folders, "--model", "bent"], "rigid"),
        ([*folders, "--out", str(Path(folders[0]).parent)], "input folder"),
    ):
        assert main(["series", *arguments]) == 2
        (sentence,) = capsys.readouterr().err.splitlines()
        assert word in sentence
    assert not Path("treereg-out").exists()


def test_overwrite_removes_what_an_earlier_series_left_and_nothing_else(folders: list[str]) -> None:
    assert main(["series", *folders, "--method", "bn_landmarks+icp", "--out", "out", "-q"]) == 0
    for mine in ("out/notes.txt", "out/2023/notes.txt", "out/memory/notes.txt"):
        Path(mine).write_text("mine")
    assert main(["series", *folders[:2], "--method", "icp", "--out", "out", "-q"]) == 2
    again = ["series", *folders[:2], "--method", "icp", "--out", "out", "-q", "--overwrite", "--no-report"]
    assert main(again) == 0
    left = files(Path("out"))
    assert {name for name in left if name.startswith("2023/")} == {"2023/notes.txt"}
    assert {"notes.txt", "memory/notes.txt", "memory/memory.json"} <= left
    assert not {"memory/bn_landmarks.xml", "series.html"} & left


def with_raster(folder: str, name: str, pixel: float) -> tuple[float, float]:
    """A copy of a survey with an orthomosaic that has one bright spot; gives where, in the survey's working CRS."""
    shutil.copytree(folder, name)
    detections = geopandas.read_file(f"{name}/raw-detections.geojson").to_crs(CRS)
    west, south, east, north = detections.total_bounds
    spot = (west + 0.4 * (east - west), south + 0.6 * (north - south))
    size = round((north - south) / pixel) + 1, round((east - west) / pixel) + 1
    y, x = np.mgrid[: size[0], : size[1]]
    square = (west + (x + 0.5) * pixel - spot[0]) ** 2 + (north - (y + 0.5) * pixel - spot[1]) ** 2
    image = np.rint(20 + 200 * np.exp(-square / 8)).astype("uint8")
    profile = {"driver": "GTiff", "height": size[0], "width": size[1], "count": 1, "dtype": "uint8", "crs": CRS}
    place = Affine(pixel, 0, west, 0, -pixel, north)
    with rasterio.open(f"{name}/visible_50cm.tif", "w", **profile, transform=place) as raster:
        raster.write(image, 1)
    return spot


def test_rasters_are_laid_on_those_of_the_first_survey(folders: list[str], capsys: Output) -> None:
    with_raster(folders[0], "first", 0.4)
    spot = with_raster(folders[1], "second", 0.5)
    with_raster(folders[2], "third", 0.5)
    cut_off = Path("third/visible_50cm.tif")
    cut_off.write_bytes(cut_off.read_bytes()[:-20_000])
    arguments = ["series", "first", "second", "third", "--method", "icp", "--out", "out"]
    assert main([*arguments, "-q"]) == 0
    assert "third: its rasters are not moved: third/visible_50cm.tif is cut off" in capsys.readouterr().err
    assert {name for name in files(Path("out")) if name.endswith(".tif")} == {"second/visible_registered.tif"}
    assert Path("out/third/detections_registered.geojson").exists()

    with rasterio.open("first/visible_50cm.tif") as first, rasterio.open("out/second/visible_registered.tif") as moved:
        assert (moved.transform, moved.shape) == (first.transform, first.shape)
        image = moved.read(1).astype(float)
    row, column = (np.average(index, weights=np.clip(image - 40, 0, None)) for index in np.indices(image.shape))
    registration = read(Path("out/second/registration.json"))
    there = np.array(registration["transform"]["matrix"]) @ [*spot, 1]
    west, north = moved.transform.c, moved.transform.f
    assert [west + 0.4 * (column + 0.5), north - 0.4 * (row + 0.5)] == pytest.approx(there[:2], abs=0.04)

    assert main([*arguments, "-q", "--overwrite", "--rasters", "none"]) == 0
    assert not list(Path("out").rglob("*.tif"))


def test_folders_may_be_given_as_dots(folders: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    Path("orchard/first/sub").mkdir(parents=True)
    for name, folder in (("orchard/first", folders[0]), ("orchard/second", folders[1])):
        shutil.copytree(folder, name, dirs_exist_ok=True)
    monkeypatch.chdir("orchard/first/sub")
    mine = Path("../registration.json")
    mine.write_text("mine")
    for _ in range(2):
        arguments = ["series", "..", "../../second/.", "--method", "icp", "--out", "../../../out", "--overwrite"]
        assert main(arguments) == 0
        assert "[2/2] second: read" in capsys.readouterr().err
    assert set(geopandas.read_parquet("../../../out/trees.parquet").survey) == {"first", "second"}
    assert mine.read_text() == "mine"


def test_a_survey_is_no_witness_to_itself(folders: list[str], capsys: Output) -> None:
    shutil.copytree(folders[1], "copy")
    assert main(["series", *folders[:2], "copy", "--method", "icp", "--out", "out", "-q"]) == 3
    stdout, stderr = capsys.readouterr()
    assert "copy adds no trees (unusable)" in stderr
    assert "holds the detections of 2022 again" in stderr
    assert stdout.startswith("1 of 2")


def test_the_same_from_python(done: Path, folders: list[str]) -> None:
    series = register_series(folders, memory="memory", method="bn_landmarks+icp")
    assert isinstance(series, Series)
    assert [member.word for member in series.members] == ["reference", "accepted", "accepted"]
    table = geopandas.read_parquet(done / "trees.parquet")
    assert series.history.state.size == len(table)
    assert Path("memory/memory.json").read_bytes() == (done / "memory" / "memory.json").read_bytes()
    with pytest.raises(UsageError, match="two surveys"):
        register_series(folders[:1], memory="memory")
