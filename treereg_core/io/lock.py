"""Locks between processes: a file that is held, and let go by the system when its process ends in whatever way."""

from __future__ import annotations

import errno
import os
from pathlib import Path


class NoLocks(OSError):  # noqa: N818 -- a property of the system, not a fault
    """The system, or the file system, has no locks."""


def take(path: Path, wait: bool = False) -> int | None:
    """Hold a file, made where there is none; gives its descriptor, to be closed, or None while another holds it.

    With `wait` it is waited for. Raises `NoLocks` where there are none, another `OSError` when the file cannot be made.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if not hold(descriptor, wait):
                os.close(descriptor)
                return None
        except BaseException:
            os.close(descriptor)
            raise
        if _is_at(descriptor, path):
            return descriptor
        os.close(descriptor)  # whoever held it has removed it


def take_if_possible(path: Path, wait: bool = False) -> int | None:
    """The same; where the system has no locks, everybody holds the file."""
    try:
        return take(path, wait)
    except NoLocks:
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o666)


def hold(descriptor: int, wait: bool = False) -> bool:
    """Hold an open file; gives whether it is, or another holds it. Raises `NoLocks` where there are none."""
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except (ImportError, OSError) as error:
        raise NoLocks(errno.ENOLCK, os.strerror(errno.ENOLCK)) from error
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False
