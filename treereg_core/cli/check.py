"""`treereg check`: the contract's laws on a method, an expression or a plugin file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import typer

from treereg_core.cli import completion
from treereg_core.cli.console import Verbose
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.errors import PluginError
from treereg_core.expression import parse
from treereg_core.method import Method
from treereg_core.pipeline import Pipeline
from treereg_core.recipe import Recipe
from treereg_core.registry import Registry, from_file, installed
from treereg_core.settings import record


def check(
    context: typer.Context,
    target: Annotated[
        str, typer.Argument(metavar="NAME|EXPR|FILE.py", autocompletion=completion.targets, help="What to check.")
    ],
    plugin: Plugin = None,
    verbose: Verbose = False,
) -> int:
    """Run the contract's laws on a method, an expression or every method of a plugin file, and print each."""
    use_plugins(context, plugin)
    chosen = list(targets(target, installed()))
    from treereg_core.testing import check as run_laws

    broken = skipped = 0
    for name, method in chosen:
        print(name)
        for law in run_laws(method):
            mark = "skipped" if law.skipped else "ok" if law.passed else "BROKEN"
            message = " ".join(law.message.split())
            print(f"  {mark:8}{law.name}{': ' + message if message else ''}", flush=True)
            broken += not law.passed and not law.skipped
            skipped += law.skipped
    untried = f" that could be tried ({skipped} skipped)" if skipped else ""
    print(f"laws broken: {broken}" if broken else f"every law{untried} holds")
    return 3 if broken else 0


def targets(target: str, registry: Registry) -> Iterator[tuple[str, Method]]:
    """What is to be checked, with its name: each with its default settings."""
    if target.endswith(".py"):
        entries = from_file(Path(target))
        if not entries:
            raise PluginError(f"{target} offers nothing to check; return your classes from its hooks")
        for entry in entries:
            if entry.problem:
                raise PluginError(entry.problem)
        for entry in entries:
            yield from named(entry.name, registry.under(entries))
    else:
        yield from named(target, registry)


def named(name: str, registry: Registry) -> Iterator[tuple[str, Method]]:
    """A single method as it is, anything else as the pipeline of its expression."""
    offer = None if "+" in name else registry.entry(name).offer
    if offer is not None and not isinstance(offer, Recipe):
        yield name, offer()
    else:
        expression = parse(name, registry)
        yield name, Pipeline.of([made(stage, expression.settings.get(stage.name, {})) for stage in expression.stages])


def made(stage: type[Method], values: Mapping[str, object]) -> Method:
    """A stage with the settings that a recipe gives it."""
    return record(stage, values, lambda field: f"{stage.name}.{field}")
