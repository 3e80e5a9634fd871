"""`--config FILE.toml`: long options at the top, a table per stage; the command line wins."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from treereg_core.cli.help import MATCHING
from treereg_core.errors import InputError, UsageError
from treereg_core.options import Options
from treereg_core.settings import merge, parse_assignments, read_config, suggestion

TABLES = "treereg.config.tables"
ONLY_ON_THE_COMMAND_LINE = frozenset({"config", "set", "plugin", "help"})


def _use(context: typer.Context, path: Path | None) -> Path | None:
    if path is None:
        return None
    options, context.meta[TABLES] = read_config(path)
    parameters = {
        option.removeprefix("--"): parameter.name
        for parameter in context.command.params
        for option in parameter.opts
        if option.startswith("--") and option.removeprefix("--") not in ONLY_ON_THE_COMMAND_LINE
    }
    given: dict[str, Any] = {}
    for name, value in options.items():
        if name not in parameters:
            raise InputError(f"{path}: there is no option {name!r}{suggestion(name, parameters)}")
        if isinstance(value, list):
            raise InputError(f"{path}: {name} is a list; give one value.")
        given[str(parameters[name])] = value
    context.default_map = {**(context.default_map or {}), **given}
    return path


Config = Annotated[
    Path | None,
    typer.Option(
        "--config",
        rich_help_panel=MATCHING,
        callback=_use,
        is_eager=True,
        metavar="FILE.toml",
        help="Options from a file: long options at the top, a table for each stage; the command line wins.",
    ),
]


def given(context: typer.Context) -> dict[str, object]:
    """What a command line and its configuration file say of a run's options, as `record` takes them."""
    values = {name: context.params.get(name) for name in Options.model_fields}
    settings = merge(tables(context), parse_assignments(context.params["set_"] or ()))
    return {**{name: value for name, value in values.items() if value is not None}, "settings": settings}


@contextmanager
def read_from(config: Path | None) -> Iterator[None]:
    """Have an error say that a configuration file had a word in it."""
    try:
        yield
    except UsageError as error:
        raise UsageError(f"{error} (options are read from {config} too)" if config else str(error)) from error


def tables(context: typer.Context) -> dict[str, dict[str, object]]:
    """The tables of the configuration file, by stage; none without a file."""
    found: dict[str, dict[str, object]] = context.meta.get(TABLES, {})
    return found
