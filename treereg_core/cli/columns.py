"""Columns of text for people."""

from __future__ import annotations

from collections.abc import Sequence


def in_columns(rows: Sequence[Sequence[str]], flush_left: int = 1) -> list[str]:
    """Rows of equal length as lines: so many columns flush left, the others flush right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]

    def cell(text: str, width: int, column: int) -> str:
        return text.ljust(width) if column < flush_left else text.rjust(width)

    return [
        "  ".join(cell(text, width, k) for k, (text, width) in enumerate(zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]
