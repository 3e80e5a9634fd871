"""Compiling functions once, and again when any of them has changed."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])
PACKAGE = Path(__file__).parent


def compiled(function: F) -> F:
    """The function, compiled by numba when it is first called and kept on disk for later runs."""
    # numba looks only at the file that a function stands in: a change to a function that it calls would go unnoticed
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder(before))
    try:
        return numba.njit(cache=True)(function)  # type: ignore[no-any-return]
    finally:
        numba.config.CACHE_DIR = before


@cache
def folder(given: str) -> Path:
    """Where compiled code is kept: a folder for these very sources, in the one given, beside them, or the user's own."""
    name = f"treereg-aco-{digest(PACKAGE)}"
    if given:
        return Path(given) / name
    beside = PACKAGE / "__pycache__"
    if os.access(beside if beside.exists() else PACKAGE, os.W_OK):
        return beside / name
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return (Path(home) if os.access(home, os.W_OK) else Path(tempfile.gettempdir())) / name


def digest(package: Path) -> str:
    """A short digest of all sources of a package."""
    sources = hashlib.blake2b(digest_size=6)
    for file in sorted(package.glob("*.py")):
        sources.update(file.read_bytes())
    return sources.hexdigest()
