"""Compiling functions once, and again when any of them has changed."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TypeVar, cast

import numba
from numba.core import config

F = TypeVar("F", bound=Callable[..., object])
# What numba takes from the environment variable NUMBA_CACHE_DIR.
SETTING = "CACHE_DIR"
PACKAGE = Path(__file__).parent


def compiled(function: F) -> F:
    """The function, compiled by numba when it is first called and kept on disk for later runs.

    It runs beside other threads, so it must change nothing that they see.
    """
    # numba looks only at the file that a function stands in: a change to a function that it calls would go unnoticed
    before = getattr(config, SETTING)
    setattr(config, SETTING, str(folder(before)))
    try:
        return cast(F, numba.njit(cache=True, nogil=True)(function))
    finally:
        setattr(config, SETTING, before)


def is_compiled() -> bool:
    """Whether compiled code of these sources is kept from an earlier run."""
    return any(folder(getattr(config, SETTING)).rglob("*.nbc"))


@cache
def folder(given: str) -> Path:
    """Where compiled code is kept: for these very sources, in the folder given, beside them, or the user's own."""
    name = f"treereg-aco-{digest(PACKAGE)}"
    if given:
        return Path(given) / name
    beside = PACKAGE / "__pycache__"
    if os.access(beside if beside.exists() else PACKAGE, os.W_OK):
        return beside / name
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache")
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError:  # a folder that others can guess would let them put their code into it
        return Path(tempfile.mkdtemp(prefix=name))
    return home / name


def digest(package: Path) -> str:
    """A short digest of all sources of a package."""
    sources = hashlib.blake2b(digest_size=6)
    for file in sorted(package.glob("*.py")):
        sources.update(file.read_bytes())
    return sources.hexdigest()
