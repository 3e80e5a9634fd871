"""Plugin files that are used without being installed: `--plugin FILE.py` and `TREEREG_PLUGINS`."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from treereg_core import register
from treereg_core.cli import main
from treereg_core.registry import FILES, installed
from treereg_core.simulate import simulate_family

CROWNS = Path(__file__).parents[1] / "outside" / "treereg_outside" / "crowns.py"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a plugin file and two surveys of 150 trees."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(FILES, raising=False)
    assert main(["simulate", ".", "--family", "small_150", "--no-rasters"]) == 0
    shutil.copy(CROWNS, "crowns.py")
    return tmp_path


def test_a_plugin_file_runs_in_an_expression_and_the_result_names_it(here: Path) -> None:
    method = ["--method", "large_crowns+icp", "--set", "large_crowns.share=0.9"]
    assert main(["run", "reference", "source", *method, "--plugin", "crowns.py", "-q"]) == 0
    result = json.loads((here / "treereg-out" / "registration.json").read_text(encoding="utf-8"))
    assert result["plugins"]["large_crowns"] == "crowns.py (file)"
    assert result["plugins"]["icp"].startswith("treereg-icp ")
    assert result["settings"]["large_crowns"] == {"share": 0.9}


def test_every_command_that_takes_methods_takes_a_plugin_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plugin, method = ["--plugin", "crowns.py"], ["--method", "large_crowns+icp"]
    assert main(["methods", "large_crowns", *plugin]) == 0
    assert "feature filter, crowns.py (file)" in capsys.readouterr().out
    assert main(["rows", "reference", "--method", "large_crowns+aco", *plugin]) == 0
    assert main(["series", "reference", "source", *method, *plugin, "--rasters", "none"]) == 0
    assert main(["check", "large_crowns", *plugin]) == 0


def test_the_processes_of_an_evaluation_use_it_too(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    trial = ["--family", "small_150_near", "--trials", "1", "--jobs", "1"]
    assert main(["evaluate", "--method", "large_crowns+icp", "--plugin", "crowns.py", *trial]) == 0
    assert "crashed" not in capfd.readouterr().err
    (method,) = {line.split(",")[0] for line in (here / "treereg-out" / "trials.csv").read_text().splitlines()[1:]}
    assert method == "large_crowns+icp"


def test_it_lasts_for_one_command(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["methods", "large_crowns", "--plugin", "crowns.py"]) == 0
    assert FILES not in os.environ
    assert main(["methods", "large_crowns"]) == 2
    assert "there is no method 'large_crowns'" in capsys.readouterr().err


def test_it_goes_before_what_is_installed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("icp.py").write_text(CROWNS.read_text(encoding="utf-8").replace('"large_crowns"', '"icp"'), encoding="utf-8")
    assert main(["methods", "icp", "--plugin", "icp.py"]) == 0
    assert "icp: feature filter, icp.py (file)" in capsys.readouterr().out


def test_a_file_that_was_changed_is_read_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["methods", "large_crowns", "--plugin", "crowns.py"]) == 0
    before = Path("crowns.py").stat().st_mtime_ns
    Path("crowns.py").write_text(CROWNS.read_text(encoding="utf-8").replace("Field(0.7", "Field(0.6"), encoding="utf-8")
    os.utime("crowns.py", ns=(before + 1, before + 1))
    assert main(["methods", "large_crowns", "--plugin", "crowns.py"]) == 0
    assert "large_crowns.share = 0.6" in capsys.readouterr().out


def test_two_files_that_offer_one_name_are_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy("crowns.py", "again.py")
    run = ["run", "reference", "source", "--method", "large_crowns+icp", "--plugin", "crowns.py"]
    assert main([*run, "--plugin", "again.py"]) == 2
    assert "is offered by crowns.py (file) and again.py (file)" in capsys.readouterr().err
    assert not Path("treereg-out").exists()


@pytest.mark.parametrize(
    ("name", "text", "happened"),
    [
        ("absent.py", None, "there is no such Python file"),
        ("broken.py", "import nowhere_to_be_found", "broken.py cannot be loaded: ModuleNotFoundError"),
        ("empty.py", "", "it has none of the hooks"),
        (f"a{os.pathsep}b.py", None, "a path with"),
    ],
)
def test_a_file_that_is_no_plugin_is_refused_in_one_sentence(
    here: Path, capsys: pytest.CaptureFixture[str], name: str, text: str | None, happened: str
) -> None:
    if text is not None:
        Path(name).write_text(text, encoding="utf-8")
    assert main(["run", "reference", "source", "--plugin", name, "-q"]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert happened in sentence


def test_the_environment_names_plugin_files_for_python_too(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FILES, str(here / "crowns.py"))
    assert "large_crowns" in installed().names(object)
    simulation = simulate_family("small_150_near", 0)
    result = register(simulation.reference, simulation.source, method="large_crowns+icp")
    assert result.to_json()["plugins"]["large_crowns"] == f"{here / 'crowns.py'} (file)"


def test_check_does_not_say_of_a_law_that_it_holds_when_it_was_not_tried(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = CROWNS.read_text(encoding="utf-8").replace("needs_pair = False", "needs_pair = True")
    Path("crowns.py").write_text(text, encoding="utf-8")
    assert main(["check", "crowns.py"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "every law that could be tried (1 skipped) holds"
