"""The words of the command line: help, examples, completion, suggestions, and letters that a console does not know."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from treereg_core.cli import main
from treereg_core.cli.app import app
from treereg_core.cli.help import EXAMPLES
from treereg_core.simulate import Scene, Seasons, simulate_series, write_series

Output = pytest.CaptureFixture[str]
CODE = "import sys; from treereg_core.cli import main; sys.exit(main())"
COMMANDS = dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
LINES = sorted({example.replace("\\\n", "") for some in EXAMPLES.values() for example in some})
CLEAR = Scene(trees=150, jitter=0.1, area_persistence=0.9, shift_sd=3.0, rotation_sd=1.0)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def years(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three surveys of one orchard, and a registration of two, under the names that the examples use."""
    folder = tmp_path_factory.mktemp("years")
    for k, survey in enumerate(write_series(simulate_series(CLEAR, 3, Seasons(surveys=3)), folder / "made")):
        survey.rename(folder / str(2023 + k))
    arguments = ["run", str(folder / "2024"), str(folder / "2025"), "--out", str(folder / "registered"), "-q"]
    assert main(arguments) == 0
    return folder


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_fits_eighty_columns_and_ends_with_examples(
    command: str, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*([command] if command else []), "--help"]) == 0
    helped = capsys.readouterr().out
    assert max(map(len, helped.splitlines())) <= 80
    assert (
        "".join(f"  {line}\n" for line in "\n".join(EXAMPLES[command]).splitlines())
        == helped.partition("Examples:\n")[2]
    )
    assert "{" not in helped.splitlines()[0]


def test_the_options_of_a_run_stand_under_headings(capsys: Output) -> None:
    assert main(["run", "--help"]) == 0
    helped = capsys.readouterr().out
    places = [helped.index(word) for word in ("Matching:", "--georeference-sd", "Rasters:", "--gcp-points")]
    assert places == sorted(places)


@pytest.mark.parametrize("example", [line for line in LINES if "--family" not in line and "--trials" not in line])
def test_the_examples_work(example: str, years: Path, capsys: Output) -> None:
    for entry in years.iterdir():
        if entry.is_dir() and ("registered" in example.partition("--out")[0] or entry.name != "registered"):
            shutil.copytree(entry, entry.name)
    if "dem_10cm" in example:
        shutil.copyfile("2025/raw-detections.geojson", "2025/pipes.geojson")
        example = example.replace("dem_10cm.tif", "pipes.geojson")
    assert main(shlex.split(example)[1:]) in (0, 3), capsys.readouterr().err


@pytest.mark.parametrize("example", [line for line in LINES if "--family" in line or "--trials" in line])
def test_the_long_examples_are_understood(example: str) -> None:
    name, *words = shlex.split(example)[1:]
    context = COMMANDS[name].make_context(name, words)
    assert context.params


