"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from treereg_core.options import defaults

DEFAULTS = defaults()
"""The methods and the start that are taken when none are named."""

Method = Annotated[str, typer.Option(metavar="EXPR", help="Methods in running order, joined by +.")]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Where the results go.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the files of an earlier run, and no others.")]
GeoreferenceSd = Annotated[
    float | None, typer.Option(metavar="METRES", help="How far the files may be off, 1 sd per axis; default: unknown.")
]
ModelName = Annotated[str, typer.Option(metavar="rigid|similarity|affine", help="The transform to fit.")]
MaxFailure = Annotated[float, typer.Option(metavar="P", help="Accepted only at a failure probability of at most this.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="STAGE.PARAMETER=VALUE", help="One setting; repeatable.")
]
Seed = Annotated[int, typer.Option(help="Everything random derives from it.")]
Threads = Annotated[int | None, typer.Option(help="At most this many; default: all processors.")]
ConfidenceProperty = Annotated[str, typer.Option(metavar="NAME", help="The property that holds the confidence.")]
