"""What strangers build, built and installed as they would: wheels in a fresh environment, used in another folder.

The outside plugin of the guide, the template under a new name, and the example around pycpd. Needs uv, and its cache or
a registry for what the wheels depend on.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CORE = (ROOT, *(ROOT / "plugins" / name for name in ("aco", "coarse", "icp")))
UV = os.environ.get("UV") or shutil.which("uv")
IGNORED = shutil.ignore_patterns(".*", "__pycache__", "dist")

pytestmark = pytest.mark.skipif(UV is None, reason="uv makes the fresh environment, and it is not here")


@dataclass(frozen=True)
class Fresh:
    """An environment with treereg and what strangers built, and a folder with two surveys to work in."""

    environment: Path
    folder: Path

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    def run(self, *words: str | Path, **environment: str) -> str:
        """What Python, or another program of the environment beside it, prints with these arguments."""
        told = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "TREEREG", "UV"))}
        done = subprocess.run(
            [self.python.with_name(str(words[0])), *words[1:]],
            cwd=self.folder,
            env={**told, **environment},
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr
        return done.stdout

    def treereg(self, *words: str) -> str:
        """What a command prints."""
        return self.run("treereg", *words)


def uv(*words: str | Path) -> None:
    """Run uv, without a word; what went wrong is the assertion's message."""
    done = subprocess.run([str(UV), *words, "--quiet"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Fresh:
    home = tmp_path_factory.mktemp("strangers")
    named = shutil.copytree(ROOT / "examples" / "template", home / "named", ignore=IGNORED)
    subprocess.run([sys.executable, named / "rename.py", "sure_trees"], check=True)
    outside = shutil.copytree(ROOT / "tests" / "outside", home / "outside", ignore=IGNORED)
    cpd = shutil.copytree(ROOT / "examples" / "cpd", home / "cpd", ignore=IGNORED)
    for folder in (*CORE, named, outside, cpd):
        uv("build", "--wheel", folder, "--out-dir", home / "dist")
    made = Fresh(home / "environment", home / "work")
    uv("venv", "--python", sys.executable, made.environment)
    uv("pip", "install", "--python", made.python, "scipy-stubs", *sorted((home / "dist").glob("*.whl")))
    made.folder.mkdir()
    made.treereg("simulate", ".", "--family", "small_150", "--no-rasters")
    return made


def test_everything_is_there_and_the_tools_of_tests_are_not(fresh: Fresh) -> None:
    entries = {entry["name"]: entry for entry in json.loads(fresh.treereg("methods", "--json"))}
    assert [entry["problem"] for entry in entries.values() if entry["problem"]] == []
    assert {name: entries[name]["distribution"] for name in ("mutual", "outside", "sure_trees", "cpd")} == {
        "mutual": "treereg-outside",
        "outside": "treereg-outside",
        "sure_trees": "treereg-sure-trees",
        "cpd": "treereg-cpd",
    }
    for tool in ("pytest", "hypothesis"):
        fresh.run("python", "-c", f"import importlib.util; assert importlib.util.find_spec({tool!r}) is None")


@pytest.mark.parametrize("target", ["large_crowns", "sure_trees", "cpd", "sure_trees+icp"])
def test_check_finds_every_law_kept(fresh: Fresh, target: str) -> None:
    assert fresh.treereg("check", target).splitlines()[-1] == "every law holds"


def test_check_takes_a_file_that_is_not_installed(fresh: Fresh) -> None:
    text = (ROOT / "tests" / "outside" / "treereg_outside" / "crowns.py").read_text(encoding="utf-8")
    (fresh.folder / "mine.py").write_text(text.replace('"large_crowns"', '"mine"'), encoding="utf-8")
    assert fresh.treereg("check", "mine.py").splitlines()[-1] == "every law holds"
    fresh.treereg("run", "reference", "source", "--method", "mine+cpd", "--plugin", "mine.py", "--overwrite")


@pytest.mark.parametrize("method", ["large_crowns+icp", "outside", "sure_trees+icp", "cpd", "aco+cpd"])
def test_it_runs_in_an_expression_with_built_in_methods(fresh: Fresh, method: str) -> None:
    said = json.loads(fresh.treereg("run", "reference", "source", "--method", method, "--json", "--overwrite"))
    truth = json.loads((fresh.folder / "truth.json").read_text(encoding="utf-8"))
    assert said["verdict"] == "accepted"
    assert said["transform"]["rotation_deg"] == pytest.approx(truth["transform"]["rotation_deg"], abs=0.5)
    assert {"outside": "mutual"}.get(method, method.rpartition("+")[2]) in said["plugins"]


@pytest.mark.parametrize("package", ["treereg_outside", "treereg_sure_trees", "treereg_cpd"])
def test_its_types_hold_in_strict_mode(fresh: Fresh, package: str) -> None:
    folder = fresh.folder.parent / {"treereg_sure_trees": "named"}.get(package, package.removeprefix("treereg_"))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--python-executable", fresh.python, package],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("plugin", ["named", "cpd"])
def test_its_own_tests_pass(fresh: Fresh, plugin: str, tmp_path: Path) -> None:
    uv("pip", "install", "--python", fresh.python, "--target", tmp_path, "pytest")
    tests = fresh.folder.parent / plugin / "tests"
    fresh.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", tests, PYTHONPATH=str(tmp_path))


def test_the_renamed_template_has_no_trace_of_its_old_name(fresh: Fresh) -> None:
    folder = fresh.folder.parent / "named"
    files = [path for path in folder.rglob("*") if path.suffix in {".py", ".toml", ".md"}]
    assert [path for path in files if "template" in (path.name + path.read_text(encoding="utf-8")).lower()] == []
    assert not (folder / "rename.py").exists()
