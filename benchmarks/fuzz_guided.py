"""Spoiled files led by coverage: `uv run --with atheris python -m benchmarks.fuzz_guided --seconds 60`.

The targets of `benchmarks.fuzz`. An input that reaches branches of treereg that none before it reached is kept in
`--corpus` and spoiled further, byte by byte by libFuzzer or as the target spoils it. The first is the target's valid
file. Inputs that crash are told once for each place, and lie in the corpus's folder `crashes`. libFuzzer is driven by
atheris (https://github.com/google/atheris), which has wheels for Linux alone.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import warnings
from hashlib import sha1
from importlib.util import find_spec
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from benchmarks.table import table

MEMORY_MB, LONGEST_S, LARGEST = 8192, 10, 1 << 18
BY_THE_TARGET = 0.5
"""Share of the inputs that the target's own spoiling makes."""


def _fuzz(name: str, seconds: int, corpus: Path) -> None:
    """Fuzz one target; ends the process."""
    import atheris

    with atheris.instrument_imports(include=["treereg_core"]):
        from benchmarks import fuzz, fuzz_targets
    warnings.simplefilter("error")
    counts, seen = dict.fromkeys(("refused", "accepted", "crashed"), 0), set[str]()
    crashes = corpus / "crashes"
    crashes.mkdir(exist_ok=True)

    def mutate(content: bytes, largest: int, seed: int) -> bytes:
        chance = Random(seed)
        if content and chance.random() < BY_THE_TARGET:
            try:
                changed = fuzz_targets.TARGETS[name].spoil(content, chance)
            except Exception:  # what is spoiled already can be beyond the target's own spoiling
                changed = b""
            if 0 < len(changed) <= largest:
                return changed
        return bytes(atheris.Mutate(content, largest))

    with TemporaryDirectory() as folder:

        def one(content: bytes) -> None:
            outcome = fuzz.outcome(name, content, Path(folder))
            counts[outcome if outcome in counts else "crashed"] += 1
            if outcome not in counts and fuzz.kind(outcome) not in seen:
                seen.add(fuzz.kind(outcome))
                kept = crashes / f"{name}-{sha1(content).hexdigest()[:12]}"
                kept.write_bytes(content)
                print(f"{kept}:\n{outcome}", flush=True)
            (corpus / f"{name}.counts").write_text(" ".join(map(str, counts.values())))

        fuzz.outcome(name, fuzz_targets.valid(name), Path(folder))  # what is slow once, such as imports
        flags = [f"-max_total_time={seconds}", f"-timeout={LONGEST_S}", f"-rss_limit_mb={MEMORY_MB}"]
        flags += [
            f"-max_len={LARGEST}",
            "-len_control=0",
            "-print_final_stats=1",
            f"-artifact_prefix={crashes}-{name}-",
        ]
        atheris.Setup([sys.argv[0], *flags, str(corpus / name)], one, custom_mutator=mutate)
        atheris.Fuzz()


def _row(name: str, seconds: int, corpus: Path) -> list[str]:
    """Fuzz one target in a process of its own, and the row of the table."""
    from benchmarks.fuzz_targets import valid

    known = corpus / name
    known.mkdir(parents=True, exist_ok=True)
    (known / "valid").write_bytes(valid(name))
    command = [sys.executable, "-m", "benchmarks.fuzz_guided", "--one", name, "--seconds", str(seconds)]
    with subprocess.Popen([*command, "--corpus", str(corpus)], stderr=subprocess.PIPE, text=True) as child:
        assert child.stderr
        told = child.stderr.read()
    if child.returncode:
        print(f"{name} ended with {child.returncode}:\n{told[-3000:]}", flush=True)
    covered = [int(found) for found in re.findall(r"cov: (\d+)", told)] or [0]
    counts = (corpus / f"{name}.counts").read_text().split()
    return [name, str(sum(map(int, counts))), *counts, str(covered[0]), str(covered[-1])]


def main() -> None:
    """Run the targets one after another and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--target", action="append", help="as `benchmarks.fuzz` names them; without it all")
    parser.add_argument("--corpus", type=Path, default=Path("fuzz-corpus"))
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if find_spec("atheris") is None:
        parser.error("atheris is not installed; give it for the time: uv run --with atheris python -m ...")
    if given.one:
        _fuzz(given.one, given.seconds, given.corpus)
    from benchmarks.fuzz_targets import TARGETS

    rows = []
    for name in given.target or TARGETS:
        rows.append(_row(name, given.seconds, given.corpus))
        print(*rows[-1], flush=True)
    print(table(["target", "inputs", "refused", "accepted", "crashes", "branches at first", "at last"], rows))


if __name__ == "__main__":
    main()
