"""Many independent calls over a few processes of one thread each."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Takes how many of how many calls have come to an end; first of all none of them."""


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int, progress: Progress) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish."""
    # Spawned processes import numpy afresh, so that it meets these settings.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(call, *task) for task in tasks]
        try:
            progress(0, len(tasks))
            for k, future in enumerate(as_completed(futures), 1):
                yield future.result()
                progress(k, len(tasks))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
