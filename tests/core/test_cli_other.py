"""`treereg methods`, `treereg check`, `treereg simulate`, and the command itself."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from tests.core.methods import REGISTRY
from treereg_core.cli import main
from treereg_core.cli.check import targets
from treereg_core.pipeline import Pipeline
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.testing.law import LawResult

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_version_and_help(capsys: Output) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"treereg {metadata.version('treereg')}\n"
    assert main([]) == main(["--help"]) == 0
    helped = capsys.readouterr().out
    assert all(command in helped for command in ("run", "methods", "check", "simulate"))


def test_methods_lists_what_is_installed(capsys: Output) -> None:
    assert main(["methods"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert "point matcher" in lines["icp"]
    assert f"treereg-icp {metadata.version('treereg-icp')}" in lines["icp"]
    assert "evaluator" in lines["truth"]


def test_methods_as_json(capsys: Output) -> None:
    assert main(["methods", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["icp"]["role"] == "point matcher"
    assert rows["icp"]["source"].startswith("https://doi.org/10.")
    assert rows["icp"]["models"] == ["rigid", "similarity", "affine"]
    reach = rows["icp"]["settings"]["reach"]
    assert {"default", "description", "exclusiveMinimum"} <= set(reach)


def test_broken_plugins_and_recipes_are_rows(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("treereg_core.cli.methods.installed", lambda: REGISTRY)
    assert main(["methods"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert "BROKEN" in lines["lost"]
    assert "ImportError: gone" in lines["lost"]
    assert main(["methods", "both"]) == 0
    page = capsys.readouterr().out
    assert "stands for sure+columns+nearest" in page
    assert "sure.least = 0.2" in page
    assert main(["methods", "nearest"]) == 0
    assert "nearest.reach = 3.0 m  (number; above 0, at most 50 m)" in capsys.readouterr().out
    assert main(["methods", "lost"]) == 2
    assert main(["methods", "middel"]) == 2
    assert "did you mean 'middle'" in capsys.readouterr().err


def test_the_judge_shows_its_settings(capsys: Output) -> None:
    assert main(["methods", "judge"]) == 0
    assert "judge." in capsys.readouterr().out
    assert main(["methods", "judge", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["role"] == "judge"


def test_a_network_is_shown_and_none_where_there_is_none(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("treereg_core.cli.methods.installed", lambda: REGISTRY)
    assert main(["methods", "middle"]) == 0
    lines = capsys.readouterr().out.partition("\nNetwork")[2].splitlines()[1:]
    assert lines[:2] == ["  near (hidden)  whether the surveys lie near each other", "                 states: no, yes"]
    assert lines[2].startswith("  meet           how many trees meet")
    assert lines[-2:] == ["                 states: few, many", "                 depends on: near"]
    assert max(map(len, lines)) <= 120
    assert main(["methods", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["middle"]["network"]["nodes"][1] == {
        "name": "meet",
        "about": "how many trees meet " * 10 + "in all",
        "states": ["few", "many"],
        "parents": ["near"],
        "hidden": False,
    }
    assert main(["methods", "nearest"]) == 0
    assert "Network" not in capsys.readouterr().out
    assert rows["nearest"]["network"] is None


@pytest.mark.parametrize(("name", "hidden"), [("bn_rows", "same"), ("bn_landmarks", "landmark")])
def test_the_networks_of_installed_methods_are_shown_without_running_them(name: str, hidden: str) -> None:
    code = (
        f"import sys; from treereg_core.cli import main; main(['methods', '{name}']); sys.exit('pgmpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    shown = done.stdout.partition("\nNetwork")[2]
    assert f"\n  {hidden} (hidden) " in shown
    assert max(map(len, shown.splitlines())) <= 120


PLUGIN = """
from treereg_core import hookimpl
from treereg_core.method import PointMatcher
class Mine(PointMatcher):
    "Mine."
    name = "mine"
    def register(self, pair, context):
        raise NotImplementedError
@hookimpl
def treereg_methods():
    return [Mine]
