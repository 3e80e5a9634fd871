"""`treereg batch` from the outside: what goes wrong with one orchard harms no other, and what is done stays done."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.core.batches import (
    ERR,
    HANG,
    HOARD,
    KILLED,
    LEAVE,
    batch,
    done,
    environment,
    finish,
    gone,
    make_orchards,
    rows,
    until,
    verdicts,
    write_manifest,
)
from treereg_core.batch import Order, Outcome
from treereg_core.batch.task import carry_out
from treereg_core.cli import main

GOOD = "good/source"
REPORT = {"report.html", "report-data.json"}
FILES = {"batch.json", "registration.json", "detections_registered.geojson", "tree_matches.geojson", *REPORT}


@pytest.fixture(scope="module")
def orchards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchards")
    make_orchards(folder)
    return folder


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return environment(tmp_path_factory.mktemp("installed"))


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def leftovers(out: Path) -> list[Path]:
    """What is half-written, and folders of orchards without a registration."""
    folders = [folder for folder in out.iterdir() if folder.is_dir() and not (folder / "registration.json").exists()]
    return [*out.rglob(".treereg-staging-*"), *out.rglob(".*-*.tmp"), *folders]


def test_no_trouble_of_one_orchard_harms_another(orchards: Path, env: dict[str, str], out: Path) -> None:
    trouble = [str(count) for count in (LEAVE, KILLED, HANG, HOARD, ERR)]
    manifest = write_manifest(orchards, [GOOD, *trouble, "nowhere", GOOD, GOOD])
    code, stdout, stderr = finish(
        batch(env, manifest, "--out", out, "--jobs", 2, "--time-limit", 10, "--memory-limit", 4)
    )
    assert code == 3, stderr
    assert list(verdicts(out).values()) == [
        *("accepted", "crashed", "crashed", "timeout", "memory", "crashed", "unusable"),
        *("accepted", "accepted"),
    ]
    said = rows(out)
    assert "exit code 3" in said["o1"]["reason"]
    assert "SIGKILL" in said["o2"]["reason"]
    assert "10 s" in said["o3"]["reason"]
    assert "KeyError" in said["o5"]["reason"]
    assert "there is no such folder" in said["o6"]["reason"]
    assert [said[f"o{k}"]["attempts"] for k in range(4)] == ["1", "2", "2", "1"]
    assert "Traceback" not in stderr
    assert "no result" not in stdout
    assert "9 orchards: 3 accepted" in stdout
    assert done(out) == {"o0", "o7", "o8"}
    assert {file.name for file in (out / "o0").iterdir()} == FILES
    assert leftovers(out) == []
    page = (out / "summary.html").read_text(encoding="utf-8")
    assert f"Made by treereg {version('treereg')}, treereg-troubled 0.1.0." in page
    looks = re.findall(r'<tr><td>(?:<a href="[^"]*">)?(o\d)', page.partition("<h2>All orchards")[0])
    assert looks[:6] == ["o1", "o2", "o5", "o4", "o3", "o6"]
    assert 'href="o0/report.html"' in page
    assert not re.search(r"src\s*=|url\(|<script|https?://", page)


def test_the_folder_of_an_orchard_is_what_run_writes(orchards: Path, tmp_path: Path) -> None:
    manifest = write_manifest(orchards, [GOOD])
    options = ["--method", "icp", "--set", "icp.reach=0.7", "--seed", "4", "--max-failure", "0.01", "-q"]
    assert main(["batch", str(manifest), *options, "--out", str(tmp_path / "many")]) == 0
    surveys = [str(orchards / "good" / name) for name in ("reference", "source")]
    assert main(["run", *surveys, *options, "--out", str(tmp_path / "one")]) == 0
    many, one = tmp_path / "many" / "o0", tmp_path / "one"
    assert {file.name for file in many.iterdir()} == {file.name for file in one.iterdir()} | {"batch.json"}
    for name in FILES - {"batch.json", "registration.json"} - REPORT:
        assert (many / name).read_bytes() == (one / name).read_bytes()
    registrations = [json.loads((folder / "registration.json").read_text()) for folder in (many, one)]
    assert [registration.pop("timings_s").keys() for registration in registrations]
    assert registrations[0] == registrations[1]


def test_what_was_done_while_it_was_interrupted_is_not_called_waiting(
    orchards: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(orders: list[Order], _: object) -> Iterator[Outcome]:
        yield carry_out(orders[0], 1)
        carry_out(orders[1], 1)
        raise KeyboardInterrupt

    monkeypatch.setattr("treereg_core.cli.batch.run_batch", interrupted)
    manifest = write_manifest(orchards, [GOOD] * 3)
    assert main(["batch", str(manifest), "--method", "icp", "--rasters", "none", "--out", str(out), "-q"]) == 130
    assert verdicts(out) == {"o0": "accepted", "o1": "accepted", "o2": "waiting"}


def test_interrupted_it_goes_on_where_it_was(orchards: Path, env: dict[str, str], out: Path) -> None:
    manifest = write_manifest(orchards, [GOOD] * 6)
    arguments = (manifest, "--out", out, "--jobs", 2, "--set", "troubled.pause=0.7")
    first = batch(env, *arguments)
    until(lambda: len(list(out.glob("*/batch.json"))) >= 2)
    os.killpg(first.pid, signal.SIGINT)
    code, _, stderr = finish(first)
    assert code == 130
    assert "Traceback" not in stderr
    said = verdicts(out)
    finished = [out / orchard / "registration.json" for orchard, verdict in said.items() if verdict == "accepted"]
    before = {path: path.stat().st_mtime_ns for path in finished}
    assert 1 <= len(before) < 6
    assert list(said.values()).count("waiting") == 6 - len(before)
    assert leftovers(out) == []
    code, _, stderr = finish(batch(env, *arguments))
    assert code == 0
    assert f"{len(before)} of 6 are done already" in stderr
    assert set(verdicts(out).values()) == {"accepted"}
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_a_change_of_options_or_files_is_done_again(
    orchards: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = write_manifest(orchards, [GOOD, "101/../good/source"])
    options = ["--method", "icp", "--start", "identity", "--out", str(out), "--jobs", "1"]

    def said(*more: str) -> str:
        assert main(["batch", str(manifest), *options, *more]) == 0
        return capsys.readouterr().err

    assert "are done already" not in said()
    assert "2 of 2 are done already" in said("--threads", "2", "--time-limit", "60")
    assert "are done already" not in said("--seed", "1")
    (out / "o1" / "tree_matches.geojson").unlink()
    assert "1 of 2 are done already" in said("--seed", "1")
    assert (out / "o1" / "tree_matches.geojson").exists()
    os.utime(orchards / GOOD / "raw-detections.geojson")
    assert "are done already" not in said("--seed", "1")
    assert "are done already" not in said("--seed", "1", "--overwrite")


def test_a_worker_that_is_killed_is_replaced(orchards: Path, env: dict[str, str], out: Path, tmp_path: Path) -> None:
    manifest, diary = write_manifest(orchards, [GOOD] * 4), tmp_path / "diary"
    settings = ("--set", "troubled.pause=1", "--set", f"troubled.diary={diary}")
    running = batch(env, manifest, "--out", out, "--jobs", 1, *settings)
    until(lambda: diary.exists() and len(diary.read_text().splitlines()) >= 2)
    os.kill(int(diary.read_text().split()[0]), signal.SIGKILL)
    assert finish(running)[0] == 0
    assert sorted(row["attempts"] for row in rows(out).values()) == ["1", "1", "1", "2"]
    assert len(set(diary.read_text().split())) == 2


def test_killed_itself_it_leaves_nothing_running(
    orchards: Path, env: dict[str, str], out: Path, tmp_path: Path
) -> None:
    manifest, diary = write_manifest(orchards, [GOOD, str(HANG)]), tmp_path / "diary"
    arguments = (manifest, "--out", out, "--jobs", 2, "--set", f"troubled.diary={diary}")
    running = batch(env, *arguments)
    until(lambda: done(out) and diary.exists() and len(diary.read_text().split()) == 2)
    running.kill()
    finish(running)
    until(lambda: all(gone(int(process)) for process in diary.read_text().split()))
    code, _, stderr = finish(batch(env, *arguments, "--time-limit", 3))
    assert code == 3
    assert "1 of 2 are done" in stderr
    assert leftovers(out) == []


def test_two_batches_in_one_folder(orchards: Path, env: dict[str, str], out: Path) -> None:
    manifest = write_manifest(orchards, [GOOD, str(HANG)])
    running = batch(env, manifest, "--out", out, "--jobs", 2)
    until(lambda: done(out))
    code, _, stderr = finish(batch(env, manifest, "--out", out))
    assert code == 2
    assert "another batch is at work" in stderr
    running.terminate()
    assert finish(running)[0] == 130
    assert verdicts(out) == {"o0": "accepted", "o1": "waiting"}


def test_what_cannot_be_done_is_refused(
    orchards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    manifest = str(write_manifest(orchards, [GOOD]))
    Path("full").mkdir()
    Path("full/thesis.txt").write_text("mine")
    for arguments, word in (
        (["nowhere.csv"], "nowhere.csv cannot be read"),
        ([manifest, "--start", "start.json"], "no start for several orchards"),
        ([manifest, "--jobs", "2", "--scheduler", "tcp://127.0.0.1:9"], "--jobs are processes here"),
        ([manifest, "--scheduler", "nonsense://"], "no Dask scheduler answers"),
        ([manifest, "--out", "full"], "full is in use, it holds thesis.txt"),
        ([manifest, "--out", str(orchards)], "input folder"),
        ([manifest, "--time-limit", "0"], "--time-limit"),
        ([manifest, "--set", "aco.ants=3"], "the stage 'aco' is not used here"),
        ([manifest, "--rasters", "some"], "--rasters"),
    ):
        assert main(["batch", *arguments, "--method", "icp"]) == 2, arguments
        assert word in capsys.readouterr().err.splitlines()[-1], arguments
    assert [path.name for path in Path("full").iterdir()] == ["thesis.txt"]
