"""What a person sees: on a terminal of some width, on one without colours, and nowhere when it is piped."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from treereg_core.cli import main
from treereg_core.cli.columns import hanging, in_columns, labelled, with_text
from treereg_core.cli.console import coloured, console
from treereg_core.simulate import Scene, simulate, simulate_family, write_simulation

pty = pytest.importorskip("pty", reason="needs pseudo-terminals")
Output = pytest.CaptureFixture[str]
CODE = "import sys; from treereg_core.cli import main; sys.exit(main())"
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder, rasters=True)
    return folder


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES"):
        monkeypatch.delenv(name, raising=False)


def on_terminal(*words: str, columns: int = 80, interrupt_at: bytes = b"", **environment: str) -> tuple[int, str]:
    """The exit code of one command line, and everything that it writes on a terminal of so many columns.

    As soon as it has written `interrupt_at`, Ctrl-C is pressed: it and its processes get the signal.
    """
    import fcntl
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    running = subprocess.Popen(
        [sys.executable, "-c", CODE, *words],
        **dict.fromkeys(("stdin", "stdout", "stderr"), theirs),  # type: ignore[call-overload]
        env={**os.environ, "TERM": "xterm-256color", **environment},
        start_new_session=True,
    )
    os.close(theirs)
    written, waiting = b"", bool(interrupt_at)
    while True:
        try:
            some = os.read(ours, 65536)
        except OSError:  # so Linux says that nobody writes any more
            break
        if not some:
            break
        written += some
        if waiting and interrupt_at in written:
            os.killpg(running.pid, signal.SIGINT)
            waiting = False
    os.close(ours)
    return running.wait(timeout=60), written.decode()


@pytest.mark.parametrize(
    ("words", "moment"),
    [
        (("evaluate", "--family", "small_60", "--trials", "500", "--method", "icp", "--jobs", "2"), b"\x1b[?25l"),
        (("evaluate", "--family", "small_60", "--trials", "500", "--method", "icp", "--jobs", "2"), b"trials: 2"),
        (("run", "--out", "out"), b"paint reference"),
    ],
)
def test_control_c_ends_with_130_and_without_a_word(words: tuple[str, ...], moment: bytes) -> None:
    code, written = on_terminal(*words, interrupt_at=moment)
    assert code == 130
    assert "Traceback" not in written
    assert "Error" not in written
    assert "killed" not in written
    assert written.rindex("\x1b[?25h") > written.rindex("\x1b[?25l")
    assert [path.name for path in Path().rglob("*") if path.name not in ("treereg-out", "trials.csv")] == []


@pytest.mark.parametrize("signal_", [signal.SIGINT, signal.SIGTERM])
def test_rasters_that_are_being_written_are_gone_with_it(signal_: signal.Signals, orchard: Path) -> None:
    code = CODE.replace("import sys;", "import os, sys; from treereg_core.io import warping;").replace(
        "sys.exit",
        "whole = warping.Warp.into\n"
        "def into(self, path, progress):\n"
        f"    return whole(self, path, lambda share: os.kill(os.getpid(), {int(signal_)}))\n"
        "warping.Warp.into = into\n"
        "sys.exit",
    )
    done = subprocess.run([sys.executable, "-c", code, *run(orchard)], capture_output=True, check=False)
    assert done.returncode == 130
    assert b"Traceback" not in done.stderr
    assert list(Path().iterdir()) == []


def left_over(written: str) -> list[str]:
    """The lines that stay: each as it was written last."""
    lines = re.split(r"\r?\n", written)
    return [ESCAPES.sub("", re.split(r"\x1b\[2K|\r", line)[-1]) for line in lines]


def run(folder: Path, *more: str) -> tuple[str, ...]:
    return ("run", str(folder / "reference"), str(folder / "source"), "--method", "icp", "--out", "out", *more)


@pytest.mark.parametrize("columns", [80, 50])
def test_a_run_draws_a_bar_and_leaves_a_summary_that_fits(orchard: Path, columns: int) -> None:
    code, written = on_terminal(*run(orchard), columns=columns)
    assert code == 0
    assert "\x1b[?25l" in written  # the cursor is hidden while the bar is there, and shown again
    assert written.rindex("\x1b[?25h") > written.rindex("\x1b[?25l")
    assert re.search(r"visible .* \d+%", ESCAPES.sub("", written))
    lines = left_over(written)
    summary = lines[next(k for k, line in enumerate(lines) if line.startswith("accepted: ")) :]
    assert max(map(len, summary)) <= columns
    assert not any(line.startswith(("read", "judge", "visible")) for line in lines)
    assert any(line.endswith("out/detections_registered.geojson,") for line in summary)
    assert "\x1b[32m\x1b[1maccepted\x1b[0m" in written


def test_quiet_and_dumb_terminals_have_no_bar(orchard: Path) -> None:
    _, written = on_terminal(*run(orchard, "-q", "--rasters", "none"))
    assert "\x1b[?25l" not in written
    assert "judge" not in written
    _, written = on_terminal(*run(orchard, "--rasters", "none", "--overwrite"), TERM="dumb")
    assert "\x1b" not in written
    assert "judge\r\n" in written


def test_colours_are_off_when_asked_and_on_when_asked(orchard: Path) -> None:
    _, written = on_terminal(*run(orchard, "-q", "--rasters", "none"), NO_COLOR="1")
    assert "\x1b" not in written
    words = [sys.executable, "-c", CODE, *run(orchard, "-q", "--rasters", "none", "--overwrite")]
    for environment, colours in (({}, False), ({"FORCE_COLOR": "1"}, True), ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, 0)):
        done = subprocess.run(words, capture_output=True, env={**os.environ, **environment}, check=True)
        assert (b"\x1b[" in done.stdout) == bool(colours)
        assert done.stderr == b""


def test_a_piped_run_has_plain_lines_and_nothing_else(orchard: Path) -> None:
    done = subprocess.run([sys.executable, "-c", CODE, *run(orchard)], capture_output=True, text=True, check=True)
    assert "\x1b" not in done.stdout + done.stderr
    assert done.stderr.splitlines()[:2] == ["read", "start: coarse"]
    assert "%" not in done.stderr
    assert "  files  " in re.sub(" +", "  ", done.stdout)


def test_an_error_and_a_warning_end_the_bar(orchard: Path) -> None:
    code, written = on_terminal(*run(orchard, "--confidence-property", "score", "--rasters", "none"))
    assert code == 0
    lines = left_over(written)
    assert [line for line in lines if line.startswith("warning: ")]
    code, written = on_terminal(*run(orchard / "nowhere"))
    assert code == 2
    assert left_over(written)[-2].startswith("treereg: ")


def test_tables_fit_the_terminal_and_are_plain_when_piped(capsys: Output) -> None:
    for columns in (80, 60):
        code, written = on_terminal("methods", columns=columns)
        assert code == 0
        assert max(map(len, left_over(written))) <= columns
    assert main(["methods"]) == 0
    piped = capsys.readouterr().out.splitlines()
    assert len({line.index("treereg") for line in piped}) == 1


def test_evaluate_counts_trials_and_stacks_its_table() -> None:
    words = ("evaluate", "--family", "small_60", "--trials", "12", "--method", "icp", "--jobs", "1", "--out", "out")
    code, written = on_terminal(*words)
    assert code == 0
    assert re.search(r"trials: \d+ of 12 .*\d%.* left", ESCAPES.sub("", written))
    lines = left_over(written)
    assert max(map(len, lines)) <= 80
    assert sum(line.split()[:3] == ["method", "trials", "of"] for line in lines) > 1


@pytest.mark.parametrize(
    ("family", "verdict", "words"),
    [
        ("periodic_crops", "ambiguous", ["--georeference-sd METRES", "apply out/registration.json", "--rival 1"]),
        ("different", "failed", ["share a good part", "--start"]),
    ],
)
def test_a_result_that_is_not_accepted_says_what_next(
    family: str, verdict: str, words: list[str], capsys: Output
) -> None:
    write_simulation(simulate_family(family, 1), Path("pair"))
    assert main(list(run(Path("pair"), "-q"))) == 3
    stdout = capsys.readouterr().out
    assert stdout.startswith(f"{verdict}: ")
    (line,) = [line for line in stdout.splitlines() if line.startswith("  what next")]
    assert all(word in line for word in words)


def test_a_count_is_a_line_now_and_then_where_it_is_piped(capsys: Output) -> None:
    console.reset()
    for done in range(101):
        console.count("trials", done, 100)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["trials: 100 of 100, 0 s left"]


def test_columns_go_on_below_where_they_do_not_fit() -> None:
    rows = [["name", "one", "two"], ["a", "1.000", "2.000"]]
    assert in_columns(rows) == in_columns(rows, width=18) == ["name    one    two", "a     1.000  2.000"]
    assert in_columns(rows, width=17) == ["name    one", "a     1.000", "", "name    two", "a     2.000"]
    assert in_columns(rows, width=3) == in_columns(rows, width=17)


def test_texts_wrap_and_paths_do_not() -> None:
    assert with_text([["a", "some text"]]) == ["a  some text"]
    assert with_text([["a", "some " * 10]], 40)[1].startswith("   some")
    assert with_text([["name", "role", "some text of six words all"]], 20)[1:] == [
        "    some text of six",
        "    words all",
    ]
    assert labelled({"files": ["my folder/a", "my folder/b"]}, 24) == [
        "  files  my folder/a,",
        "         my folder/b",
    ]
    assert hanging("", "a  b", None) == ["a  b"]


def test_colours_follow_the_conventions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    assert coloured(sys.stdout)
    monkeypatch.setenv("TERM", "dumb")
    assert not coloured(sys.stdout)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert coloured(sys.stdout)
    monkeypatch.setenv("NO_COLOR", "1")
    assert not coloured(sys.stdout)


def test_a_name_moves_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    clear = "\x1b[2J\x9b2J\u202e"
    console.show(f"\x1b[32maccepted\x1b[0m\n  {clear}.json")
    console.verbose = True
    try:
        console.fail(ValueError(clear), clear)
    finally:
        console.reset()
    out, err = capsys.readouterr()
    assert out.startswith("\x1b[32maccepted\x1b[0m\n")
    for text in (out, err):
        assert "\\x1b[2J\\x9b2J\\u202e" in text
        assert not set("\x9b\u202e") & set(text)
        assert "\x1b[2J" not in text
