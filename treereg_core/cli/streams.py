"""Standard streams that may be closed, full or no longer read."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class Unprinted(Exception):  # noqa: N818 -- a state of the system, not a fault
    """What was to be printed could not be written; the text is one sentence for a person."""


def open_all() -> None:
    """Give a closed standard stream the null device in its stead.

    Else the next file that is opened would get its number, and whatever is printed by a library would go into it.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the system gives the lowest number that is free
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")  # noqa: SIM115 -- as long as the process
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


@contextmanager
def printing() -> Iterator[None]:
    """Turns what a full disk makes of printing into `Unprinted`; a pipe that nobody reads is left to others."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        abandon_stdout()
        raise Unprinted(
            f"the result cannot be printed ({error.strerror}); free space where stdout goes, or send it elsewhere."
        ) from error


def abandon_stdout() -> None:
    """What is left to be printed goes nowhere, so that printing it at the end does not fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
