"""Columns of text for people; `width` is that of the terminal, None where lines may be of any length."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from itertools import accumulate

GAP = 2
LEAST_TEXT = 34
"""Columns that a text beside others needs; with fewer it goes below them."""


def in_columns(rows: Sequence[Sequence[str]], flush_left: int = 1, width: int | None = None) -> list[str]:
    """Rows of equal length as lines: so many columns flush left, the others flush right.

    Where they are wider than `width`, the columns flush right go on below, beside those flush left again.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    fixed = sum(size + GAP for size in widths[:flush_left])
    ends = list(accumulate(size + GAP for size in widths[flush_left:]))
    left, right = list(range(flush_left)), list(range(flush_left, len(widths)))
    if width is None or not ends or fixed + ends[-1] - GAP <= width:
        return [_line(row, widths, [*left, *right], flush_left) for row in rows]
    fitting = max(1, sum(fixed + end - GAP <= width for end in ends))
    lines = [_line(row, widths, [*left, *right[:fitting]], flush_left) for row in rows]
    rest = [[*row[:flush_left], *row[flush_left + fitting :]] for row in rows]
    return lines if fitting == len(ends) else [*lines, "", *in_columns(rest, flush_left, width)]


def _line(row: Sequence[str], widths: Sequence[int], columns: Sequence[int], flush_left: int) -> str:
    cells = [row[k].ljust(widths[k]) if k < flush_left else row[k].rjust(widths[k]) for k in columns]
    return (" " * GAP).join(cells).rstrip()


def with_text(rows: Sequence[Sequence[str]], width: int | None = None) -> list[str]:
    """Rows of equal length as lines, flush left, the last column being a text that may need several lines."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    indent = sum(size + GAP for size in widths)
    lines = []
    for row in rows:
        head = "".join(cell.ljust(size + GAP) for cell, size in zip(row, widths, strict=False))
        if width is None:
            lines.append((head + row[-1]).rstrip())
        elif width - indent >= LEAST_TEXT:
            lines += hanging(head, row[-1], width)
        else:
            lines += [*hanging("", [(" " * GAP).join(row[:-1])], width), *hanging("    ", row[-1], width)]
    return lines


def labelled(rows: Mapping[str, str | Sequence[str]], width: int | None = None) -> list[str]:
    """A line for each name and what is to be said of it; of several texts none is broken, as paths must not be.

    Where one of those is too long they go below the name."""
    size = max(map(len, rows)) + GAP
    lines = []
    for name, text in rows.items():
        longest = 0 if isinstance(text, str) else max(map(len, text), default=0) + 1
        if width is not None and 2 + size + longest > width:
            lines += [f"  {name}", *hanging("    ", text, width)]
        else:
            lines += hanging(f"  {name.ljust(size)}", text, width)
    return lines


def hanging(head: str, text: str | Sequence[str], width: int | None) -> list[str]:
    """A text, or several with commas between, behind its head; further lines begin below its beginning."""
    whole = text if isinstance(text, str) else ", ".join(part.replace(" ", "\0") for part in text)
    lines = textwrap.wrap(
        whole,
        max((width or len(head) + len(whole) + 1), len(head) + 8),
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\0", " ") for line in lines] or [head.rstrip()]
