"""How long start, matching and judge take, and how much memory, over sizes of orchards.

    python -m benchmarks.speed --threads 2

An ordinary orchard turned any way, each size in a process of its own: one run to warm up (`first`), then three, of
which the fastest counts. `growth` is the exponent of the time since the size before; memory is the peak of the process.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

from benchmarks.table import table
from treereg_core.api import execute
from treereg_core.features import FeatureSet
from treereg_core.judgement import Judgement
from treereg_core.options import Options, defaults
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import installed
from treereg_core.simulate import Scene, simulate

SIZES = (1_500, 8_000, 30_000, 100_000)
REPEATS = 3
HEADER = ("trees", "start", "match", "judge", "sum", "growth", "first", "memory", "verdict", "true error")


@dataclass(frozen=True)
class Seconds:
    """The parts of one run; reading and writing are not among them."""

    start: float
    match: float
    judge: float

    @property
    def total(self) -> float:
        """All parts."""
        return self.start + self.match + self.judge


@dataclass(frozen=True)
class Measured:
    """The first run, the fastest one after it, the peak memory of the process in bytes, and what was found."""

    first: Seconds
    best: Seconds
    peak: int
    judgement: Judgement


def main() -> int:
    """Measure size by size and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.speed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--trees", type=int, nargs="+", default=SIZES, metavar="N", help=f"default: {' '.join(map(str, SIZES))}")
    add("--threads", type=int, default=2, metavar="N", help="default 2")
    add("--method", default=defaults()["method"], metavar="EXPR", help="default: that of treereg run")
    arguments = parser.parse_args()
    options = Options(method=arguments.method, threads=arguments.threads)

    rows: list[tuple[str, ...]] = []
    before: tuple[int, float] | None = None
    for trees in arguments.trees:
        print(f"{trees} trees", file=sys.stderr, flush=True)
        simulation = simulate(Scene(trees=trees, rotation="any", shift_sd=15.0), seed=0)
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            found = process.submit(measure, options, simulation.reference, simulation.source).result()
        transform = found.judgement.transform
        rows.append(
            (
                f"{trees:,}",
                *(f"{seconds:.2f} s" for seconds in (found.best.start, found.best.match, found.best.judge)),
                f"{found.best.total:.2f} s",
                f"n^{growth(before, (trees, found.best.total)):.2f}" if before else "",
                f"{found.first.total:.2f} s",
                f"{found.peak / 1e6:.0f} MB",
                found.judgement.verdict.value,
                "-" if transform is None else f"{simulation.error(transform):.3f} m",
            )
        )
        before = trees, found.best.total
    print(table(HEADER, rows))
    return 0


def measure(options: Options, reference: FeatureSet, source: FeatureSet) -> Measured:
    """Run several times in this process, each on trees of which nothing was computed before."""
    plan = plan_for(options, installed())
    runs: list[Seconds] = []
    for _ in range(1 + REPEATS):
        clock = Clock()
        result = execute(plan, (reference.replace(), source.replace()), clock)
        start, judge = clock.seconds["start"], clock.seconds["judge"]
        runs.append(Seconds(start, sum(clock.seconds.values()) - start - judge, judge))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Measured(runs[0], min(runs[1:], key=lambda run: run.total), peak, result.judgement)


def growth(before: tuple[int, float], now: tuple[int, float]) -> float:
    """The exponent k in seconds ~ trees^k between two measurements (trees, seconds)."""
    return math.log(now[1] / before[1]) / math.log(now[0] / before[0])


if __name__ == "__main__":
    sys.exit(main())
