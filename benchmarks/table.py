"""Tables for people, and the two bounds that the benchmarks print."""

from __future__ import annotations

import math
from collections.abc import Sequence

Z95 = 1.959964


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Plain text: the first column flush left, the others flush right."""
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]
    lines = [
        "  ".join(
            cell.rjust(width) if k else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in (header, ["-" * width for width in widths], *rows)
    ]
    return "\n".join(line.rstrip() for line in lines)


def wilson(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    if not of:
        return 0.0, 1.0
    share, square = count / of, Z95**2 / of
    centre = (share + square / 2) / (1 + square)
    half = Z95 / (1 + square) * math.sqrt(share * (1 - share) / of + Z95**2 / (4 * of**2))
    return (max(centre - half, 0.0) if count else 0.0), (min(centre + half, 1.0) if count < of else 1.0)


def upper_bound(count: int, of: int) -> float:
    """The 95 % upper bound of a share: the rule of three when nothing was seen, else Wilson's."""
    if not of:
        return 1.0
    return min(3 / of, 1.0) if count == 0 else wilson(count, of)[1]


def percent(count: float, of: float) -> str:
    """A share for people; a dash where there is nothing to share."""
    return f"{100 * count / of:.1f} %" if of else "-"
