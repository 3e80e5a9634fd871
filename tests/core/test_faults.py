"""What goes wrong outside: killed processes, full disks, files that change, two at once, streams that are closed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from treereg_core import register
from treereg_core.cli import main
from treereg_core.errors import InputError
from treereg_core.evaluation.files import evaluation_folder
from treereg_core.io import OutputFolder, move_vector, read_survey, settle_left
from treereg_core.io.layer import read_layer
from treereg_core.io.place import place
from treereg_core.io.staging import PREFIX
from treereg_core.outputs import write_result
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.survey_copy import survey_copy

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=120, jitter=0.1, area_persistence=0.9, shift=(1, 0), rotation=0)
MAIN = "import sys; from treereg_core.cli import main; sys.exit(main())"
KILLED_AT = """
import os, signal
replace, calls = os.replace, []
def killing(source, target):
    calls.append(target)
    if len(calls) == {step}:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(source, target)
os.replace = killing
"""
LIMITED = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
"""


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 0), folder, rasters=True)
    return folder


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def treereg(*words: object, before: str = "") -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, which runs some lines of Python first."""
    command = [sys.executable, "-c", before + MAIN, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def run_words(orchard: Path, *more: object) -> list[str]:
    return ["run", str(orchard / "reference"), str(orchard / "source"), "--method", "icp", "-q", *map(str, more)]


def tree(folder: Path) -> dict[str, bytes]:
    """The files below a folder, those left over apart."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files if PREFIX not in str(path)}


def left_over(folder: Path) -> list[Path]:
    return list(folder.rglob(f"{PREFIX}*"))


def sentence(text: str) -> str:
    """The one line that a command said."""
    (line,) = text.splitlines()
    assert line.startswith("treereg: ")
    return line


def simulated(folder: Path, seed: int) -> list[str]:
    return ["simulate", str(folder), "--trees", "60", "--no-rasters", "--seed", str(seed), "-q"]


