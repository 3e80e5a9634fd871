"""The folder of a memory: read as if a stranger had sent it, written complete or not at all, by one run at a time."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from treereg_core.errors import InputError
from treereg_core.io.complete import complete_file
from treereg_core.io.files import check_writable, collector_paused, first_line, reason
from treereg_core.io.jsontext import readable
from treereg_core.io.lock import take_if_possible
from treereg_core.io.staging import settle_left

MEMORY = "memory.json"
LOCK = ".lock"
LARGEST_BYTES = 64 * 2**20
"""A larger file is neither read nor written; a tree of an orchard takes about a hundred bytes."""
DEEPEST = 32
"""Values nested more deeply are refused."""


def check_memory_folder(folder: Path) -> None:
    """Raise `InputError` unless the folder holds a memory, or is new or empty, and can be written to."""
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder} is a file, not a folder; give --memory a folder.")
        if folder.exists() and not (folder / MEMORY).exists():
            found = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith("."))
            if found:
                raise InputError(
                    f"{folder} holds {found[0]} but no {MEMORY}; give --memory the folder of a memory, or a new one."
                )
        check_writable(folder)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written ({reason(error)}), so nothing could be learned; give --memory another folder."
        ) from error


def read_memory(folder: Path) -> dict[str, Any] | None:
    """The document in a memory's folder, every number in it finite; None where there is none yet.

    Raises `InputError` for a file that is too large, cut off, nested too deeply or no JSON object.
    """
    path = folder / MEMORY
    if not path.exists():
        return None
    try:
        if not path.is_file():
            damaged(path, "it is not a file")
        with path.open("rb") as file:
            raw = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({reason(error)}); check its permissions.") from error
    if len(raw) > LARGEST_BYTES:
        damaged(path, f"it is larger than {LARGEST_BYTES // 2**20} MB")
    try:
        with collector_paused():
            document = json.loads(raw.decode("utf-8-sig"))
        check_value(document)
    except RecursionError:
        damaged(path, "it is nested too deeply")
    except ValueError as error:
        damaged(path, first_line(error))
    if not isinstance(document, dict):
        damaged(path, "it is not a JSON object")
    return document


def check_value(value: Any) -> None:
    """Raise `ValueError` for a number that is not finite as a float, or values nested more than `DEEPEST` deep."""
    level = [value]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner += item.values()
            elif isinstance(item, list):
                inner += item
            elif isinstance(item, float | int) and not abs(item) <= sys.float_info.max:
                raise ValueError("it holds a number that is not finite")
        level = inner
        if not level:
            return
    raise ValueError("it is nested too deeply")


def damaged(path: Path, how: str) -> NoReturn:
    """Refuse a memory's file, and say what a person can do about it."""
    raise InputError(f"{path} cannot be used as a memory: {how}; put back a copy of it, or begin a new folder.")


def write_memory(folder: Path, document: Mapping[str, Any], exports: Mapping[str, str]) -> None:
    """Write the document, then the files made of it for other programs, each complete or not at all.

    Raises `InputError` when they cannot be written, or the document is larger than would be read again.
    """
    text = encoded(readable(dict(document)) + "\n")
    if len(text) > LARGEST_BYTES:
        raise InputError(f"{folder / MEMORY} would become larger than {LARGEST_BYTES // 2**20} MB; begin a new folder.")
    for name, content in {MEMORY: text, **{name: encoded(content) for name, content in exports.items()}}.items():
        with complete_file(folder / name) as file:
            file.write(content)


def encoded(text: str) -> bytes:
    """UTF-8; half surrogates, as in odd names of folders, become escapes."""
    return text.encode(errors="backslashreplace")


@contextmanager
def memory_lock(folder: Path) -> Iterator[None]:
    """Hold a memory, made where there is none, while it is read and written again; another run waits.

    The lock goes with the process that holds it. Where the system has none, the last writer wins.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = take_if_possible(folder / LOCK, wait=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({reason(error)}); give --memory another folder.") from error
    assert lock is not None
    try:
        settle_left(folder)
        yield
    finally:
        os.close(lock)
