"""Many independent trials over a few processes, with progress on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from treereg_core import processes
from treereg_core.cli.console import console

T = TypeVar("T")


def told(done: int, total: int) -> None:
    """Progress on stderr."""
    console.count("trials", done, total)


def spread(call: Callable[..., T], tasks: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[T]:
    """`call(*task)` for each task, in the order in which they finish."""
    return processes.spread(call, tasks, jobs, told)
