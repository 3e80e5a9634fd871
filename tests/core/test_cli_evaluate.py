"""`treereg evaluate` from the outside: files, figures, going on, refusals."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from tests.core.batches import LEAVE, environment, make_orchards
from treereg_core import io
from treereg_core.cli import main
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.transform import FloatArray, Rigid

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift=(0, 0), rotation=0)
COLUMNS = ["method", "start", "setup", "name", "seed", "trees", "rotation_deg", "translation_m", "misplaced", "verdict"]


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two surveys that lie rightly on each other, with images."""
    folder = tmp_path_factory.mktemp("orchard")
    made = simulate(CLEAR, 4)
    write_simulation(made, folder)
    for name, features in (("reference", made.reference), ("source", made.source)):
        paint(folder / name / "visible_10cm.tif", features.xy)
    return folder


def paint(path: Path, xy: FloatArray) -> None:
    """A dark crown on light ground for each tree, pixels of half a metre."""
    origin = np.array([343_000.0, 6_306_000.0])
    low, high = xy.min(axis=0) - 5, xy.max(axis=0) + 5
    width, height = np.ceil((high - low) * 2).astype(int)
    rows, columns = np.mgrid[:height, :width]
    at = np.stack([low[0] + (columns + 0.5) / 2, high[1] - (rows + 0.5) / 2], axis=-1)
    grey = np.full((height, width), 200.0)
    for tree in xy:
        grey -= 120 * np.exp(-((at - tree) ** 2).sum(axis=-1))
    transform = rasterio.Affine(0.5, 0, low[0] + origin[0], 0, -0.5, high[1] + origin[1])
    profile = {"driver": "GTiff", "width": width, "height": height, "count": 3, "dtype": "uint8"}
    with rasterio.open(path, "w", crs="EPSG:32734", transform=transform, **profile) as dataset:
        dataset.write(np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[None], 3, axis=0))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def surveys(orchard: Path) -> list[str]:
    return [str(orchard / "reference"), str(orchard / "source")]


def evaluated(*arguments: str) -> int:
    return main(["evaluate", *arguments, "--jobs", "1"])


def read(path: Path) -> Any:
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_two_surveys_by_two_starts(orchard: Path, capsys: Output) -> None:
    arguments = [*surveys(orchard), "--method", "icp", "--start", "coarse", "--start", "identity", "--trials", "4"]
    assert evaluated(*arguments, "--translation-sd", "8", "--out", "out") == 0
    stdout, stderr = capsys.readouterr()
    assert "taken as correctly georeferenced" in stdout
    assert "trials: 4 of 4" in stderr
    assert sorted(path.name for path in Path("out").iterdir()) == ["evaluation.html", "evaluation.json", "trials.csv"]
    trials = rows(Path("out/trials.csv"))
    assert len(trials) == 8
    assert list(trials[0])[: len(COLUMNS)] == COLUMNS
    said = read(Path("out/evaluation.json"))
    assert said["schema"] == "treereg/evaluation/1"
    assert set(said["plugins"]) == {"coarse", "icp", "truth", "checkpoints", "pixels", "residuals"}
    assert said["plugins"]["icp"].startswith("treereg-icp ")
    assert f"{said['plugins']['icp']}." in Path("out/evaluation.html").read_text()
    coarse, identity = said["results"]
    assert coarse["right"]["count"] == 4
    assert coarse["right"]["ci95"][0] < 1
    assert identity["right"]["count"] < 4
    assert coarse["silently_wrong"]["count"] == identity["silently_wrong"]["count"] == 0
    assert coarse["error_m"]["median"] < 0.1
    assert coarse["milestones"]["0.95"]["count"] == 4
    # the images agree where the trees do
    figures = coarse["figures_median"]
    assert figures["pixels.ncc"] > 0.75 > 0.3 > figures["pixels.ncc_before"]
    assert figures["pixels.mse"] < figures["pixels.mse_before"] / 3


def test_surveys_that_do_not_lie_on_each_other_are_told_of(tmp_path: Path, capsys: Output) -> None:
    write_simulation(simulate(CLEAR.model_copy(update={"shift": (2.5, 1.0)}), 4), tmp_path / "orchard")
    arguments = ["evaluate", *surveys(tmp_path / "orchard"), "--trials", "5", "--jobs", "1", "--out", "out"]
    assert main(arguments) == 0
    said = re.search(r"all lie (\d\.\d\d) m from where the files have", capsys.readouterr().err)
    assert said is not None
    assert float(said[1]) == pytest.approx(np.hypot(2.5, 1.0), abs=0.1)
    assert any("register them first" in note for note in json.loads(Path("out/evaluation.json").read_text())["notes"])