def completed(words: list[str], capsys: Output, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What bash is offered for the last word."""
    monkeypatch.setenv("COMP_WORDS", " ".join(["treereg", *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    monkeypatch.setenv("_TREEREG_COMPLETE", "complete_bash")
    with pytest.raises(SystemExit) as end:
        main([])
    assert end.value.code == 0
    stdout, stderr = capsys.readouterr()
    assert stderr == ""
    return stdout.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["ru"], {"run"}),
        (["run", "--geo"], {"--georeference-sd"}),
        (["run", "--method", "ic"], {"icp"}),
        (["run", "--method", "aco+ic"], {"aco+icp"}),
        (["run", "--start", "id"], {"identity"}),
        (["run", "--rasters", "l"], {"lossless"}),
        (["run", "--method", "confidence+icp", "--set", "confidence.s"], {"confidence.share="}),
        (["run", "--set", "judge."], {"judge.rivals="}),
        (["evaluate", "--method", "icp", "--start", "coarse", "--set", "icp.re"], {"icp.reach="}),
        (["evaluate", "--family", "fro"], {"frontier"}),
        (["simulate", "--family", "small_6"], {"small_60"}),
        (["rows", "--method", "ac"], {"aco"}),
        (["rows", "--method", "ic"], set()),
        (["methods", "tru"], {"truth"}),
        (["check", "icp+bn_r"], {"icp+bn_rows"}),
    ],
)
def test_words_are_completed(
    words: list[str], offered: set[str], capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert set(completed(words, capsys, monkeypatch)) == offered


def test_bash_completes_with_the_script_that_is_shown(tmp_path: Path) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("needs bash")
    program = tmp_path / "treereg"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{CODE}" "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    script = f"""
        eval "$({program} --show-completion bash)"
        COMP_WORDS=(treereg run --method confidence+ic) COMP_CWORD=3
        _treereg_completion {program}
        echo "${{COMPREPLY[@]}}"
    """
    environment = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run([bash, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "confidence+icp\n"


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_shells_get_a_script(shell: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE, "--show-completion", shell],
        env={**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"_TREEREG_COMPLETE=complete_{shell}" in done.stdout


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["rnu"], "No such command 'rnu'; did you mean 'run'?"),
        (["run", "--metod", "icp"], "No such option: --metod; did you mean '--method'?"),
        (["run", "a", "b", "--method", "icpp"], "method 'icpp': there is no method 'icpp'; the nearest right"),
        (["run", "a", "b", "--start", "coars"], "start 'coars': there is no method 'coars'; did you mean 'coarse'?"),
        (["run", "a", "b", "--set", "ipc.reach=1"], "ipc.reach: the stage 'ipc' is not used here; did you mean 'icp'?"),
        (["run", "a", "b", "--set", "icp.reech=1"], "there is no setting icp.reech; did you mean 'reach'?"),
        (["run", "a", "b", "--rasters", "cogg"], "--rasters is cogg, but must be cog or lossless or none."),
        (["evaluate", "--family", "smal_150"], "there is no family or group 'smal_150'; did you mean 'small_150'?"),
        (["methods", "iccp"], "there is no method 'iccp'; did you mean 'icp'?"),
    ],
)
def test_a_typing_error_gets_a_suggestion(words: list[str], sentence: str, capsys: Output) -> None:
    assert main(words) == 2
    stderr = capsys.readouterr().err
    assert stderr.startswith(f"treereg: {sentence}")
    assert len(stderr.splitlines()) == 1


def test_a_backslash_in_a_configuration_file_is_explained(capsys: Output) -> None:
    Path("options.toml").write_text('memory = "C:\\Users\\me"\n', encoding="utf-8")
    assert main(["run", "a", "b", "--config", "options.toml"]) == 2
    assert "a path with backslashes goes in 'single quotes'" in capsys.readouterr().err


@pytest.mark.parametrize("start", ["C:\\surveys\\start.json", "..\\start.json"])
def test_a_start_may_be_a_path_with_backslashes(start: str, years: Path, capsys: Output) -> None:
    arguments = ["run", str(years / "2024"), str(years / "2025"), "--start", start, "-q"]
    assert main(arguments) == 2
    assert f"start {start}: there is no such file" in capsys.readouterr().err
    place = start.replace("\\", "-").replace(":", "-") if os.name == "nt" else start
    shutil.copyfile(years / "registered" / "registration.json", place)
    arguments[arguments.index(start)] = place
    assert main(arguments) == 0


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_letters_that_a_console_does_not_know_are_replaced(encoding: str, years: Path) -> None:
    folder = Path("Öst Łąka 果樹園")
    shutil.copytree(years / "2024", folder / "2024")
    shutil.copytree(years / "2025", folder / "2025")
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "LC_ALL": "C.UTF-8"}
    words = ["run", str(folder / "2024"), str(folder / "2025"), "--out", str(folder / "out"), "--method", "icp"]
    done = subprocess.run([sys.executable, "-c", CODE, *words], env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode(encoding).startswith("accepted: ")
    assert (folder / "out" / "registration.json").read_bytes().decode("utf-8").count("果樹園") == 2
    assert b"\r" not in (folder / "out" / "registration.json").read_bytes()
    missing = subprocess.run(
        [sys.executable, "-c", CODE, "run", "Łąka", "x"], env=environment, capture_output=True, check=False
    )
    assert missing.returncode == 2
    assert missing.stderr.decode(encoding).startswith("read")
    assert "there is no such folder" in missing.stderr.decode(encoding)


def test_a_reader_that_leaves_is_no_error() -> None:
    running = subprocess.Popen(
        [sys.executable, "-c", CODE, "methods", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert running.stdout is not None
    assert running.stderr is not None
    running.stdout.close()
    assert running.stderr.read() == b""
    running.wait(timeout=60)
    running.stderr.close()
