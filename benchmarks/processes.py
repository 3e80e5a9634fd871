"""Many independent trials over a few processes, with progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from treereg_core import processes

T = TypeVar("T")


def told(text: str) -> None:
    """Progress on stderr."""
    print(f"trials: {text}", file=sys.stderr, flush=True)


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish."""
    return processes.spread(call, tasks, jobs, told)
