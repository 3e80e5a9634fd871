"""Many independent calls over a few processes of one thread each, with progress on stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

T = TypeVar("T")


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[T]:
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
                if now - said > 5 or k == len(tasks):
                    left = (now - begin) / k * (len(tasks) - k)
                    print(f"{k} of {len(tasks)} trials, {left:.0f} s left", file=sys.stderr, flush=True)
                    said = now
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
