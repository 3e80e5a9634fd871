"""Many independent calls over a few processes of one thread each."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import Any, TypeVar

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Takes how many of how many calls have come to an end; first of all none of them."""


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int, progress: Progress) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish."""
    # Spawned processes import numpy afresh, so that it meets these settings.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    others = set(active_children())
    pool = ProcessPoolExecutor(
        jobs, get_context("spawn"), initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_IGN)
    )
    with pool:
        with _deaf():
            futures = [pool.submit(call, *task) for task in tasks]
        try:
            progress(0, len(tasks))
            for k, future in enumerate(as_completed(futures), 1):
                yield future.result()
                progress(k, len(tasks))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(active_children()) - others:
                process.terminate()
            raise


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started here do not hear Ctrl-C: who started them ends them, and no traceback is shown."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
