"""Files that must stay as they are while they are used: a part of one state and a part of another make nonsense."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from glob import escape
from pathlib import Path

from treereg_core.errors import InputError
from treereg_core.io.files import reason
from treereg_core.survey import Stamp

LOG, BY_THE_READER = "-wal", "-shm"
"""Endings of files beside a database: what others changed, and what whoever opens it makes; the log is made empty."""


def stamps(files: Iterable[Path]) -> dict[Path, Stamp]:
    """The stamps of files as they are now, and of those that belong to them by their names."""
    every = {one for file in files for one in (file, *file.parent.glob(f"{escape(file.stem)}.*"))}
    every |= {Path(f"{file}{LOG}") for file in every if file.suffix == ".gpkg"}
    return {file: stamp(file) for file in sorted(every) if not file.name.endswith(BY_THE_READER)}


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


def stamp(file: Path) -> Stamp:
    """Of one file, as it is now. `InputError` for one that cannot be looked at."""
    try:
        found = file.stat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({reason(error)}); check the path and its permissions.") from error
    return None if file.name.endswith(LOG) and not found.st_size else (found.st_size, found.st_mtime_ns)


def _check(before: Mapping[Path, Stamp]) -> None:
    for file, then in before.items():
        now = stamp(file)
        if now != then:
            what = "changed" if now else "removed"
            raise InputError(f"{file} was {what} while it was used, so that nothing is written; run it again.")
