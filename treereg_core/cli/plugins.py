"""`--plugin FILE.py`: plugin files that a command uses as if they were installed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from treereg_core.cli.help import MATCHING
from treereg_core.errors import UsageError
from treereg_core.registry import FILES

Plugin = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        rich_help_panel=MATCHING,
        metavar="FILE.py",
        help="Use what this plugin file offers as if installed; repeatable.",
    ),
]


def use_plugins(context: typer.Context, files: Sequence[Path] | None) -> None:
    """Name the files in the environment until the command ends, so that the processes it starts use them too."""
    before = os.environ.get(FILES)

    def put_back() -> None:
        os.environ.pop(FILES, None)
        if before is not None:
            os.environ[FILES] = before

    for file in files or ():
        if os.pathsep in str(file):
            raise UsageError(f"--plugin {file}: a path with {os.pathsep!r} cannot be used; move the file elsewhere.")
    if files:
        context.call_on_close(put_back)
        os.environ[FILES] = os.pathsep.join([*map(str, files), *([before] if before else [])])
