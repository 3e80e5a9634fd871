"""`treereg batch`: register many orchards, whatever becomes of single ones."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Annotated

import typer

from treereg_core.batch import (
    PAGE,
    SUMMARY,
    BatchFolder,
    Limits,
    Order,
    Outcome,
    Word,
    Work,
    Workers,
    cluster,
    local,
    read_manifest,
    run_batch,
    write_summary,
)
from treereg_core.batch.attention import first_to_look_at
from treereg_core.batch.files import counted
from treereg_core.cli.config import Config, given
from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.cli.options import (
    DEFAULTS,
    ConfidenceProperty,
    ExtentName,
    Force,
    GcpPoints,
    GeoreferenceSd,
    MaxFailure,
    Method,
    ModelName,
    Out,
    Rasters,
    ResamplingName,
    Seed,
    Set,
    StartName,
    WorldFile,
    raster_options,
)
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.cli.run import settle
from treereg_core.errors import UsageError
from treereg_core.io.output import DEFAULT_OUT

SHOWN = 10
"""So many orchards to look at first are printed; the page has them all."""


def batch(
    context: typer.Context,
    manifest: Annotated[
        Path, typer.Argument(metavar="MANIFEST.csv", help="Columns orchard, reference and source; a line per orchard.")
    ],
    method: Method = DEFAULTS["method"],
    out: Out = DEFAULT_OUT,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Do all orchards again; without it an earlier batch goes on.")
    ] = False,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler whose workers do the work.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes here; default: all processors.")
    ] = None,
    time_limit: Annotated[
        float, typer.Option(min=1, metavar="SECONDS", help="An orchard that takes longer is given up.")
    ] = 3600.0,
    memory_limit: Annotated[
        float | None, typer.Option(min=0.5, metavar="GB", help="What one orchard may allocate; default: any.")
    ] = None,
    start: StartName = DEFAULTS["start"],
    georeference_sd: GeoreferenceSd = None,
    model: ModelName = "rigid",
    max_failure: MaxFailure = 0.001,
    set_: Set = None,
    config: Config = None,
    rasters: Rasters = "cog",
    resampling: ResamplingName = "auto",
    extent: ExtentName = "reference",
    world_file: WorldFile = False,
    gcp_points: GcpPoints = False,
    force: Force = False,
    seed: Seed = 0,
    threads: Annotated[int, typer.Option(min=1, metavar="N", help="At most this many for one orchard.")] = 1,
    confidence_property: ConfidenceProperty = "confidence",
    plugin: Plugin = None,
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> int:
    """Register each orchard of a manifest, in processes here or on a Dask cluster; what is done is not repeated."""
    use_plugins(context, plugin)
    if start.lower().endswith(".json"):
        raise UsageError(f"--start {start}: one transform is no start for several orchards; give a coarse aligner.")
    if scheduler and jobs:
        raise UsageError("--jobs are processes here, where --scheduler has workers of its own; leave one of them out.")
    plan = settle(given(context), config)
    moved = raster_options((rasters, resampling, extent), (world_file, gcp_points), plan.options.threads)
    work = Work(plan.options, plan.plugins, moved, confidence_property, force)
    rows = read_manifest(manifest)
    place = Path(os.path.abspath(out))
    orders = [Order(row.orchard, row.reference, row.source, place / row.orchard, work) for row in rows]
    limits = Limits(time_limit, None if memory_limit is None else int(memory_limit * 1e9))
    with BatchFolder(out, [folder for row in rows for folder in (row.reference, row.source)], overwrite):
        outcomes = {order.orchard: done for order in orders if not overwrite and (done := order.done)}
        left = [order for order in orders if order.orchard not in outcomes]
        if outcomes:
            console.note(f"batch: {len(outcomes)} of {len(orders)} are done already")
        workers: AbstractContextManager[Workers]
        if scheduler:
            workers = cluster(scheduler, plan.plugins, place, limits)
        else:
            workers = local(min(jobs or os.cpu_count() or 1, max(1, len(left))), limits)
        every: list[Outcome] = []

        def sum_up() -> None:
            every.extend(outcomes.get(order.orchard) or order.done or waiting(order) for order in orders)
            write_summary(orders, every, out)

        with ExitStack() as at_last, workers as found:
            at_last.callback(sum_up)  # when the workers have ended: some orchards may be done meanwhile
            for outcome in told(run_batch(left, found), len(left)):
                outcomes[outcome.orchard] = outcome
    console.show(summary(every, out))
    return 0 if all(outcome.verdict is Word.ACCEPTED for outcome in every) else 3


def told(outcomes: Iterator[Outcome], count: int) -> Iterator[Outcome]:
    """The same outcomes; of those without an accepted registration each is told of, and how far it is."""
    console.count("batch", 0, count)
    for k, outcome in enumerate(outcomes, 1):
        if outcome.verdict is not Word.ACCEPTED:
            console.note(f"{outcome.orchard}: {outcome.verdict.value}: {outcome.reason}")
        console.count("batch", k, count)
        yield outcome


def waiting(order: Order) -> Outcome:
    """The outcome of an order that was not carried out."""
    return Outcome(order.orchard, Word.WAITING, "the batch was interrupted before it was done.")


def summary(outcomes: Sequence[Outcome], out: Path) -> str:
    """How many of each verdict, what to look at first, and where the files are."""
    first = first_to_look_at(outcomes)
    lines = [
        counted(outcomes),
        *(f"  {outcome.orchard}  {outcome.verdict.value}: {why}" for outcome, why in first[:SHOWN]),
    ]
    if len(first) > SHOWN:
        lines.append(f"  and {len(first) - SHOWN} more")
    return "\n".join([*lines, f"  files  {out / SUMMARY}, {out / PAGE}"])
