"""A staging folder: where files are made before they arrive together, and how what a killed process left is settled.

It lies in the folder that gets the files, or where that is new in the nearest one that there is:

- `lock`: held by the process that made the staging folder, so that nobody else writes to the same place.
- `new`: the files that are to arrive. Nobody else sees them before all are complete.
- `old`, later `gone`: the files of an earlier run that were put aside. They are `old` until the last of them is there,
  and `gone` from then on; so whoever finds them knows whether to put them back or to let the rest of the new arrive.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from pathlib import Path

from treereg_core.errors import UsageError
from treereg_core.io.files import nearest
from treereg_core.io.lock import NoLocks, take

PREFIX = ".treereg-staging-"
"""How the names begin of what is not complete yet; such files and folders may be removed when nothing runs."""
LOCK, NEW, OLD, GONE = "lock", "new", "old", "gone"
PATIENCE_S = 2.0
"""How long a process that was killed may take to let go, seconds."""


@contextmanager
def staging_folder(target: Path) -> Iterator[Path]:
    """A staging folder for an absolute path; what is left in it is removed at the end, unless old files are.

    Raises `UsageError` while another process has one for the same path, `OSError` when it cannot be made.
    """
    base = nearest(target)
    settle_left(base)
    place, lock = _held(base / f"{PREFIX}{_tag(target, base)}", target)
    try:
        (place / NEW).mkdir()
        yield place
    finally:
        if not any(any(files_below(place / name)) for name in (OLD, GONE)):
            shutil.rmtree(place, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _held(place: Path, target: Path) -> tuple[Path, int | None]:
    """The folder, which nobody else holds; where there are no locks, one of another name."""
    end = time.monotonic() + PATIENCE_S
    while True:
        place.mkdir(exist_ok=True)
        try:
            lock = take(place / LOCK)
            if lock is not None:
                _settle(place)
                return place, lock
        except FileNotFoundError:  # whoever had it has just removed it
            continue
        except NoLocks:
            shutil.rmtree(place, ignore_errors=True)
            return Path(tempfile.mkdtemp(prefix=PREFIX, dir=place.parent)), None
        if time.monotonic() > end:
            raise UsageError(f"another run is at work in {target}; wait until it is done, or choose another folder.")
        time.sleep(0.05)


def _tag(target: Path, base: Path) -> str:
    """The same for the same place, whatever way leads to it."""
    return blake2b(os.fsencode(target.relative_to(base)), digest_size=4).hexdigest()


def settle_left(folder: Path) -> None:
    """Settle what processes that were killed left half-done in a folder; what is being made there stays."""
    for left in folder.glob(f"{PREFIX}*"):
        with suppress(OSError):
            lock = take(left / LOCK if left.is_dir() else left)
            if lock is None:
                continue
            try:
                if left.is_dir():
                    _settle(left)
                    shutil.rmtree(left)
                else:
                    left.unlink()
            finally:
                os.close(lock)


def _settle(place: Path) -> None:
    """Bring an arrival that was broken off to an end: the folder has all its old files or all the new ones."""
    if (place / GONE).is_dir():
        move_all(place / NEW, place.parent)
    elif (place / OLD).is_dir():
        move_all(place / OLD, place.parent)
    for name in (NEW, OLD, GONE):
        if (place / name).is_dir():
            shutil.rmtree(place / name)


def move_all(folder: Path, target: Path) -> None:
    """Move every file below a folder to the same place below another."""
    for file in arriving(files_below(folder)):
        place = target / file.relative_to(folder)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(file, place)


def arriving(files: Iterable[Path]) -> list[Path]:
    """Files in the order in which they arrive: those that tell of the others come last."""
    return sorted(files, key=lambda file: (file.suffix == ".json", file))


def files_below(folder: Path) -> Iterator[Path]:
    """Every file below a folder, one by one; what is not complete yet does not count."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(PREFIX)]
        yield from (Path(place) / name for name in names if not name.startswith(PREFIX))
