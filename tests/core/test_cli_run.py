"""`treereg run` from the outside: files, streams, exit codes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treereg_core import io, register
from treereg_core.cli import main
from treereg_core.errors import UsageError
from treereg_core.simulate import Scene, simulate, simulate_family, write_simulation

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=500, jitter=0.1, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)
KEYS = [
    *("schema", "method", "settings", "start", "seed", "version", "plugins", "reference", "source", "crs"),
    *("verdict", "reason", "transform", "matched", "residual_rms_m", "expected_error_m", "failure_probability"),
    *("rivals", "before", "timings_s"),
]


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder)
    return folder


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("other")
    write_simulation(simulate(CLEAR.model_copy(update={"same_orchard": False}), 4), folder)
    return folder


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def surveys(folder: Path) -> list[str]:
    return [str(folder / "reference"), str(folder / "source")]


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def read(path: Path) -> Any:
    return json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"{name} in {path}"))


def test_an_accepted_run_writes_everything_and_says_so(orchard: Path, capsys: Output) -> None:
    assert main(["run", *surveys(orchard)]) == 0
    assert names(Path()) == ["treereg-out"]
    assert names(Path("treereg-out")) == [
        *("detections_registered.geojson", "registration.json", "report-data.json", "report.html"),
        "tree_matches.geojson",
    ]
    stdout, stderr = capsys.readouterr()
    assert stdout.startswith("accepted: ")
    assert "expected error" in stdout
    assert "Traceback" not in stderr
    found = read(Path("treereg-out/registration.json"))
    assert list(found) == KEYS
    assert found["verdict"] == "accepted"
    assert set(found["settings"]) == {"coarse", "icp", "judge"}
    assert set(found["plugins"]) == {"coarse", "icp"}
    assert set(found["timings_s"]) == {"read", "start", "icp", "judge", "write"}
    assert found["crs"] == read(orchard / "truth.json")["crs"]
    assert found["reference"]["used"] <= found["reference"]["features"]
    assert len(read(Path("treereg-out/tree_matches.geojson"))["features"]) == found["matched"]


def test_the_matrix_is_the_truth_in_full_coordinates(orchard: Path) -> None:
    assert main(["run", *surveys(orchard), "-q"]) == 0
    found, truth = read(Path("treereg-out/registration.json"))["transform"], read(orchard / "truth.json")["transform"]
    centroid = np.array([*np.mean([tree["xy"] for tree in read(orchard / "truth.json")["trees"]], axis=0), 1.0])
    assert np.linalg.norm(np.array(found["matrix"]) @ centroid - np.array(truth["matrix"]) @ centroid) < 0.1
    assert found["rotation_deg"] == pytest.approx(truth["rotation_deg"], abs=0.05)
    assert found["translation_m"] == pytest.approx(truth["translation_m"], abs=0.1)
    assert "scale" not in found


def test_json_on_stdout_is_exactly_the_file_and_progress_is_on_stderr(orchard: Path, capsys: Output) -> None:
    assert main(["run", *surveys(orchard), "--json"]) == 0
    stdout, stderr = capsys.readouterr()
    assert stdout == Path("treereg-out/registration.json").read_text()
    assert "start: coarse" in stderr
    assert main(["run", *surveys(orchard), "--json", "-q"]) == 0
    assert capsys.readouterr().err == ""


def test_the_same_run_gives_the_same_bytes_at_any_number_of_threads(orchard: Path) -> None:
    for threads in ("1", "2"):
        assert main(["run", *surveys(orchard), "-q", "--threads", threads, "--out", threads]) == 0
    one, two = Path("1"), Path("2")
    for name in ("detections_registered.geojson", "tree_matches.geojson"):
        assert (one / name).read_bytes() == (two / name).read_bytes()
    timeless = [{**read(folder / "registration.json"), "timings_s": None} for folder in (one, two)]
    assert json.dumps(timeless[0]) == json.dumps(timeless[1])


def test_a_different_orchard_is_not_accepted_and_force_writes_all_the_same(other: Path, capsys: Output) -> None:
    assert main(["run", *surveys(other), "-q"]) == 3
    assert names(Path("treereg-out")) == ["registration.json", "report-data.json", "report.html"]
    found = read(Path("treereg-out/registration.json"))
    assert found["verdict"] in ("failed", "ambiguous")
    if found["verdict"] == "failed":
        assert (found["transform"], found["residual_rms_m"], found["expected_error_m"]) == (None, None, None)
        assert (found["matched"], found["failure_probability"]) == (0, 1)
    assert main(["run", *surveys(other), "-q", "--force"]) == 3
    assert ("tree_matches.geojson" in names(Path("treereg-out"))) == (found["transform"] is not None)


def test_max_failure_is_what_acceptance_is_measured_by(orchard: Path) -> None:
    assert main(["run", *surveys(orchard), "-q", "--max-failure", "0"]) in (0, 3)
    found = read(Path("treereg-out/registration.json"))
    assert (found["verdict"] == "accepted") == (found["failure_probability"] == 0)


def test_without_folders_it_makes_a_demonstration_and_prints_the_true_error(capsys: Output) -> None:
    assert main(["run", "-q"]) == 0
    assert names(Path("treereg-out/demonstration")) == ["reference", "source", "truth.json"]
    stdout = capsys.readouterr().out
    (line,) = [line for line in stdout.splitlines() if "true error" in line]
    assert float(line.split()[2]) < 0.1
    paths = [read(Path("treereg-out/registration.json"))[side]["path"] for side in ("reference", "source")]
    assert all(Path(path).is_dir() for path in paths)
    assert {f"{kind}_registered.tif" for kind in ("visible", "dem")} <= set(names(Path("treereg-out")))
    assert main(["run", "-q", "--json", "--rasters", "none"]) == 0, "at the default place it needs no --overwrite"
    json.loads(capsys.readouterr().out)
    assert not list(Path("treereg-out").rglob("*.tif"))


def test_starts_from_a_file_and_from_the_identity(orchard: Path) -> None:
    truth = str(orchard / "truth.json")
    assert main(["run", *surveys(orchard), "-q", "--start", truth]) == 0
    found = read(Path("treereg-out/registration.json"))
    assert (found["start"], set(found["settings"])) == (truth, {"icp", "judge"})
    assert main(["run", *surveys(orchard), "-q", "--start", "treereg-out/registration.json", "--out", "again"]) == 0
    assert main(["run", *surveys(orchard), "-q", "--start", "identity", "--out", "plain"]) in (0, 3)
    assert read(Path("plain/registration.json"))["start"] == "identity"


@pytest.mark.parametrize("model", ["similarity", "affine"])
def test_other_models_have_a_scale(orchard: Path, model: str) -> None:
    assert main(["run", *surveys(orchard), "-q", "--model", model]) == 0
    transform = read(Path("treereg-out/registration.json"))["transform"]
    assert transform["model"] == model
    assert transform["scale"] == pytest.approx(1, abs=0.01)


def test_settings_from_a_file_and_the_command_line(orchard: Path) -> None:
    Path("run.toml").write_text(
        'method = "confidence+icp"\nseed = 7\nout = "here"\nquiet = true\n'
        "[icp]\nrounds = 30\nreach = 0.5\n[confidence]\nthreshold = 0.4\n"
    )
    assert main(["run", *surveys(orchard), "--config", "run.toml", "--seed", "8", "--set", "icp.rounds=40"]) == 0
    found = read(Path("here/registration.json"))
    assert (found["method"], found["seed"]) == ("confidence+icp", 8)
    assert (found["settings"]["icp"]["rounds"], found["settings"]["icp"]["reach"]) == (40, 0.5)
    assert found["settings"]["confidence"]["threshold"] == 0.4


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "only-one"], "give REFERENCE and SOURCE, or neither"),
        (["run", "no-a", "no-b"], "no-a: there is no such folder"),
        (["run", "--rasters", "jpeg"], "--rasters is jpeg, but must be cog or lossless or none"),
        (["run", "--resampling", "best"], "--resampling is best, but must be auto or nearest or bilinear"),
        (["run", "--extent", "all"], "--extent is all, but must be reference or source"),
        (["run", "--no-reports"], "No such option: --no-reports"),
        (["run", "--method", "ipc"], "there is no method 'ipc'; the nearest right expression is 'icp'."),
        (["run", "--method", "icp+confidence"], "nearest right expression is 'confidence+icp'"),
        (["run", "--start", "corse"], "there is no method 'corse'; did you mean 'coarse'?\n"),
        (["run", "--start", "icp"], "it is not a coarse aligner"),
        (["run", "--start", "absent.json"], "absent.json: there is no such file"),
        (["run", "--set", "icp.reach=-1"], "icp.reach is -1, but must be above 0"),
        (["run", "--set", "icp.rounds=true"], "icp.rounds is true, where no true or false is wanted"),
        (["run", "--set", "icp.reech=1"], "did you mean 'reach'"),
        (["run", "--set", "coarse.x=1", "--start", "identity"], "the stage 'coarse' is not used here"),
        (["run", "--set", "reach=1"], "write STAGE.PARAMETER=VALUE"),
        (["run", "--model", "round"], "must be rigid or similarity or affine"),
        (["run", "--threads", "0"], "--threads is 0, but must be at least 1"),
        (["run", "--max-failure", "3"], "--max-failure is 3.0, but must be"),
        (["run", "--georeference-sd", "nan"], "--georeference-sd is nan"),
        (["run", "--seed", "-1"], "--seed is -1"),
        (["run", "--seed", "x"], "--seed"),
        (["run", "--config", "absent.toml"], "absent.toml: No such file"),
        (["nonsense"], "No such command 'nonsense'"),
        (["Run"], "No such command 'Run'; did you mean 'run'?\n"),
    ],
)
def test_bad_usage_is_one_sentence_and_leaves_nothing(arguments: list[str], sentence: str, capsys: Output) -> None:
    assert main([*arguments, "-q"] if arguments[0] == "run" else arguments) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert names(Path()) == []


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("sed = 3", "bad.toml: there is no option 'sed'; did you mean 'seed'"),
        ('seed = "x"', "bad.toml: Invalid value for '--seed'"),
        ("seed = -1", "--seed is -1, but must be at least 0 (options are read from bad.toml too)"),
        ("seed = [1]", "bad.toml: seed is a list"),
        ("[neither]\nx = 1", "the stage 'neither' is not used here"),
        ("seed = ", "bad.toml: not TOML"),
    ],
)
def test_a_bad_config_names_its_file(content: str, sentence: str, capsys: Output) -> None:
    Path("bad.toml").write_text(content)
    assert main(["run", "--config", "bad.toml"]) == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert "bad.toml" in stderr
    assert names(Path()) == ["bad.toml"]


def test_an_output_folder_in_use_needs_overwrite(orchard: Path, capsys: Output) -> None:
    Path("mine").mkdir()
    Path("mine/notes.txt").write_text("keep")
    assert main(["run", *surveys(orchard), "-q", "--out", "mine"]) == 2
    assert "notes.txt" in capsys.readouterr().err
    assert main(["run", *surveys(orchard), "-q", "--out", "mine", "--overwrite"]) == 0
    assert "notes.txt" in names(Path("mine"))
    assert main(["run", *surveys(orchard), "-q", "--out", str(orchard), "--overwrite"]) == 2


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (RuntimeError("lost\nit"), 1)])
def test_an_end_by_force_leaves_nothing(
    error: BaseException, code: int, orchard: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise error

    monkeypatch.setattr("treereg_core.outputs.io.write_matches", broken)
    assert main(["run", *surveys(orchard), "-q"]) == code
    stderr = capsys.readouterr().err
    assert "Traceback" not in stderr
    assert code == 130 or "RuntimeError: lost it" in stderr
    assert names(Path()) == []
    assert main(["run", *surveys(orchard), "-v"]) == code
    assert ("Traceback" in capsys.readouterr().err) == (code == 1)


def test_an_interrupt_from_the_keyboard_ends_with_130(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import sys; from treereg_core.cli import main; sys.exit(main())"]
    running = subprocess.Popen(
        [*command, "simulate", "big", "--trees", "2000000"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=tmp_path,
    )
    for _ in range(200):
        if names(tmp_path):
            break
        time.sleep(0.05)
    os.kill(running.pid, signal.SIGINT)
    _, stderr = running.communicate(timeout=60)
    assert running.returncode == 130
    assert b"Traceback" not in stderr
    assert names(tmp_path) == []


def test_register_gives_the_same_as_the_command(orchard: Path) -> None:
    assert main(["run", *surveys(orchard), "-q"]) == 0
    folders = surveys(orchard)
    from_folders = register(*folders)
    from_surveys = register(*io.read_surveys(Path(folders[0]), Path(folders[1])))
    expected = {**read(Path("treereg-out/registration.json")), "timings_s": None}
    for result in (from_folders, from_surveys):
        assert result.accepted
        assert {**json.loads(json.dumps(result.to_json())), "timings_s": None} == expected


def test_register_takes_plain_trees() -> None:
    made = simulate(CLEAR, 5)
    result = register(made.reference, made.source, method="icp", settings={"icp": {"rounds": 30}}, seed=2)
    assert result.transform is not None
    assert made.error(result.transform) < 0.1
    plain = result.to_json()
    assert plain["crs"] is None
    assert plain["settings"]["icp"]["rounds"] == 30
    json.dumps(plain, allow_nan=False)


def test_register_refuses_what_does_not_go_together(orchard: Path) -> None:
    made = simulate(CLEAR, 5)
    with pytest.raises(UsageError, match="give each survey as a folder"):
        register(made.reference, orchard / "source")
    with pytest.raises(UsageError, match="needs surveys that have a CRS"):
        register(made.reference, made.source, start=orchard / "truth.json")
    with pytest.raises(UsageError, match="threads is 0"):
        register(made.reference, made.source, threads=0)


def test_a_request_to_end_is_an_interruption(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import sys; from treereg_core.cli import main; sys.exit(main())"]
    running = subprocess.Popen([*command, "simulate", "big", "--trees", "2000000"], cwd=tmp_path)
    for _ in range(200):
        if names(tmp_path):
            break
        time.sleep(0.05)
    running.terminate()
    assert running.wait(timeout=60) == 130
    assert names(tmp_path) == []


def test_line_ends_and_escapes_in_a_name_stay_in_one_line(capsys: Output) -> None:
    assert main(["run", "a\nb\x1b[31m", "c", "-q"]) == 2
    assert (
        capsys.readouterr().err == "treereg: a\\nb\\x1b[31m: there is no such folder; check the path of the survey.\n"
    )


def test_names_that_are_no_text_or_unknown_to_the_terminal(orchard: Path, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"\xff\xc3\xb6")
    folder.symlink_to(orchard)
    code = "import sys; from treereg_core.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "run", *surveys(folder), "--out", str(folder) + "-out", "-q"]
    done = subprocess.run(command, env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"accepted" in done.stdout
    (found,) = tmp_path.glob("*-out/registration.json")
    assert read(found)["source"]["path"] == str(folder / "source")


def test_a_terminal_that_takes_nothing_is_no_fault_of_ours(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs a device that is always full")
    command = [sys.executable, "-c", "import sys; from treereg_core.cli import main; sys.exit(main(['methods']))"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 1
    assert b"No space left" in done.stderr
    assert b"report it" not in done.stderr


def test_the_demonstration_warns_of_files_where_they_will_lie(capsys: Output) -> None:
    assert main(["run", "-q", "--confidence-property", "score", "--set", "coarse.proposals=1"]) in (0, 3)
    warnings = capsys.readouterr().err.splitlines()
    assert warnings[0].startswith("warning: treereg-out/demonstration/reference/raw-detections.geojson: no feature")
    assert len(warnings) == 2


def test_more_threads_than_processors_are_no_more_than_processors(
    orchard: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr("treereg_core.api.starts", lambda *given: asked.append(given[-1].threads) or ())
    register(*surveys(orchard), threads=1_000_000_000)
    assert asked == [os.cpu_count()]


@pytest.mark.parametrize("family", ["periodic_crops", "periodic_turn"])
def test_a_lattice_from_files_is_ambiguous_against_itself(family: str) -> None:
    """The rounding of coordinates gives each crown an area of its own; it must not be taken for evidence."""
    write_simulation(simulate_family(family, 1), Path("lattice"))
    assert main(["run", "lattice/reference", "lattice/reference", "-q"]) == 3
    assert read(Path("treereg-out/registration.json"))["verdict"] == "ambiguous"
