"""What a law is: a plain function of a method that raises `AssertionError` with its own name when it is broken."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from unittest import SkipTest

from treereg_core.method import Method

Law = Callable[[Any], None]
"""Takes a method of the role that the law is about; its name is the function's."""


class LawSkipped(SkipTest):
    """A law that cannot be tried on this method or in this environment, and why; pytest and unittest skip the test."""


@dataclass(frozen=True)
class LawResult:
    """How one law fared: `message` says what happened when it was broken or skipped."""

    name: str
    passed: bool
    message: str = ""
    skipped: bool = False


def law(function: Callable[[Any], None]) -> Law:
    """Make a law of a function: what it raises becomes an `AssertionError` that begins with the law's name.

    A warning of numpy's about numbers (a mean of nothing, a division by zero) breaks a law as well.
    """

    @functools.wraps(function)
    def named(method: Method) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                function(method)
        except LawSkipped:
            raise
        except AssertionError as broken:
            raise AssertionError(f"{function.__name__}: {broken}") from broken
        except Exception as error:
            raise AssertionError(f"{function.__name__}: {type(error).__name__}: {error}") from error

    return named


def require(condition: object, happened: str) -> None:
    """Raise `AssertionError` with what happened unless the condition holds, also under `python -O`."""
    if not condition:
        raise AssertionError(happened)
