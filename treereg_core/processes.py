"""Many independent calls over a few processes of one thread each."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

T = TypeVar("T")
Progress = Callable[[str], None]
"""Takes a short sentence on what is being done."""
EVERY_S = 5.0
"""How often progress is told, seconds."""


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int, progress: Progress) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish."""
    # Spawned processes import numpy afresh, so that it meets these settings.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    begin = said = time.monotonic()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(call, *task) for task in tasks]
        try:
            for k, future in enumerate(as_completed(futures), 1):
                yield future.result()
                now = time.monotonic()
                if now - said > EVERY_S or k == len(tasks):
                    left = (now - begin) / k * (len(tasks) - k)
                    progress(f"{k} of {len(tasks)}, {left:.0f} s left")
                    said = now
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
