"""How many orchards a batch does in a second: on one core, on several, and on a Dask cluster of as many workers.

    python -m benchmarks.batch --orchards 1000 --rounds 5

Some orchards are simulated and done again and again under other names. Each round gives the same block of them to each
way in turn, all of whose processes stay, so that whatever else the machine does meanwhile burdens all alike. `against
one core` is the rate over that of one core times the number of cores: the median over the rounds, and the lowest and
the highest. `busy` is how much of the workers' time went into orchards, the rest being lost between them; it says
something on a machine that does other things too. Memory is that of this process, of which the queue is, and the sum of
those that work, after the first round and in the end.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from benchmarks.table import table
from treereg_core.batch import Limits, Order, Word, Work, Workers, cluster, local, run_batch
from treereg_core.options import Options, defaults
from treereg_core.plan import plan_for
from treereg_core.registry import installed
from treereg_core.simulate import Scene, simulate, write_simulation

LIMITS = Limits(600.0)
HEADER = ("way", "orchards", "accepted", "per second", "against one core", "busy", "own memory", "workers' memory")


@dataclass
class Way:
    """One way of doing a batch, and what was measured of it."""

    name: str
    cores: int
    workers: Workers
    orchards: int = 0
    accepted: int = 0
    rates: list[float] = field(default_factory=list)
    busy: list[float] = field(default_factory=list)
    memory_mb: list[tuple[float, float]] = field(default_factory=list)


def main() -> int:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        "benchmarks.batch", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--orchards", type=int, default=1000, metavar="N", help="in all rounds, each way; default 1000")
    add("--rounds", type=int, default=5, metavar="N", help="default 5")
    add("--distinct", type=int, default=20, metavar="N", help="simulated orchards; default 20")
    add("--trees", type=int, default=1500, metavar="N", help="default 1500")
    add("--jobs", type=int, default=2, metavar="N", help="cores; default 2")
    add("--method", default=defaults()["method"], metavar="EXPR", help="default: that of treereg run")
    arguments = parser.parse_args()
    with ExitStack() as stack:
        home = Path(stack.enter_context(TemporaryDirectory()))
        for k in range(arguments.distinct):
            write_simulation(simulate(Scene(trees=arguments.trees), k), home / f"orchard{k}", rasters=False)
        plan = plan_for(Options(method=arguments.method, threads=1), installed())
        work = Work(plan.options, plan.plugins)

        def orders(way: Way, numbers: range) -> list[Order]:
            surveys = [home / f"orchard{k % arguments.distinct}" for k in numbers]
            folders = [home / way.name.replace(" ", "-") / str(k) for k in numbers]
            return [
                Order(str(k), survey / "reference", survey / "source", folder, work)
                for k, survey, folder in zip(numbers, surveys, folders, strict=True)
            ]

        def way(name: str, cores: int, workers: AbstractContextManager[Workers]) -> Way:
            return Way(name, cores, stack.enter_context(workers))

        address = stack.enter_context(dask(arguments.jobs))
        ways = [
            way("one core", 1, local(1, LIMITS)),
            way(f"{arguments.jobs} cores", arguments.jobs, local(arguments.jobs, LIMITS)),
            way("dask", arguments.jobs, cluster(address, plan.plugins, home, LIMITS)),
        ]
        for one in ways:  # processes start, plugins are loaded
            list(run_batch(orders(one, range(-2 * one.cores, 0)), one.workers))
        block = arguments.orchards // arguments.rounds
        for k in range(arguments.rounds):
            for one in ways:
                measure(one, orders(one, range(k * block, (k + 1) * block)))
            print(f"round {k + 1} of {arguments.rounds}", file=sys.stderr, flush=True)
    print(table(HEADER, [row(one, ways[0]) for one in ways]))
    return 0


@contextmanager
def dask(workers: int) -> Iterator[str]:
    """The address of a Dask cluster of so many workers of one thread each."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        yield str(cluster.scheduler_address)


def measure(way: Way, orders: list[Order]) -> None:
    """Do a block of orchards one way."""
    before = {child.pid: child.cpu_times().user for child in descendants()}
    begin = time.perf_counter()
    found = list(run_batch(orders, way.workers))
    seconds = time.perf_counter() - begin
    way.rates.append(len(found) / seconds)
    way.busy.append(sum(outcome.seconds for outcome in found) / (way.cores * seconds))
    way.orchards += len(found)
    way.accepted += sum(outcome.verdict is Word.ACCEPTED for outcome in found)
    working = [child for child in descendants() if child.cpu_times().user > before.get(child.pid, 0.0) + 0.5]
    own = psutil.Process().memory_info().rss
    way.memory_mb.append((own / 1e6, sum(child.memory_info().rss for child in working) / 1e6))


def descendants() -> list[psutil.Process]:
    """All processes that this one started, and that they started."""
    return [child for child in psutil.Process().children(recursive=True) if child.is_running()]


def row(way: Way, one: Way) -> tuple[str, ...]:
    """A line of the table."""
    ratios = [rate / (way.cores * single) for rate, single in zip(way.rates, one.rates, strict=True)]
    own, workers = zip(way.memory_mb[0], way.memory_mb[-1], strict=True)
    return (
        way.name,
        str(way.orchards),
        str(way.accepted),
        f"{statistics.median(way.rates):.2f}",
        f"{statistics.median(ratios):.0%} ({min(ratios):.0%} to {max(ratios):.0%})",
        f"{statistics.median(way.busy):.0%}",
        f"{own[0]:.0f} to {own[1]:.0f} MB",
        f"{workers[0]:.0f} to {workers[1]:.0f} MB",
    )


if __name__ == "__main__":
    sys.exit(main())
