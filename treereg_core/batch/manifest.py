"""The manifest of a batch: a CSV file with the columns `orchard`, `reference` and `source`."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from treereg_core.errors import InputError
from treereg_core.io.files import first_line, reason

COLUMNS = ("orchard", "reference", "source")
SEPARATORS = ",;\t"
LONGEST_NAME = 100
RESERVED = ("summary.csv", "summary.html")
"""Names that files of a batch have."""


@dataclass(frozen=True)
class Row:
    """One orchard: its name, which its output folder has too, and its two survey folders, absolute."""

    orchard: str
    reference: Path
    source: Path


def read_manifest(path: Path) -> tuple[Row, ...]:
    """The orchards of a manifest, in its order; `InputError` names the line that is wrong.

    Paths are relative to the manifest. Separators may be commas, semicolons or tabs, as spreadsheets write them;
    further columns are left aside. Whether the survey folders exist is not asked.
    """
    lines = _lines(path, _text(path))
    number, header = next(lines, (1, []))
    columns = [name.strip() for name in header]
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise InputError(
            f"{path}, line {number}: there is no column {missing[0]!r}; the first line must name the columns "
            f"{', '.join(COLUMNS)}."
        )
    twice = next((name for name in COLUMNS if columns.count(name) > 1), None)
    if twice:
        raise InputError(f"{path}, line {number}: there are two columns {twice!r}; remove or rename one.")
    home, rows, taken = path.absolute().parent, [], dict[str, int]()
    for number, cells in lines:
        if len(cells) != len(columns):
            raise InputError(
                f"{path}, line {number} has {len(cells)} cells, where the first line has {len(columns)}; mend it."
            )
        orchard, *folders = (cells[columns.index(name)].strip() for name in COLUMNS)
        blank = next((name for name, cell in zip(COLUMNS, (orchard, *folders), strict=True) if not cell), None)
        if blank:
            raise InputError(f"{path}, line {number} has no {blank}; fill it in, or remove the line.")
        if any("\0" in folder for folder in folders):
            raise InputError(f"{path}, line {number} names a folder with a zero byte in it; mend it.")
        flaw = _flaw(orchard)
        if flaw:
            raise InputError(f"{path}, line {number}: the orchard {orchard!r:.120} {flaw}; rename it.")
        # folders of names that differ in case alone are one on some systems
        if orchard.casefold() in taken:
            raise InputError(
                f"{path}, line {number}: the orchard {orchard!r} is in line {taken[orchard.casefold()]} already; "
                "give each a name of its own."
            )
        taken[orchard.casefold()] = number
        rows.append(Row(orchard, *(Path(os.path.abspath(home / folder)) for folder in folders)))
    if not rows:
        raise InputError(f"{path} names no orchard; give it a line for each.")
    return tuple(rows)


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({reason(error)}); check the path of the manifest.") from error
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line} is not text in UTF-8; save it as CSV in UTF-8.") from error


def _lines(path: Path, text: str) -> Iterator[tuple[int, list[str]]]:
    """The lines that hold anything, with their numbers from 1."""
    first = text.partition("\n")[0]
    reader = csv.reader(text.splitlines(keepends=True), delimiter=max(SEPARATORS, key=first.count), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells):
                yield reader.line_num, cells
    except csv.Error as error:
        raise InputError(f"{path}, line {reader.line_num} is not CSV ({first_line(error)}); mend it.") from error


def _flaw(name: str) -> str | None:
    """Why a name cannot be that of a folder on every system; None when it can."""
    if not name.isprintable():
        return "has letters that cannot be shown"
    if set(name) & set('/\\:*?"<>|'):
        return "has one of / \\ : * ? \" < > |, which a folder's name cannot have"
    if name.startswith(".") or name.endswith("."):
        return "begins or ends with a dot"
    if name[0] in "=+-@":
        return f"begins with {name[0]}, which spreadsheets take for a formula and commands for an option"
    if len(name) > LONGEST_NAME:
        return f"is longer than {LONGEST_NAME} letters"
    if name.casefold() in RESERVED:
        return "has the name of a file of the results"
    return None
