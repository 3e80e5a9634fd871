"""`treereg report`: the page of a run, made again from its data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.report import write_page


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What a run wrote; it holds report-data.json.")],
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Make report.html in DIR again from report-data.json, as after an upgrade."""
    path = write_page(folder)
    if not console.quiet:
        console.show(str(path))
