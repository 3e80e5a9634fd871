"""The three hooks of a plugin; each returns what the plugin offers.

A plugin is a module with some of these functions, marked with `treereg_core.hookimpl`, and named by an entry point in
the group `treereg`::

    from treereg_core import hookimpl

    @hookimpl
    def treereg_methods():
        return [MyMatcher]
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from treereg_core.evaluator import Evaluator
    from treereg_core.method import Method
    from treereg_core.recipe import Recipe

GROUP = "treereg"
"""The entry-point group, and pluggy's project name."""

hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


@hookspec
def treereg_methods() -> Iterable[type[Method]]:  # type: ignore[empty-body]
    """The classes of methods that the plugin offers, one role each."""


@hookspec
def treereg_evaluators() -> Iterable[type[Evaluator]]:  # type: ignore[empty-body]
    """The classes of evaluators that the plugin offers."""


@hookspec
def treereg_recipes() -> Iterable[Recipe]:  # type: ignore[empty-body]
    """The recipes that the plugin offers."""
