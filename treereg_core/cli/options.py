"""Options that several commands share."""

from __future__ import annotations

import os
from enum import Enum
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from treereg_core import io
from treereg_core.cli import completion
from treereg_core.cli.help import MATCHING, RASTERS
from treereg_core.errors import UsageError
from treereg_core.options import defaults
from treereg_core.transform import Model

DEFAULTS = defaults()
"""The methods and the start that are taken when none are named."""

Method = Annotated[
    str,
    typer.Option(
        metavar="EXPR",
        autocompletion=completion.expressions,
        rich_help_panel=MATCHING,
        help="Methods in running order, joined by +.",
    ),
]
Out = Annotated[Path, typer.Option(metavar="DIR", help="Where the results go.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the files of an earlier run, and no others.")]
StartName = Annotated[
    str,
    typer.Option(
        metavar="NAME|identity",
        autocompletion=completion.starts,
        rich_help_panel=MATCHING,
        help="A coarse aligner, or the files' own georeference.",
    ),
]
GeoreferenceSd = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        rich_help_panel=MATCHING,
        help="How far the files may be off, 1 sd per axis; default: unknown.",
    ),
]
ModelName = Annotated[
    str,
    typer.Option(
        metavar="rigid|similarity|affine",
        autocompletion=completion.one_of(*(model.value for model in Model)),
        rich_help_panel=MATCHING,
        help="The transform to fit.",
    ),
]
MaxFailure = Annotated[
    float,
    typer.Option(metavar="P", rich_help_panel=MATCHING, help="Accepted only at a failure probability of at most this."),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="STAGE.PARAMETER=VALUE",
        autocompletion=completion.settings,
        rich_help_panel=MATCHING,
        help="One setting; repeatable.",
    ),
]
Seed = Annotated[int, typer.Option(metavar="N", help="Everything random derives from it.")]
Threads = Annotated[int | None, typer.Option(metavar="N", help="At most this many; default: all processors.")]
Force = Annotated[bool, typer.Option("--force", help="Write the registered files whatever the verdict.")]
ConfidenceProperty = Annotated[str, typer.Option(metavar="NAME", help="The property that holds the confidence.")]
Rasters = Annotated[
    str,
    typer.Option(
        metavar="cog|lossless|none",
        autocompletion=completion.one_of("cog", "lossless", "none"),
        rich_help_panel=RASTERS,
        help="How the source's rasters are moved onto the reference's.",
    ),
]
ResamplingName = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        autocompletion=completion.one_of(*(way.value for way in io.Resampling)),
        rich_help_panel=RASTERS,
        help=f"How pixels are made of others: {', '.join(way.value for way in io.Resampling)}.",
    ),
]
ExtentName = Annotated[
    str,
    typer.Option(
        metavar="reference|source",
        autocompletion=completion.one_of(*(extent.value for extent in io.Extent)),
        rich_help_panel=RASTERS,
        help="How far moved rasters reach.",
    ),
]
WorldFile = Annotated[
    bool, typer.Option("--world-file", rich_help_panel=RASTERS, help="Write a world file beside each raster.")
]
GcpPoints = Annotated[
    bool,
    typer.Option(
        "--gcp-points", rich_help_panel=RASTERS, help="Write ground control points for QGIS beside each raster."
    ),
]

E = TypeVar("E", bound=Enum)


class RasterWay(Enum):
    """How rasters are moved: as cloud-optimised GeoTIFFs, by their georeference alone, or not at all."""

    COG = "cog"
    LOSSLESS = "lossless"
    NONE = "none"


def choice(text: str, kind: type[E], option: str) -> E:
    """The member of an enumeration with this value; `UsageError` names the option and what it may be."""
    try:
        return kind(text)
    except ValueError:
        known = " or ".join(str(member.value) for member in kind)
        raise UsageError(f"{option} is {text}, but must be {known}") from None


def raster_options(words: tuple[str, str, str], beside: tuple[bool, bool], threads: int) -> io.RasterOptions | None:
    """What `--rasters`, `--resampling` and `--extent`, `--world-file` and `--gcp-points` say; None for no rasters."""
    way = choice(words[0], RasterWay, "--rasters")
    method = choice(words[1], io.Resampling, "--resampling")
    reach = choice(words[2], io.Extent, "--extent")
    if way is RasterWay.NONE:
        return None
    return io.RasterOptions(way is RasterWay.LOSSLESS, method, reach, *beside, min(threads, os.cpu_count() or 1))