def test_one_survey_alone_is_said_to_be_too_easy(orchard: Path, capsys: Output) -> None:
    assert evaluated(surveys(orchard)[0], "--method", "icp", "--trials", "2", "--out", "out", "-q") == 0
    stdout, stderr = capsys.readouterr()
    assert "too easy" in stdout
    assert stderr == ""
    assert read(Path("out/evaluation.json"))["results"][0]["error_m"]["median"] < 0.02


def test_families_and_the_page(capsys: Output) -> None:
    arguments = ["--family", "small_150_near", "--family", "small_60", "--trials", "3", "--method", "icp"]
    assert evaluated(*arguments, "--out", "out", "--json", "-q") == 0
    stdout, _ = capsys.readouterr()
    assert stdout == Path("out/evaluation.json").read_text()
    assert [result["name"] for result in json.loads(stdout)["results"]] == ["small_150_near", "small_60", "all"]
    page = Path("out/evaluation.html").read_text()
    assert page.count("<svg viewBox") == 3 + 1  # three plots, one label
    assert "small_60" in page
    assert not re.search(r"(?:src|href)\s*=|url\(|<script|https?://", page)


def test_an_evaluation_goes_on_and_is_begun_anew(orchard: Path, capsys: Output) -> None:
    arguments = [*surveys(orchard), "--method", "icp", "--out", "out"]
    assert evaluated(*arguments, "--trials", "2") == 0
    first = Path("out/trials.csv").read_text()
    assert evaluated(*arguments, "--trials", "3") == 0
    assert "trials: 1 of 1" in capsys.readouterr().err
    assert Path("out/trials.csv").read_text().startswith(first)
    assert len(rows(Path("out/trials.csv"))) == 3
    assert evaluated(*arguments, "--trials", "3", "--max-failure", "0.5") == 2
    assert "under other options" in capsys.readouterr().err
    assert len(list(Path("out").iterdir())) == 3
    Path("out/notes.txt").write_text("mine")
    assert evaluated(*arguments, "--trials", "2", "--max-failure", "0.5", "--overwrite") == 0
    assert len(rows(Path("out/trials.csv"))) == 2
    assert Path("out/notes.txt").read_text() == "mine"