"""


def test_what_check_checks() -> None:
    def found(target: str) -> list[tuple[str, list[str]]]:
        return [
            (name, [stage.name for stage in method.stages] if isinstance(method, Pipeline) else [method.name])
            for name, method in targets(target, REGISTRY)
        ]

    assert found("middle") == [("middle", ["middle"])]
    assert found("columns+nearest") == [("columns+nearest", ["columns", "nearest_rows", "nearest"])]
    assert found("both") == [("both", ["sure", "columns", "nearest_rows", "nearest"])]
    ((_, pipeline),) = targets("both", REGISTRY)
    assert pipeline.stages[0].least == 0.2  # type: ignore[attr-defined]
    Path("mine.py").write_text(PLUGIN)
    assert found("mine.py") == [("mine", ["mine"])]


def test_check_refuses_what_is_not_there(capsys: Output) -> None:
    Path("broken.py").write_text(PLUGIN.replace("def register", "def registre"))
    Path("empty.py").write_text(PLUGIN.replace("[Mine]", "[]"))
    for target, sentence in (
        ("empty.py", "offers nothing to check"),
        ("icpp", "did you mean 'icp'"),
        ("icp+icpp", "nearest right expression is 'icp+icp'"),
        ("absent.py", "no such Python file"),
        ("broken.py", "it does not define register"),
    ):
        assert main(["check", target]) == 2
        assert sentence in capsys.readouterr().err


def test_simulate_writes_what_the_python_function_does(capsys: Output) -> None:
    options = ["--trees", "120", "--shift", "3", "-4.5", "--rotation", "any", "--false", "0.1", "--no-same-orchard"]
    assert main(["simulate", "there", *options, "--seed", "5", "-q", "--no-rasters"]) == 0
    scene = Scene(trees=120, shift=(3, -4.5), rotation="any", false=0.1, same_orchard=False)
    write_simulation(simulate(scene, 5), Path("here"))
    files = sorted(path.relative_to("here") for path in Path("here").rglob("*.*json"))
    assert len(files) == 5
    for file in files:
        assert (Path("here") / file).read_bytes() == (Path("there") / file).read_bytes()


def test_simulate_a_family() -> None:
    assert main(["simulate", "there", "--family", "small_150", "-q", "--no-rasters"]) == 0
    assert json.loads(Path("there/truth.json").read_text())["transform"]["model"] == "rigid"


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--trees", "2"], "--trees is 2, but must be at least 10"),
        (["--outline", "oval"], "--outline is 'oval', but must be rectangle or irregular"),
        (["--missed", "many"], "--missed is 'many'"),
        (["--row-spacing", "inf"], "--row-spacing is inf"),
        (["--family", "smal_150"], "did you mean 'small_150'"),
        (["--family", "small_150", "--gaps", "0.1"], "--family and --gaps exclude each other"),
        (["--rows", "3"], "No such option: --rows"),
        (["--seed", "-1"], "--seed"),
    ],
)
def test_a_wrong_scene_is_one_sentence_and_leaves_nothing(options: list[str], sentence: str, capsys: Output) -> None:
    assert main(["simulate", "there", *options]) == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert not Path("there").exists()


def test_simulate_does_not_touch_a_folder_in_use() -> None:
    folder = Path("mine/reference")
    folder.mkdir(parents=True)
    (folder / "raw-detections.geojson").write_text("precious")
    assert main(["simulate", "mine", "--trees", "50", "-q", "--no-rasters"]) == 2
    assert (folder / "raw-detections.geojson").read_text() == "precious"
    assert main(["simulate", "mine", "--trees", "50", "-q", "--no-rasters", "--overwrite"]) == 0


def test_simulate_has_no_out_to_choose(capsys: Output) -> None:
    Path("here").mkdir()
    Path("here/notes.txt").write_text("mine")
    assert main(["simulate", "here"]) == 2
    stderr = capsys.readouterr().err
    assert "choose another folder" in stderr
    assert "--out" not in stderr


def test_the_help_of_simulate_names_families_and_options_as_they_are_typed(capsys: Output) -> None:
    assert main(["simulate", "--help"]) == 0
    helped = capsys.readouterr().out
    assert "overlap_25" in helped
    assert "rotation_sd" not in helped


RECIPE = """
from treereg_core import hookimpl
from treereg_core.recipe import Recipe

@hookimpl
def treereg_recipes():
    return [Recipe(name="mine", expression={expression!r}, settings={settings}, description="x")]
"""


@pytest.mark.parametrize(
    ("expression", "settings", "sentence"),
    [
        ("icp", {"icp": {"reech": 1}}, "there is no setting icp.reech; did you mean 'reach'?"),
        ("icp+confidence", {}, "method 'mine': nothing after confidence would see what it selects."),
    ],
)
def test_a_wrong_recipe_is_one_sentence(
    expression: str, settings: dict[str, dict[str, float]], sentence: str, capsys: Output
) -> None:
    Path("plugin.py").write_text(RECIPE.format(expression=expression, settings=settings))
    assert main(["check", "plugin.py"]) == 2
    assert capsys.readouterr().err == f"treereg: {sentence}\n"


def test_a_law_is_one_line(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("treereg_core.testing.check", lambda method: [LawResult("it stands", False, "it fell\nin two")])
    assert main(["check", "icp"]) == 3
    assert "  BROKEN  it stands: it fell in two\n" in capsys.readouterr().out
