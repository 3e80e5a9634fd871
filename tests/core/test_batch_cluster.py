"""`treereg batch` on a Dask cluster: a real scheduler and real workers, some of which are killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil
import pytest

from tests.core.batches import (
    ERR,
    HANG,
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

GOOD = "good/source"
DASK = [sys.executable, "-m", "dask"]


@contextmanager
def running(command: list[str], env: dict[str, str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is ended with all that it started."""
    with log.open("wb") as file:
        process = subprocess.Popen([*DASK, *command], env=env, stdout=file, stderr=file, cwd=log.parent)
    family: list[psutil.Process] = []
    try:
        yield process
    finally:
        if process.poll() is None:
            family = psutil.Process(process.pid).children(recursive=True)
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for member in family:
            if member.is_running():
                member.kill()


class Cluster:
    """A scheduler on a free port, and two workers of one thread each."""

    def __init__(self, stack: ExitStack, env: dict[str, str], home: Path) -> None:
        self._stack, self._env, self._home = stack, env, home
        told = home / "scheduler.json"
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(told)]
        self.scheduler = stack.enter_context(running(["scheduler", *options], env, home / "scheduler.log"))
        until(lambda: told.exists() and told.read_text())
        self.address = str(json.loads(told.read_text())["address"])

    def add_worker(self, name: str) -> subprocess.Popen[bytes]:
        """The nanny of a new worker."""
        options = ["--nthreads", "1", "--no-dashboard", "--name", name]
        return self._stack.enter_context(
            running(["worker", self.address, *options], self._env, self._home / f"{name}.log")
        )


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return environment(tmp_path_factory.mktemp("installed"))


@pytest.fixture(scope="module")
def orchards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchards")
    make_orchards(folder)
    return folder


@pytest.fixture
def cluster(tmp_path: Path, env: dict[str, str]) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(stack, env, tmp_path)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def test_trouble_and_a_worker_killed_in_the_middle(
    cluster: Cluster, orchards: Path, env: dict[str, str], out: Path, tmp_path: Path
) -> None:
    for name in ("first", "second"):
        cluster.add_worker(name)
    manifest = write_manifest(orchards, [GOOD] * 3 + [str(LEAVE), str(HANG), str(ERR), "nowhere"] + [GOOD] * 5)
    diary = tmp_path / "diary"
    settings = ("--set", "troubled.pause=0.5", "--set", f"troubled.diary={diary}")
    started = batch(env, manifest, "--out", out, "--scheduler", cluster.address, "--time-limit", 10, *settings)
    until(lambda: done(out))
    # the process that registered is the child of a worker, which is the child of its nanny
    child = int(diary.read_text().split()[0])
    worker = psutil.Process(child).parent()
    assert worker is not None
    worker.kill()
    code, _, stderr = finish(started)
    assert code == 3, stderr
    assert list(verdicts(out).values()) == [
        *["accepted"] * 3,
        *("crashed", "timeout", "crashed", "unusable"),
        *["accepted"] * 5,
    ]
    assert "exit code 3" in rows(out)["o3"]["reason"]
    assert gone(child)


def test_a_scheduler_that_is_gone(cluster: Cluster, orchards: Path, env: dict[str, str], out: Path) -> None:
    cluster.add_worker("only")
    manifest = write_manifest(orchards, [GOOD] * 4)
    settings = ("--set", "troubled.pause=1")
    started = batch(env, manifest, "--out", out, "--scheduler", cluster.address, *settings)
    until(lambda: done(out))
    cluster.scheduler.kill()
    code, _, stderr = finish(started)
    assert code == 2
    assert "workers are gone" in stderr.splitlines()[-1]
    assert "waiting" in verdicts(out).values()
    code, _, stderr = finish(batch(env, manifest, "--out", out, *settings))
    assert code == 0
    assert "of 4 are done already" in stderr
    code, _, stderr = finish(batch(env, manifest, "--out", out, "--overwrite", "--scheduler", cluster.address))
    assert code == 2
    assert "no Dask scheduler answers" in stderr


def test_a_cluster_without_workers_or_with_others(
    cluster: Cluster, orchards: Path, env: dict[str, str], out: Path
) -> None:
    manifest = write_manifest(orchards, [GOOD])
    code, _, stderr = finish(batch(env, manifest, "--out", out, "--scheduler", cluster.address))
    assert code == 2
    assert "has no workers" in stderr
    cluster._env = {**os.environ, "PYTHONPATH": ""}
    cluster.add_worker("stranger")
    code, _, stderr = finish(batch(env, manifest, "--out", out, "--scheduler", cluster.address))
    assert code == 2
    assert "install the same" in stderr
    assert not (out / "summary.csv").exists()


def test_an_interruption_ends_the_work_on_the_cluster(
    cluster: Cluster, orchards: Path, env: dict[str, str], out: Path
) -> None:
    cluster.add_worker("only")
    manifest = write_manifest(orchards, [GOOD] * 30)
    arguments = (manifest, "--out", out, "--scheduler", cluster.address, "--set", "troubled.pause=0.5")
    started = batch(env, *arguments)
    until(lambda: len(done(out)) > 1)
    os.killpg(started.pid, signal.SIGINT)
    code, _, stderr = finish(started)
    assert code == 130
    assert "Traceback" not in stderr
    assert len(done(out)) < 8
    assert "waiting" in verdicts(out).values()
