"""Commands killed at random moments: `python -m benchmarks.faults --kills 300`.

Every command first writes results of one pair of surveys, and is then begun again for another pair and killed after a
random part of the time that it takes, half of the times in the last third, when files are written. SIGKILL and SIGTERM
take turns. Then every file must be complete, and the folder as it was or as it was to become, whole; only after SIGKILL
in the instant of the arrival may files still be on their way, and then none of the old beside the new. The same command
once more must end well, with all its files and nothing left over. Each row of the table counts the kills by what was
found.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from benchmarks.table import table
from treereg_core.evaluation.log import read
from treereg_core.io.staging import PREFIX
from treereg_core.simulate import Scene, simulate, write_simulation

MAIN = "import sys; from treereg_core.cli import main; sys.exit(main())"
VERSIONS = ("former", "latter")
SCENE = Scene(trees=150, jitter=0.1, area_persistence=0.9, shift=(1, 0), rotation=0)
ICP = ("--method", "icp")
COMMANDS: dict[str, tuple[str, ...]] = {
    "run": ("run", "reference", "VERSION", *ICP, "--out", "OUT", "--overwrite"),
    "run, lossless": ("run", "reference", "VERSION", *ICP, "--rasters", "lossless", "--out", "OUT", "--overwrite"),
    "run, no rasters": ("run", "reference", "VERSION", *ICP, "--rasters", "none", "--out", "OUT", "--overwrite"),
    "apply": ("apply", "truth.json", *(f"VERSION/{name}" for name in ("raw-detections.geojson", "dem_10cm.tif"))),
    "misregister": ("misregister", "VERSION", "--out", "OUT", "--overwrite"),
    "series": ("series", "reference", "VERSION", *ICP, "--rasters", "none", "--out", "OUT", "--overwrite"),
    "batch": ("batch", "VERSION.csv", *ICP, "--rasters", "none", "--jobs", "1", "--out", "OUT"),
    "memory": ("run", "reference", "VERSION", "--method", "bn_landmarks+icp", "--memory", "OUT/memory", "--rasters"),
    "evaluate": ("evaluate", "reference", "latter", *ICP, "--trials", "3", "--jobs", "1", "--out", "OUT"),
}
MORE = {"apply": ("--out", "OUT", "--overwrite"), "memory": ("none", "--out", "OUT/run", "--overwrite")}
TIMED = ("registration.json", "report.html", "report-data.json", "series.json", "series.html")
"""Files that hold times, so that no two are the same; the name of the survey tells whose they are."""
Files = dict[str, bytes]


def main() -> int:
    """Kill the commands and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=90, help="of all commands together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", choices=COMMANDS, action="append")
    given = parser.parse_args()
    names = given.command or list(COMMANDS)
    rows = []
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        _prepare()
        for name in names:
            random, counts = Random(f"{name} {given.seed}"), Counter[str]()
            for _ in range(-(-given.kills // len(names))):
                counts[_killed(name, random)] += 1
            for word in counts - Counter(dict.fromkeys(WORDS, given.kills)):
                print(f"{name}: {word}", flush=True)
            told, every = [counts[word] for word in WORDS], counts.total()
            rows.append([name, *map(str, (*told, every - sum(told), every))])
    print(table(["command", *WORDS, "faults", "kills"], rows))
    return 1 if any(row[-2] != "0" for row in rows) else 0


WORDS = ("as it was", "as it was to become", "on its way", "too late")


def _prepare() -> None:
    """Two pairs of surveys that share the reference, and a manifest for each."""
    for seed, name in enumerate(VERSIONS):
        write_simulation(simulate(SCENE, seed), Path(f"made-{name}"), rasters=True)
        shutil.copytree(f"made-{name}/source", name)
        manifest = "".join(f"{orchard},reference,{name}\n" for orchard in "ab")
        Path(f"{name}.csv").write_text(f"orchard,reference,source\n{manifest}")
    shutil.copytree("made-former/reference", "reference")
    shutil.copy("made-former/truth.json", "truth.json")


def _words(name: str, version: str, out: Path) -> list[str]:
    parts = (*COMMANDS[name], *MORE.get(name, ()), "-q")
    return [part.replace("VERSION", version).replace("OUT", str(out)) for part in parts]


def _begin(words: Sequence[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )


def _whole(name: str, version: str, out: Path) -> float:
    """Carry the command out, and give how long it took, seconds."""
    begun = time.monotonic()
    process = _begin(_words(name, version, out))
    said = process.communicate()[1]
    assert process.returncode in (0, 3), said.decode()
    return time.monotonic() - begun


KNOWN: dict[str, tuple[dict[str, Files], float]] = {}


def _known(name: str) -> tuple[dict[str, Files], float]:
    """What the command writes for both versions, and how long it takes."""
    if name not in KNOWN:
        seconds, wholes = 0.0, {}
        for version in VERSIONS:
            out = Path(f"whole-{name}-{version}".replace(" ", ""))
            seconds = _whole(name, version, out)
            wholes[version] = _files(out)
        KNOWN[name] = wholes, seconds
    return KNOWN[name]


def _files(out: Path) -> Files:
    """All files with their final names."""
    found = (file for file in sorted(out.rglob("*")) if file.is_file() and PREFIX not in str(file))
    return {str(file.relative_to(out)): file.read_bytes() for file in found}


def _killed(name: str, random: Random) -> str:
    """Kill one, look, and carry it out again; gives what was found."""
    wholes, seconds = _known(name)
    out = Path("out")
    shutil.rmtree(out, ignore_errors=True)
    if name != "evaluate":  # that goes on with what is there
        _whole(name, VERSIONS[0], out)
    after = seconds * (random.uniform(0, 1) if random.random() < 0.5 else random.uniform(0.66, 1.05))
    with_what = random.choice((signal.SIGKILL, signal.SIGTERM))
    process = _begin(_words(name, VERSIONS[1], out))
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        process.send_signal(with_what)
    said = process.communicate()[1].decode()
    late = process.returncode in (0, 3)
    # before the command has begun it ends as any program does
    ended = process.returncode == -with_what or (process.returncode == 130 and with_what is signal.SIGTERM)
    if not (late or ended) or "Traceback" in said:
        return f"FAULT: exit code {process.returncode}: {said}"
    found = _found(name, out, wholes)
    if found.startswith("FAULT"):
        return f"{found} after {after:.2f} s of {seconds:.2f} by {with_what.name}"
    if with_what is signal.SIGTERM and not late and any(Path().rglob(f"{PREFIX}*")) and process.returncode == 130:
        return "FAULT: left over after SIGTERM"
    again = _begin(_words(name, VERSIONS[1], out))
    said = again.communicate()[1].decode()
    if again.returncode not in (0, 3):
        return f"FAULT: the next run ended with {again.returncode}: {said}"
    if (end := _found(name, out, wholes)) != WORDS[1]:
        return f"FAULT: after the next run it is {end}"
    left = list(Path().rglob(f"{PREFIX}*"))
    if left:
        return f"FAULT: left over after the next run: {left[0]}"
    return WORDS[3] if late else found


def _found(name: str, out: Path, wholes: dict[str, Files]) -> str:
    """Whether a folder is as it was, as it was to become, or on its way; else what is wrong with it."""
    now = _files(out)
    if name == "evaluate":
        return _found_trials(out)
    if name == "memory":
        json.loads(now.pop("memory/memory.json"))
        now = {file: content for file, content in now.items() if not file.startswith("memory/")}
        wholes = {v: {f: c for f, c in files.items() if not f.startswith("memory/")} for v, files in wholes.items()}
    if name == "batch":
        return _found_orchards(now, wholes)
    return _state(now, wholes)


def _state(now: Files, wholes: dict[str, Files]) -> str:
    for version, word in zip(VERSIONS, WORDS, strict=False):
        odd = [file for file, content in now.items() if not _is_of(file, content, version, wholes[version])]
        if not odd:
            return word if now.keys() == wholes[version].keys() else WORDS[2]
    return f"FAULT: a mixture, or a file that is not complete: {odd[0]}"


def _is_of(file: str, content: bytes, version: str, whole: Files) -> bool:
    if file not in whole:
        return False
    if Path(file).name not in (*TIMED, "batch.json"):
        return content == whole[file] or file.endswith(".parquet")
    if Path(file).name == "batch.json":  # it has no name, but the sizes of the files beside it
        return bool(json.loads(content))
    other = VERSIONS[1 - VERSIONS.index(version)]
    if file.endswith(".json"):
        json.loads(content)
    elif not content.rstrip().endswith(b"</html>"):
        return False
    return version.encode() in content and other.encode() not in content


def _found_orchards(now: Files, wholes: dict[str, Files]) -> str:
    """A batch is whole orchard by orchard; its summary tells of those that are done."""
    states = set()
    for orchard in "ab":
        parts = [
            {file.partition("/")[2]: content for file, content in files.items() if file.startswith(f"{orchard}/")}
            for files in (now, *(wholes[version] for version in VERSIONS))
        ]
        states.add(_state(parts[0], dict(zip(VERSIONS, parts[1:], strict=True))))
    wrong = [state for state in states if state.startswith("FAULT")]
    if wrong:
        return wrong[0]
    return states.pop() if len(states) == 1 else WORDS[2]


def _found_trials(out: Path) -> str:
    if not (out / "trials.csv").exists():
        return WORDS[2]
    content = (out / "trials.csv").read_bytes()
    (out / "copy.csv").write_bytes(content[: content.rfind(b"\n") + 1])
    try:
        count = len(read(out / "copy.csv")[1])
    finally:
        (out / "copy.csv").unlink()
    return WORDS[1] if count == 3 and (out / "evaluation.html").exists() else WORDS[2]


if __name__ == "__main__":
    sys.exit(main())
