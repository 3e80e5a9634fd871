"""How the time of every stage grows with the trees, and how much memory a run takes.

    python -m benchmarks.growth --method aco
    python -m benchmarks.growth --method combined --near
    python -m benchmarks.growth --files

An ordinary orchard turned any way, each size in a process of its own. Between the seconds stands the exponent of their
growth since the size before. `other` is what no stage counts, such as fits to trees along rows. `processor` is the time
that all threads together computed: where it is far less than the sum, the machine had other work. With --files it
counts the run between too. Memory is the peak of the process, with all that Python and the orchard itself take.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.speed import growth
from benchmarks.table import table
from treereg_core import io
from treereg_core.api import execute
from treereg_core.features import FeatureSet
from treereg_core.options import Options, defaults
from treereg_core.outputs import write_result
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import installed
from treereg_core.report import PAGE, write_report
from treereg_core.simulate import Scene, Simulation, simulate, write_simulation

SIZES = (10_000, 30_000, 100_000, 300_000, 1_000_000)
NEAR_M = (0.4, -0.3)
"""How far beside the truth a run with --near begins."""
FORMATS = (".gpkg", ".parquet")
"""In which surveys are read too, besides GeoJSON."""
LEAST_S = 0.02
"""Shorter times say nothing on growth."""


@dataclass(frozen=True)
class Measured:
    """Seconds by stage and of all threads, the peak memory of the process in bytes, and a remark on what came out."""

    seconds: Mapping[str, float]
    processor: float
    peak: int
    remark: str


def main() -> int:
    """Measure size by size and print the table, stage by stage."""
    parser = argparse.ArgumentParser(
        "benchmarks.growth", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--trees", type=int, nargs="+", default=SIZES, metavar="N", help=f"default: {' '.join(map(str, SIZES))}")
    add("--method", default=defaults()["method"], metavar="EXPR", help="default: that of treereg run")
    add("--threads", type=int, default=2, metavar="N", help="default 2")
    add("--repeats", type=int, default=1, metavar="N", help="runs, of which the fastest counts; default 1")
    add("--near", action="store_true", help="begin half a metre beside the truth, without a search")
    add("--files", action="store_true", help="reading, writing and the report, of a run with --near")
    arguments = parser.parse_args()
    near = arguments.near or arguments.files
    start = {"start": "identity"} if near else {}
    options = Options(method=arguments.method, threads=arguments.threads, **start)

    found: dict[int, Measured] = {}
    for trees in arguments.trees:
        print(f"{trees} trees", file=sys.stderr, flush=True)
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            task = files if arguments.files else stages
            found[trees] = process.submit(task, options, trees, arguments.repeats, near).result()
        print(table(*laid_out(found)), file=sys.stderr, flush=True)
    print(table(*laid_out(found)))
    return 0


def laid_out(found: Mapping[int, Measured]) -> tuple[list[str], list[list[str]]]:
    """Header and rows: a row for each stage, a column for each size, and the growth between."""
    header = ["stage"]
    for trees in found:
        header += [f"{trees:,}", ""] if trees != max(found) else [f"{trees:,}"]
    names = list(dict.fromkeys(name for measured in found.values() for name in measured.seconds))
    rows = [[name, *between({n: m.seconds.get(name, 0.0) for n, m in found.items()})] for name in names]
    rows.append(["sum", *between({n: sum(m.seconds.values()) for n, m in found.items()})])
    rows.append(["processor", *between({n: m.processor for n, m in found.items()})])
    for name, values in (
        ("memory", [f"{measured.peak / 1e9:.2f} GB" for measured in found.values()]),
        ("result", [measured.remark for measured in found.values()]),
    ):
        rows.append([name, *[cell for value in values for cell in (value, "")][:-1]])
    return header, rows


def between(seconds: Mapping[int, float]) -> list[str]:
    """The cells of one stage: seconds, with the exponent of growth between two that are long enough to tell."""
    cells: list[str] = []
    before: tuple[int, float] | None = None
    for trees, now in seconds.items():
        if before:
            cells.append(f"n^{growth(before, (trees, now)):.2f}" if min(before[1], now) >= LEAST_S else "")
        cells.append(f"{now:.2f} s")
        before = trees, now
    return cells


def orchard(trees: int, near: bool) -> tuple[Simulation, FeatureSet]:
    """An orchard, and its source, laid beside the truth if it is to be near."""
    simulation = simulate(Scene(trees=trees, rotation="any", shift_sd=15.0), seed=0)
    source = simulation.source
    if near and simulation.truth:
        source = source.replace(xy=simulation.truth(source.xy) + np.array(NEAR_M))
    return simulation, source


def stages(options: Options, trees: int, repeats: int, near: bool) -> Measured:
    """Start, stages and judge in this process; each run has trees of which nothing was computed before."""
    simulation, source = orchard(trees, near)
    plan = plan_for(options, installed())
    runs: list[tuple[dict[str, float], float, str]] = []
    for _ in range(repeats):
        clock = Clock()
        begin, busy = time.perf_counter(), time.process_time()
        result = execute(plan, (simulation.reference.replace(), source.replace()), clock)
        seconds = dict(clock.seconds)
        judge = seconds.pop("judge")
        other = time.perf_counter() - begin - judge - sum(seconds.values())
        busy = time.process_time() - busy
        runs.append((seconds | {"judge": judge, "other": other}, busy, result.judgement.verdict.value))
    seconds, busy, verdict = min(runs, key=lambda run: sum(run[0].values()))
    return Measured(seconds, busy, peak(), verdict)


def files(options: Options, trees: int, repeats: int, near: bool) -> Measured:
    """Reading in every format, writing and the report, without rasters."""
    simulation, source = orchard(trees, near)
    plan = plan_for(options, installed())
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_simulation(_laid(simulation, source), folder)
        runs: list[tuple[dict[str, float], float]] = []
        size = 0
        for _ in range(repeats):
            clock, busy = Clock(), time.process_time()
            with clock("read .geojson"):
                surveys = io.read_surveys(folder / "reference", folder / "source")
            result = execute(plan, surveys, Clock())
            out = folder / "out"
            out.mkdir(exist_ok=True)
            with clock("write"):
                write_result(result, out)
            with clock("report"):
                write_report(result, out)
            size = (out / PAGE).stat().st_size
            del surveys, result
            for suffix in FORMATS:
                copies = [_copied(folder / name, suffix) for name in ("reference", "source")]
                with clock(f"read {suffix}"):
                    io.read_surveys(*copies)
            runs.append((clock.seconds, time.process_time() - busy))
    seconds, busy = min(runs, key=lambda run: sum(run[0].values()))
    return Measured(seconds, busy, peak(), f"page {size / 1e6:.0f} MB")


def _laid(simulation: Simulation, source: FeatureSet) -> Simulation:
    """The simulation with its source where it begins."""
    return replace(simulation, source=source)


def _copied(folder: Path, suffix: str) -> Path:
    """The survey of a folder in another format, in a folder beside it."""
    import geopandas

    copy = folder.with_name(folder.name + suffix)
    path = copy / f"raw-detections{suffix}"
    if not path.exists():
        copy.mkdir()
        frame = geopandas.read_file(folder / "raw-detections.geojson")
        frame.to_parquet(path) if suffix == ".parquet" else frame.to_file(path)
    return copy


def peak() -> int:
    """The most memory that this process ever took, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    sys.exit(main())
