"""Spoiled files for everything that reads one: `python -m benchmarks.fuzz --inputs 100000`.

Each input is made from its number alone, so that a crash is seen again with `--target NAME --first-seed N --inputs 1`.
An input that is refused with a sentence or used is well; anything else is a crash, and so are more than `--seconds`.
"""

from __future__ import annotations

import argparse
import faulthandler
import resource
import signal
import time
import traceback
import warnings
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from benchmarks.fuzz_targets import TARGETS, spoiled, tried
from benchmarks.table import table
from treereg_core.errors import TreeregError

SLOW = 50
"""A slow target gets so many times fewer inputs."""
MEMORY = 8 * 2**30
"""Bytes that an input may make the process take."""


class Hang(BaseException):
    """An input took too long."""


def outcome(name: str, content: bytes, folder: Path) -> str:
    """What came of one input: refused, accepted, or how it crashed."""
    try:
        tried(name, content, folder)
    except TreeregError as error:
        return "refused" if "\n" not in str(error) else f"more than a line: {error}"
    except (Exception, Hang):
        return traceback.format_exc()
    return "accepted"


def _timed(name: str, seed: int, folder: Path, seconds: int) -> str:
    """The outcome of the input of this number."""
    content = spoiled(name, Random(f"{name} {seed}"))
    signal.alarm(seconds)
    faulthandler.dump_traceback_later(10 * seconds, exit=True)
    try:
        return outcome(name, content, folder)
    finally:
        signal.alarm(0)
        faulthandler.cancel_dump_traceback_later()


def kind(crash: str) -> str:
    """Where it came from: crashes from one place are shown once."""
    places = [line for line in crash.splitlines() if line.lstrip().startswith("File ")]
    return "".join(places[-2:]) + crash.splitlines()[-1][:60]


def _stop(*_: object) -> None:
    raise Hang


def main() -> None:
    """Run the inputs and print a row for each target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000, help="of all targets together")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--target", choices=TARGETS, action="append")
    parser.add_argument("--seconds", type=int, default=10, help="that one input may take")
    given = parser.parse_args()
    names = given.target or list(TARGETS)
    signal.signal(signal.SIGALRM, _stop)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    rows, seen = [], set[str]()
    each = -(-given.inputs // len(names))
    with TemporaryDirectory() as folder:
        for name in names:
            begun, counts = time.monotonic(), {"refused": 0, "accepted": 0, "crashed": 0}
            count = -(-each // SLOW) if TARGETS[name].slow else each
            for seed in range(given.first_seed, given.first_seed + count):
                came = _timed(name, seed, Path(folder), given.seconds)
                counts[came if came in counts else "crashed"] += 1
                if came not in counts and kind(came) not in seen:
                    seen.add(kind(came))
                    print(f"{name}, seed {seed}:\n{came}", flush=True)
            rows.append([name, str(count), *map(str, counts.values()), f"{time.monotonic() - begun:.0f}"])
            print(f"{name}: {counts}", flush=True)
    print(f"\nseeds {given.first_seed} to {given.first_seed + each - 1}\n")
    print(table(["target", "inputs", "refused", "accepted", "crashes", "seconds"], rows))


if __name__ == "__main__":
    main()