def test_an_evaluation_that_is_begun_anew_replaces_the_one_before_when_it_is_done(
    orchard: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    arguments = [*surveys(orchard), "--method", "icp", "--out", "out"]
    other = [*arguments, "--trials", "2", "--max-failure", "0.5"]
    assert evaluated(*arguments, "--trials", "1") == 0
    before = {path: path.read_bytes() for path in Path("out").iterdir()}

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("treereg_core.cli.evaluate.write_evaluation", interrupted)
        assert evaluated(*other, "--overwrite") == 130
    assert {path: path.read_bytes() for path in before} == before
    assert {path.name for path in Path("out").iterdir()} == {*(path.name for path in before), "trials-new.csv"}
    capsys.readouterr()
    assert evaluated(*other) == 0
    assert "trials" not in capsys.readouterr().err
    assert len(rows(Path("out/trials.csv"))) == 2
    assert {path.name for path in Path("out").iterdir()} == {path.name for path in before}


def test_the_same_seed_gives_the_same_trials(orchard: Path) -> None:
    for out in ("one", "two"):
        assert evaluated(*surveys(orchard), "--method", "icp", "--trials", "2", "--seed", "5", "--out", out, "-q") == 0
    one, two = (rows(Path(out, "trials.csv")) for out in ("one", "two"))
    for row in (*one, *two):
        for timed in ("start_s", "match_s", "judge_s"):
            del row[timed]
    assert one == two
    assert [row["seed"] for row in one] == ["5", "6"]


@pytest.mark.parametrize("degrees", [False, True])
def test_checkpoints(orchard: Path, degrees: bool, capsys: Output) -> None:
    survey = io.read_survey(Path(surveys(orchard)[0]))
    points = np.random.default_rng(0).uniform(-50, 50, (12, 2))
    off = points + (0.3, 0.4)  # noqa: RUF005 -- coordinates, not a longer sequence
    from treereg_core.io.crs import from_frame

    if degrees:
        header = "name,reference_lon,reference_lat,source_lon,source_lat"
        columns = [from_frame(points, survey.frame), from_frame(off, survey.frame)]
    else:
        header = "name,reference_x,reference_y,source_x,source_y"
        columns = [points + survey.frame.origin, off + survey.frame.origin]
    lines = [",".join([str(k), *map(repr, map(float, line))]) for k, line in enumerate(np.hstack(columns))]
    Path("points.csv").write_text("\n".join([header, *lines]) + "\n")
    arguments = [*surveys(orchard), "--method", "icp", "--trials", "1", "--checkpoints", "points.csv", "--out", "out"]
    assert evaluated(*arguments) == 0
    figures = read(Path("out/evaluation.json"))["results"][0]["figures_median"]
    # the points are half a metre off, and the registration some centimetres
    assert figures["checkpoints.rmse_m"] == pytest.approx(0.5, abs=0.1)
    assert figures["checkpoints.ce90_m"] == pytest.approx(0.5, abs=0.15)


def test_a_method_that_kills_its_process_loses_its_own_trials_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_orchards(tmp_path)
    for name, value in environment(tmp_path).items():
        monkeypatch.setenv(name, value)
    command = [sys.executable, "-c", "import sys; from treereg_core.cli import main; sys.exit(main())", "evaluate"]
    surveys = [tmp_path / "good" / "reference", tmp_path / str(LEAVE)]
    options = ["--method", "troubled", "--method", "icp", "--trials", "1", "--jobs", "1", "--out", "out"]
    done = subprocess.run([*command, *map(str, [*surveys, *options])], capture_output=True, text=True, check=True)
    assert "exit code 3" in done.stderr
    assert "Traceback" not in done.stderr
    trials = rows(Path("out/trials.csv"))
    assert [(trial["method"], trial["verdict"] == "crashed") for trial in trials] == [
        *(("icp", False), ("troubled", True)),
    ]
    assert trials[0]["residuals.rms_m"] != "nan"
    assert [result["crashed"] for result in read(Path("out/evaluation.json"))["results"]] == [1, 0]


def test_what_cannot_be_done_is_refused(orchard: Path, capsys: Output) -> None:
    Path("empty.csv").write_text("reference_x,reference_y,source_x,source_y\n")
    Path("odd.csv").write_text("reference_x,reference_y,source_x,source_y\n1,2,3,four\n")
    Path("other.csv").write_text("a,b\n1,2\n")
    Path("full").mkdir()
    Path("full/thesis.txt").write_text("mine")
    both = surveys(orchard)
    for arguments, word in (
        ([*both, both[0]], "two surveys at most"),
        ([*both, "--family", "noisy"], "--family is of simulated surveys"),
        (["--family", "noisi"], "no family or group 'noisi'"),
        (["--checkpoints", "empty.csv"], "give their folders"),
        ([both[0], "--checkpoints", "empty.csv"], "give both"),
        ([*both, "--checkpoints", "empty.csv"], "holds no point"),
        ([*both, "--checkpoints", "odd.csv"], "point 1 holds something that is no number"),
        ([*both, "--checkpoints", "other.csv"], "has no columns"),
        ([*both, "--checkpoints", "nowhere.csv"], "nowhere.csv cannot be read"),
        ([*both, "--start", "start.json"], "no start for many trials"),
        ([*both, "--set", "aco.ants=3"], "the stage 'aco' is not used here"),
        ([*both, "--method", "icq"], "icp"),
        ([*both, "--trials", "0"], "--trials"),
        ([*both, "--out", "full"], "full is in use"),
        ([*both, "--out", str(orchard)], "input folder"),
        (["nowhere"], "nowhere"),
    ):
        assert evaluated(*arguments, "--method", "icp") == 2, arguments
        sentence = capsys.readouterr().err.splitlines()[-1]
        assert word in sentence, arguments
    assert Path("full/thesis.txt").read_text() == "mine"


def test_settings_go_to_the_methods_that_have_them(orchard: Path) -> None:
    methods = ["--method", "icp", "--method", "confidence+icp"]
    settings = ["--set", "confidence.share=0.5", "--set", "icp.reach=0.5"]
    assert evaluated(*surveys(orchard), *methods, *settings, "--trials", "1", "--out", "out", "-q") == 0
    setups = read(Path("out/evaluation.json"))["setups"]
    assert [setup["settings"] for setup in setups] == [
        {"icp": {"reach": 0.5}},
        {"confidence": {"share": 0.5}, "icp": {"reach": 0.5}},
    ]


def test_a_transform_of_a_picture_is_that_of_its_survey(orchard: Path) -> None:
    reference, source = io.read_surveys(*map(Path, surveys(orchard)))
    images = io.read_images(reference, source)
    assert images is not None
    from treereg_core.image import agreement

    right = agreement(*images, Rigid.identity())
    off = agreement(*images, Rigid.turn(0, shift=(0.5, 0)))
    assert right is not None
    assert off is not None
    assert right[1] > off[1] + 0.02
