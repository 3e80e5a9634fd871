"""Files that must stay as they are while they are used: a part of one state and a part of another make nonsense."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from glob import escape
from pathlib import Path

from treereg_core.errors import InputError
from treereg_core.io.files import find_files, reason

Stamp = tuple[int, int] | None
"""What changes when a file does: its size and time of change; None where there is no file."""
BY_THE_READER = ("-wal", "-shm")
"""Endings of files that whoever opens a database makes beside it."""


def stamps(files: Iterable[Path]) -> dict[Path, Stamp]:
    """The stamps of files as they are now, and of those that belong to them by their names."""
    every = {one for file in files for one in (file, *file.parent.glob(f"{escape(file.stem)}.*"))}
    return {file: _stamp(file) for file in sorted(every) if not file.name.endswith(BY_THE_READER)}


def survey_stamps(folders: Iterable[Path]) -> dict[Path, Stamp]:
    """The stamps of all files of survey folders; a folder that is none is left to those who read it."""
    files: list[Path] = []
    for folder in folders:
        try:
            found = find_files(folder)
        except InputError:
            continue
        files += [file for file in (found.detections, found.boundary, found.visible, found.dem) if file]
    return stamps(files)


@contextmanager
def unchanged(before: Mapping[Path, Stamp]) -> Iterator[None]:
    """Raise `InputError` when a file is not, at the end of the block, as it was when its stamp was taken.

    Where the block failed with another error, that one has its reason here.
    """
    try:
        yield
    except Exception:
        _check(before)
        raise
    _check(before)


def _stamp(file: Path) -> Stamp:
    try:
        found = file.stat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({reason(error)}); check the path and its permissions.") from error
    return found.st_size, found.st_mtime_ns


def _check(before: Mapping[Path, Stamp]) -> None:
    for file, stamp in before.items():
        now = _stamp(file)
        if now != stamp:
            what = "changed" if now else "removed"
            raise InputError(f"{file} was {what} while it was used, so that nothing is written; run it again.")
