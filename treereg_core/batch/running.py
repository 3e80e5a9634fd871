"""Running a batch: a window of orchards over an executor, each in a process that may die or be ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice

from treereg_core.batch.order import Limits, Order
from treereg_core.batch.outcome import Outcome, Word
from treereg_core.batch.task import carry_out
from treereg_core.errors import InputError
from treereg_core.io.staging import settle_left
from treereg_core.processes import ProcessDied, Processes, TimeUp

ATTEMPTS = 2
"""How often an orchard whose process dies is begun: the cause may have been another one."""
AHEAD = 2
"""Orchards given to the executor for each that it can work on, so that no worker waits for the next."""
LOOK_S = 1.0
"""How often it is asked how many workers there are, seconds."""


@dataclass(frozen=True)
class Workers:
    """Who does the work: an executor, the function that it is given with an order, and how many run at a time."""

    executor: Executor
    function: Callable[[Order], Outcome]
    count: Callable[[], int]


def run_batch(orders: Iterable[Order], workers: Workers) -> Iterator[Outcome]:
    """The outcome of each order, in the order in which they finish. Only a window of the orders is under way.

    `InputError` when the executor loses its workers.
    """
    waiting, running = iter(orders), dict[Future[Outcome], Order]()
    while True:
        for order in islice(waiting, max(0, AHEAD * workers.count() - len(running))):
            running[workers.executor.submit(workers.function, order)] = order
        if not running:
            return
        for future in wait(running, LOOK_S, FIRST_COMPLETED).done:
            order = running.pop(future)
            if future.cancelled():
                raise InputError("the workers are gone; start them again, and then this, which goes on where it was.")
            error = future.exception()
            yield future.result() if error is None else lost(order, error)


def lost(order: Order, error: BaseException) -> Outcome:
    """The outcome of an order that the executor could not carry out."""
    text = " ".join(str(error).split()) or type(error).__name__
    return Outcome(order.orchard, Word.CRASHED, f"the worker did not do it ({text:.200}).", attempts=1)


@contextmanager
def local(jobs: int, limits: Limits) -> Iterator[Workers]:
    """Processes of this machine, so many at a time."""
    with Processes(limits.memory_bytes) as processes, ThreadPoolExecutor(jobs) as threads:
        try:
            yield Workers(threads, partial(guarded, processes, limits.seconds), lambda: jobs)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
            processes.close()


def guarded(processes: Processes, seconds: float | None, order: Order) -> Outcome:
    """Carry out an order in another process; its death, and a time that is up, are outcomes."""
    order.folder.mkdir(parents=True, exist_ok=True)  # what is half-written is in there, and found again
    try:
        return in_process(processes, seconds, order)
    finally:
        with suppress(OSError):  # it holds results
            order.folder.rmdir()


def in_process(processes: Processes, seconds: float | None, order: Order) -> Outcome:
    """The same in a folder that is there."""
    begin, word, attempt = time.monotonic(), Word.CRASHED, 0
    while attempt < ATTEMPTS and word is Word.CRASHED:
        attempt += 1
        try:
            return processes.call(carry_out, (order, attempt), seconds)
        except ProcessDied as death:
            reason = f"{death}."
        except TimeUp:
            word, reason = Word.TIMEOUT, f"it was not done after {seconds:g} s and was ended (--time-limit)."
        finally:
            settle_left(order.folder)
    return Outcome(order.orchard, word, reason, seconds=round(time.monotonic() - begin, 3), attempts=attempt)


def guarded_here(limits: Limits, order: Order) -> Outcome:
    """The same for a process that is a worker of others and has one set of processes for all that it is given."""
    return guarded(_processes_here(limits.memory_bytes), limits.seconds, order)


@cache
def _processes_here(memory_bytes: int | None) -> Processes:
    return Processes(memory_bytes)
