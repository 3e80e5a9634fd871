"""Long arrays some at a time, since what is made of them meanwhile takes more memory than they do."""

from __future__ import annotations

from collections.abc import Iterator

PART = 20_000
"""So many are taken at a time."""


def parts(count: int) -> Iterator[slice]:
    """Slices that together take all of `count`, in order; one that takes none where there are none."""
    return (slice(start, min(start + PART, count)) for start in range(0, max(count, 1), PART))