def test_killed_at_any_step_of_the_arrival_the_folder_is_old_or_new(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, replace, calls = here / "x", os.replace, list[object]()
    assert main(simulated(folder, 0)) == 0
    assert main(simulated(here / "y", 1)) == 0
    old, new = tree(folder), tree(here / "y")
    monkeypatch.setattr(os, "replace", lambda *paths: (calls.append(paths), replace(*paths)))
    assert main([*simulated(folder, 0), "--overwrite"]) == 0
    last, count = len(calls), len(old)
    seen = set()
    for step in (last - 2 * count, last - count - 1, last - count, last - count + 1, last):
        done = treereg(*simulated(folder, 1), "--overwrite", before=KILLED_AT.format(step=step))
        assert done.returncode == -9
        now = tree(folder)
        assert now in (old, new) or "truth.json" not in now
        assert not (now.items() - old.items() and now.items() - new.items())
        settle_left(folder)
        seen.add(tree(folder) == new)
        assert tree(folder) in (old, new)
        assert main([*simulated(folder, 0), "--overwrite"]) == 0
        assert tree(folder) == old
    assert seen == {False, True}
    assert left_over(here) == []


@pytest.mark.parametrize("step", [1, 2])
def test_killed_while_a_folder_is_new_nothing_arrives_and_the_next_run_works(here: Path, step: int) -> None:
    assert treereg(*simulated(here / "a" / "x", 1), before=KILLED_AT.format(step=step)).returncode == -9
    assert not tree(here)
    assert main(simulated(here / "a" / "x", 1)) == 0
    assert left_over(here) == []
    assert "truth.json" in tree(here / "a" / "x")


def test_a_killed_report_leaves_the_old_page_and_nothing_in_the_way(orchard: Path, here: Path) -> None:
    assert main(run_words(orchard, "--rasters", "none")) == 0
    out = here / "treereg-out"
    before = tree(out)
    assert treereg("report", out, before=KILLED_AT.format(step=1)).returncode == -9
    assert tree(out) == before
    assert len(left_over(out)) == 1
    assert main(["report", str(out), "-q"]) == 0
    assert left_over(out) == []
    assert treereg("report", out, before=KILLED_AT.format(step=1)).returncode == -9
    assert main(run_words(orchard, "--rasters", "none")) == 0
    assert left_over(out) == []


def test_a_memory_survives_whoever_writes_it(here: Path) -> None:
    write = "from treereg_core import io\nwith io.memory_lock(Path('m')): io.write_memory(Path('m'), {'a': %d}, {})\n"
    for value, before in ((1, ""), (2, KILLED_AT.format(step=1)), (3, "")):
        code = f"{before}\nfrom pathlib import Path\n{write % value}"
        subprocess.run([sys.executable, "-c", code], check=False)
        assert json.loads((here / "m" / "memory.json").read_bytes())["a"] == (1 if before else value)
        assert bool(left_over(here)) == bool(before)


def test_two_runs_into_one_folder(orchard: Path, here: Path, capsys: Output) -> None:
    for target in (here / "new" / "folder", here):
        with OutputFolder(target, overwrite=True) as folder:
            (folder / "registration.json").write_text("first")
            assert main(run_words(orchard, "--out", target, "--overwrite")) == 2
            assert "another run is at work in" in sentence(capsys.readouterr().err)
        assert (target / "registration.json").read_text() == "first"


def test_two_evaluations_in_one_folder(orchard: Path, here: Path, capsys: Output) -> None:
    words = ["evaluate", str(orchard / "source"), "--method", "icp", "--trials", "1", "--jobs", "1", "--out", "x", "-q"]
    with evaluation_folder(here / "x", (), overwrite=False):
        assert main(words) == 2
        assert "another evaluation is at work" in sentence(capsys.readouterr().err)
    assert main(words) == 0
    assert {path.name for path in (here / "x").iterdir()} == {"trials.csv", "evaluation.json", "evaluation.html"}


@pytest.mark.parametrize("step", range(1, 7))
def test_killed_while_an_evaluation_arrives_no_trial_is_lost(orchard: Path, here: Path, step: int) -> None:
    words = ["evaluate", str(orchard / "source"), "--method", "icp", "--jobs", "1", "--out", "x", "-q", "--trials"]
    assert main([*words, "1"]) == 0
    assert treereg(*words, "2", before=KILLED_AT.format(step=step + 2)).returncode == -9
    assert main([*words, "2"]) == 0
    assert {path.name for path in (here / "x").iterdir()} == {"trials.csv", "evaluation.json", "evaluation.html"}
    lines = (here / "x" / "trials.csv").read_text().splitlines()
    assert [line.split(",")[4] for line in lines] == ["seed", "0", "1"]


@pytest.mark.parametrize("name", ["raw-detections.geojson", "dem_10cm.tif", "visible_10cm.tif"])
@pytest.mark.parametrize("how", ["changed", "removed"])
def test_a_file_that_changes_while_it_is_used(
    orchard: Path, here: Path, name: str, how: str, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    shutil.copytree(orchard, here / "o")
    file = here / "o" / "source" / name

    def meanwhile(*arguments: object, **named: object) -> object:
        if how == "removed":
            file.unlink()
        else:
            file.write_bytes(file.read_bytes()[:-9])
        return write_result(*arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr("treereg_core.cli.run.write_result", meanwhile)
    assert main(run_words(here / "o")) == 2
    assert f"{file} was {how} while it was used" in sentence(capsys.readouterr().err)
    assert [path.name for path in here.iterdir()] == ["o"]


def test_a_file_that_changes_while_it_is_moved(
    orchard: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    shutil.copytree(orchard / "source", here / "o")
    file = here / "o" / "raw-detections.geojson"

    def meanwhile(*arguments: Any) -> None:
        move_vector(*arguments)
        file.write_text(file.read_text() + " ")

    monkeypatch.setattr("treereg_core.application.io.move_vector", meanwhile)
    assert main(["apply", str(orchard / "truth.json"), str(file), "--out", "x", "-q"]) == 2
    assert f"{file} was changed while it was used" in sentence(capsys.readouterr().err)
    assert [path.name for path in here.iterdir()] == ["o"]


def test_a_survey_that_changes_between_its_reading_and_its_copying(
    orchard: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    shutil.copytree(orchard / "source", here / "o")
    file = here / "o" / "raw-detections.geojson"

    def meanwhile(*arguments: Any) -> Any:
        file.write_text(file.read_text() + " ")
        return survey_copy(*arguments)

    monkeypatch.setattr("treereg_core.cli.misregister.survey_copy", meanwhile)
    assert main(["misregister", str(here / "o"), "--out", "x", "-q"]) == 2
    assert f"{file} was changed while it was used" in sentence(capsys.readouterr().err)
    assert [path.name for path in here.iterdir()] == ["o"]


@pytest.mark.parametrize("when", ["read", "placed"])
def test_a_survey_that_changes_while_it_is_read_in_python(
    orchard: Path, here: Path, monkeypatch: pytest.MonkeyPatch, when: str
) -> None:
    shutil.copytree(orchard, here / "o")
    file = here / "o" / "source" / "raw-detections.geojson"
    step, real = ("capture.read_layer", read_layer) if when == "read" else ("reading.place", place)

    def meanwhile(*arguments: Any) -> Any:
        found = real(*arguments)
        file.write_text(file.read_text() + " ")
        return found

    monkeypatch.setattr(f"treereg_core.io.{step}", meanwhile)
    for reading in (read_survey, lambda folder: register(here / "o" / "reference", folder, method="icp")):
        with pytest.raises(InputError, match=r"raw-detections\.geojson was changed while it was used"):
            reading(here / "o" / "source")


@pytest.mark.parametrize("name", ["raw-detections.geojson", "dem_10cm.tif"])
def test_a_result_is_not_saved_when_its_survey_is_another_one(orchard: Path, here: Path, name: str) -> None:
    shutil.copytree(orchard, here / "o")
    result = register(here / "o" / "reference", here / "o" / "source", method="icp")
    assert len(result.registered()) > 0
    file = here / "o" / "source" / name
    os.utime(file, ns=(0, 0))
    for use in (result.registered, lambda: result.save("x")):
        with pytest.raises(InputError, match="was changed while it was used"):
            use()
    assert [path.name for path in here.iterdir()] == ["o"]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="the system has no /proc")
@pytest.mark.parametrize(
    "words",
    [
        "run REFERENCE SOURCE --out /proc/x",
        "run --out /proc/x",
        "series REFERENCE SOURCE --out /proc/x",
        "evaluate REFERENCE SOURCE --out /proc/x",
        "evaluate --family small_60 --out /proc/x",
        "batch orchards.csv --out /proc/x",
        "simulate /proc/x",
        "misregister SOURCE --out /proc/x",
        "apply TRUTH SOURCE/dem_10cm.tif --out /proc/x",
        "rows REFERENCE --out /proc/x/rows.geojson",
    ],
)
def test_a_place_where_no_folder_can_be_made_is_refused_before_the_work(
    orchard: Path, here: Path, words: str, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    places = {"REFERENCE": orchard / "reference", "SOURCE": orchard / "source", "TRUTH": orchard / "truth.json"}
    (here / "orchards.csv").write_text(f"orchard,reference,source\na,{places['REFERENCE']},{places['SOURCE']}\n")
    for work in ("io.reading.capture_of", "cli.simulate.simulated", "cli.apply.applications", "cli.evaluate.run_all"):
        monkeypatch.setattr(f"treereg_core.{work}", lambda *_, **__: pytest.fail("it is at work"))
    for name, place_of in places.items():
        words = words.replace(name, str(place_of))
    assert main([*words.split(), "-q"]) == 2
    assert "/proc/x" in (said := sentence(capsys.readouterr().err))
    assert "cannot be written" in said


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (40_000, ["run", "ORCHARD/reference", "ORCHARD/source", "--method", "icp", "--rasters", "none"]),
        (200_000, ["run", "ORCHARD/reference", "ORCHARD/source", "--method", "icp", "--no-report"]),
        (200_000, ["simulate"]),
        (20_000, ["misregister", "ORCHARD/source"]),
    ],
)
def test_a_disk_that_takes_no_more(orchard: Path, here: Path, size: int, words: list[str]) -> None:
    given = [word.replace("ORCHARD", str(orchard)) for word in words]
    place = [] if words == ["simulate"] else ["--out"]
    done = treereg(*given, *place, "out", "-q", before=LIMITED.format(size=size))
    assert done.returncode == 2, done.stderr
    said = [line for line in done.stderr.splitlines() if not line.startswith("_tiff")]
    assert "cannot be written" in sentence("\n".join(said))
    assert PREFIX not in said[0]
    assert list(here.iterdir()) == []


def test_an_old_result_outlives_a_full_disk(orchard: Path, here: Path) -> None:
    assert main(run_words(orchard, "--rasters", "none")) == 0
    before = tree(here)
    done = treereg(*run_words(orchard, "--rasters", "none"), before=LIMITED.format(size=40_000))
    assert done.returncode == 2
    assert tree(here) == before
    assert left_over(here) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize(
    ("stdout", "stderr", "code"),
    [("closed", "closed", 0), ("pipe", "closed", 0), ("full", "pipe", 1), ("pipe", "full", 0)],
)
def test_streams_that_are_closed_or_full(orchard: Path, here: Path, stdout: str, stderr: str, code: int) -> None:
    ways = {"closed": "&-", "full": "/dev/full"}
    redirected = [f"{n}>{ways[kind]}" for n, kind in ((1, stdout), (2, stderr)) if kind in ways]
    command = [sys.executable, "-c", MAIN, *run_words(orchard, "--rasters", "none")]
    shell = ["sh", "-c", f'exec "$@" {" ".join(redirected)}', "sh", *command]
    done = subprocess.run(shell, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert (here / "treereg-out" / "registration.json").exists()
    if stdout == "pipe":
        assert done.stdout.startswith("accepted")
    if stderr == "pipe":
        assert "cannot be printed" in sentence(done.stderr)


def test_a_folder_that_is_gone_and_a_link_to_nowhere(orchard: Path, here: Path, capsys: Output) -> None:
    (here / "link").symlink_to(here / "nowhere")
    assert main(run_words(orchard, "--out", "link")) == 2
    assert "is a link to a folder that is not there" in sentence(capsys.readouterr().err)
    (here / "gone").mkdir()
    os.chdir(here / "gone")
    (here / "gone").rmdir()
    assert main(run_words(orchard)) == 2
    assert "the current folder is no longer there" in sentence(capsys.readouterr().err)
