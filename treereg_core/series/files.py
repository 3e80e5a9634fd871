"""The files of a series: series.json, the trees, a page, and a folder for each survey with its registration."""

from __future__ import annotations

import glob
import json
from collections import Counter
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core import io
from treereg_core.errors import InputError
from treereg_core.io.output import RUN_NAMES
from treereg_core.outputs import write_result
from treereg_core.series.history import State
from treereg_core.series.page import PAGE, series_page
from treereg_core.series.registering import Member, Series
from treereg_core.series.table import table
from treereg_core.survey_rasters import raster_plan

SCHEMA = "treereg/series/1"
SERIES = "series.json"
PARQUET, GEOJSON = "trees.parquet", "trees.geojson"
MEMORY = "memory"
"""The folder of what each survey taught the next."""
FILES = (SERIES, PARQUET, GEOJSON)
RESERVED = (*FILES, PAGE, MEMORY)
"""Names that no survey's folder may have."""


def names_of_earlier(folder: Path) -> tuple[str, ...]:
    """The files that an earlier series left in a folder, as patterns: those that its series.json tells of."""
    try:
        document = json.loads((folder / SERIES).read_text(encoding="utf-8"))
        surveys = [str(survey["name"]) for survey in document["surveys"]] if document["schema"] == SCHEMA else []
        memory = [str(name) for name in document["memory"]] if surveys else []
    except (LookupError, OSError, RecursionError, TypeError, ValueError):
        surveys, memory = [], []
    inside = [(MEMORY, name) for name in memory] + [(survey, name) for survey in surveys for name in RUN_NAMES]
    plain = [pair for pair in inside if all(part and Path(part).name == part != ".." for part in pair)]
    return (*FILES, PAGE, *("/".join(map(glob.escape, pair)) for pair in plain))


def write_series(
    series: Series,
    folder: Path,
    rasters: io.RasterOptions | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
    report: bool = True,
) -> tuple[str, ...]:
    """Write everything into a folder that holds nothing but the memory; gives sentences for people.

    With `rasters` those of every accepted survey are moved onto the first survey's; one that cannot be moved is left
    out, and a sentence says why. `progress` is given what is being moved and how much of it is done. With `report`
    there is series.html too. Raises `InputError` when the folder cannot be written.
    """
    warnings: tuple[str, ...] = ()
    for member in series.members:
        if member.result is not None:
            (folder / member.name).mkdir()
            warnings += write_member(member, series.members[0], folder / member.name, rasters, progress)
    columns = table(series)
    io.write_tree_table(columns, series.frame.crs, folder / PARQUET)
    io.write_tree_points(columns, series.frame.crs, folder / GEOJSON)
    taught = sorted(file.name for file in (folder / MEMORY).glob("*")) if (folder / MEMORY).is_dir() else []
    document = series_json(series)
    io.write_json(folder / SERIES, {**document, "memory": taught})
    if report:
        io.write_text(folder / PAGE, series_page(series, document))
    return warnings


def write_member(
    member: Member,
    first: Member,
    folder: Path,
    rasters: io.RasterOptions | None,
    progress: Callable[[str, float], None],
) -> tuple[str, ...]:
    """Write the registration of one survey onto the first into an empty folder; gives sentences for people."""
    assert member.result is not None
    assert member.survey is not None
    assert first.survey is not None
    if rasters and member.result.accepted:
        try:
            plan = raster_plan((first.survey, member.survey), rasters, folder)
            written = write_result(
                member.result, folder, False, plan, lambda kind, share: progress(f"{member.name}: {kind}", share)
            )
            return tuple(f"{member.name}: {warning}" for warning in (*plan.warnings, *written.warnings))
        except InputError as error:
            for file in folder.iterdir():
                file.unlink()
            write_result(member.result, folder)
            return (f"{member.name}: its rasters are not moved: {error}",)
    return write_result(member.result, folder).warnings


def series_json(series: Series) -> dict[str, Any]:
    """The content of series.json: what came of each survey, plain values, every number finite."""
    counts = counted(series)
    plan = series.plan
    return {
        "schema": SCHEMA,
        "method": plan.options.method,
        "settings": plan.settings,
        "start": plan.options.start,
        "seed": plan.options.seed,
        "version": metadata.version("treereg"),
        "plugins": plan.plugins,
        "crs": series.frame.crs,
        "surveys": [member_json(member, counts.get(member.name)) for member in series.members],
        "trees": len(series.history.probability),
        "probable_trees": int(series.history.probable.sum()),
        "rows": series.places.rows,
    }


def member_json(member: Member, counts: dict[str, int] | None) -> dict[str, Any]:
    """One survey: its verdict, how far to trust it, and how many probable trees are in each state."""
    said = member.result.judgement if member.result else None
    return {
        "name": member.name,
        "path": str(member.folder),
        "verdict": member.word,
        "reason": said.reason if said else member.problem or "the survey that the others are registered onto",
        "expected_error_m": said.expected_error.rms if said and said.expected_error else None,
        "failure_probability": said.failure_probability if said else None,
        "states": counts,
    }


def counted(series: Series) -> dict[str, dict[str, int]]:
    """For each accepted survey how many probable trees are in each state; missing are those that stood there before."""
    history = series.history
    stood = np.cumsum(history.seen, axis=1) > 0
    found = {}
    for s, member in enumerate(series.accepted):
        states = history.state[history.probable & ((history.state[:, s] != State.MISSING) | stood[:, s]), s]
        count = Counter(states.tolist())
        found[member.name] = {state.word: count[state] for state in State}
    return found
