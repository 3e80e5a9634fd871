"""Orchards, manifests and commands for the tests of batches, whose processes know the troubled plugin."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import psutil

from tests.outside.installed import install
from treereg_core.simulate import Scene, simulate, write_simulation

CLEAR = Scene(trees=150, jitter=0.1, area_persistence=0.9, shift=(0, 0), rotation=0)
TROUBLED = Path(__file__).parents[1] / "troubled"
LEAVE, KILLED, HANG, HOARD, ERR = range(101, 106)
"""Numbers of trees at which the troubled plugin does so."""
PATIENCE_S = 120.0


def environment(folder: Path) -> dict[str, str]:
    """An environment in which the troubled plugin is installed; its metadata goes into a folder."""
    install(TROUBLED, folder)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(TROUBLED), str(folder)])}


def make_orchards(folder: Path) -> None:
    """The surveys `good/reference` and `good/source`, and sources `101`, `102` ... of so many trees."""
    write_simulation(simulate(CLEAR, 0), folder / "good", rasters=False)
    document = json.loads((folder / "good" / "source" / "raw-detections.geojson").read_text())
    for count in (LEAVE, KILLED, HANG, HOARD, ERR):
        (folder / str(count)).mkdir()
        cut = {**document, "features": document["features"][:count]}
        (folder / str(count) / "raw-detections.geojson").write_text(json.dumps(cut))


def write_manifest(folder: Path, sources: Iterable[str]) -> Path:
    """A manifest of orchards `o0`, `o1` ... with these sources, beside the surveys."""
    lines = [f"o{k},good/reference,{source}" for k, source in enumerate(sources)]
    path = folder / "manifest.csv"
    path.write_text("\n".join(["orchard,reference,source", *lines]) + "\n")
    return path


def batch(env: dict[str, str], *arguments: object) -> subprocess.Popen[str]:
    """`treereg batch` with the troubled method, in a process group of its own, as in a terminal."""
    command = [sys.executable, "-c", "import sys; from treereg_core.cli import main; sys.exit(main())", "batch"]
    return subprocess.Popen(
        [*command, *map(str, arguments), "--method", "troubled", "--start", "identity"],
        env=env,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr."""
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


def until(condition: Callable[[], object]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it never came to hold"
        time.sleep(0.05)


def done(out: Path) -> set[str]:
    """The orchards that have a registration."""
    return {path.parent.name for path in out.glob("*/registration.json")}


def rows(out: Path) -> dict[str, dict[str, str]]:
    """The rows of summary.csv by orchard."""
    with (out / "summary.csv").open(newline="", encoding="utf-8") as file:
        return {row["orchard"]: row for row in csv.DictReader(file)}


def verdicts(out: Path) -> dict[str, str]:
    """The verdicts of summary.csv by orchard."""
    return {name: row["verdict"] for name, row in rows(out).items()}


def gone(process: int) -> bool:
    """Whether a process is no more, or only waits for somebody to ask how it ended."""
    try:
        return bool(psutil.Process(process).status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True
