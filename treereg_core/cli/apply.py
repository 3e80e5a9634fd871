"""`treereg apply`: any file of the source survey, moved by a transform that was found."""

from __future__ import annotations

import os
from glob import escape
from pathlib import Path
from typing import Annotated

import typer

from treereg_core import io
from treereg_core.application import applications
from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.cli.options import GcpPoints, ResamplingName, Threads, WorldFile, choice
from treereg_core.errors import UsageError
from treereg_core.io.files import nearest
from treereg_core.io.output import check_place


def apply(
    transform: Annotated[
        Path, typer.Argument(metavar="TRANSFORM.json", help="A registration.json, misregistration.json or truth.json.")
    ],
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Vector and raster files of the source.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the moved files go, under their own names.")],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files of the same names, and no others.")
    ] = False,
    rival: Annotated[
        int | None, typer.Option(metavar="N", help="Take another placement of the registration, counted from 1.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Take a registration that was not accepted.")] = False,
    lossless: Annotated[
        bool, typer.Option("--lossless", help="Rewrite only the georeference of rasters; no pixel changes.")
    ] = False,
    grid: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Move rasters onto the pixels of this raster.")
    ] = None,
    extent: Annotated[
        str | None,
        typer.Option(metavar="reference|source", help="With --grid, how far moved rasters reach; default: reference."),
    ] = None,
    resampling: ResamplingName = "auto",
    world_file: WorldFile = False,
    gcp_points: GcpPoints = False,
    threads: Threads = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Move FILEs by the transform in TRANSFORM.json: format, properties, CRS and names stay, positions change."""
    options = io.RasterOptions(
        lossless=lossless,
        resampling=choice(resampling, io.Resampling, "--resampling"),
        extent=choice(extent or ("reference" if grid else "source"), io.Extent, "--extent"),
        world_file=world_file,
        gcp_points=gcp_points,
        threads=thread_count(threads),
    )
    check_together(options, grid)
    inputs = [file.absolute().parent for file in (*files, *([grid] if grid else []))]
    check_place(out, inputs)
    motion = io.read_motion(transform, rival, force)
    before = io.stamps([*files, *([grid] if grid else [])])
    todo = applications(files, motion, grid, options, nearest(out))
    names = [name for one in todo for name in one.names]
    place = io.OutputFolder(out, inputs=inputs, overwrite=overwrite, names=map(escape, names))
    with place as folder, io.unchanged(before):
        for one in todo:
            for warning in one.warnings:
                console.warn(warning)
            console.progress(f"move {one.path}")
            for warning in one.write(folder, lambda share, name=one.path.name: console.share(name, share)):  # type: ignore[misc]
                console.warn(warning)
    if not console.quiet:
        moved = f"{len(todo)} {'file' if len(todo) == 1 else 'files'} moved"
        console.show("\n".join([moved, *(f"  {out / name}" for name in names)]))


def thread_count(asked: int | None) -> int:
    """At most as many as there are processors; `UsageError` for fewer than one."""
    most = os.cpu_count() or 1
    if asked is not None and asked < 1:
        raise UsageError(f"--threads is {asked}, but must be at least 1")
    return min(asked or most, most)


def check_together(options: io.RasterOptions, grid: Path | None) -> None:
    """Refuse options that exclude each other."""
    if options.lossless and (grid or options.resampling is not io.Resampling.AUTO):
        raise UsageError("--lossless keeps every pixel, so that --grid and --resampling mean nothing; leave them out")
    if options.extent is io.Extent.REFERENCE and not grid:
        raise UsageError("--extent reference needs the grid of a raster of the reference; give one with --grid")
