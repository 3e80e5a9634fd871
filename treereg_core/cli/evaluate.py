"""`treereg evaluate`: how well methods register, on the same trials with known misplacements."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import typer

from treereg_core import io
from treereg_core.cli.columns import GAP, hanging, in_columns
from treereg_core.cli.completion import expressions, families_and_groups, starts
from treereg_core.cli.config import Config, given
from treereg_core.cli.console import Quiet, Verbose, console, width
from treereg_core.cli.options import (
    DEFAULTS,
    ConfidenceProperty,
    GeoreferenceSd,
    MaxFailure,
    ModelName,
    Out,
    Set,
)
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.cli.run import settle
from treereg_core.errors import UsageError
from treereg_core.evaluation import Families, Misregistered, Study, run_all
from treereg_core.evaluation.case import Source
from treereg_core.evaluation.files import FILES, evaluation_folder, write_evaluation
from treereg_core.evaluation.page import in_words, label, silent_in_words
from treereg_core.evaluation.summary import Line, not_in_place
from treereg_core.io.output import DEFAULT_OUT, check_place
from treereg_core.misregistration import ROTATION_SD_DEG, TRANSLATION_SD_M
from treereg_core.options import Options
from treereg_core.settings import Settings, check_used, suggestion
from treereg_core.simulate import FAMILIES
from treereg_core.simulate.families import GROUPS


def evaluate(
    context: typer.Context,
    surveys: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[REFERENCE [SOURCE]]",
            help="Survey folders that lie rightly on each other; one: it and itself; none: simulated families.",
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(metavar="EXPR", autocompletion=expressions, help="A method expression; repeatable."),
    ] = None,
    start: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME|identity", autocompletion=starts, help="A coarse aligner or identity; repeatable."),
    ] = None,
    trials: Annotated[int, typer.Option(min=1, metavar="N", help="Trials of each family, or of the surveys.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, metavar="N", help="The seed of the first trial; the next has the next.")
    ] = 0,
    family: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            autocompletion=families_and_groups,
            help="A family or group of simulated surveys; repeatable.",
        ),
    ] = None,
    rotation_sd: Annotated[
        float, typer.Option(min=0, metavar="DEGREES", help="How far surveys are turned on purpose, 1 sd.")
    ] = ROTATION_SD_DEG,
    translation_sd: Annotated[
        float, typer.Option(min=0, metavar="METRES", help="How far they are shifted, 1 sd per axis.")
    ] = TRANSLATION_SD_M,
    checkpoints: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Points found in both surveys, to be compared where they end."),
    ] = None,
    georeference_sd: GeoreferenceSd = None,
    model: ModelName = "rigid",
    max_failure: MaxFailure = 0.001,
    set_: Set = None,
    config: Config = None,
    plugin: Plugin = None,
    jobs: Annotated[int | None, typer.Option(min=1, metavar="N", help="Processes; default: all processors.")] = None,
    out: Out = DEFAULT_OUT,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Begin anew; without it an earlier evaluation goes on.")
    ] = False,
    confidence_property: ConfidenceProperty = "confidence",
    as_json: Annotated[bool, typer.Option("--json", help="Print evaluation.json instead of a summary.")] = False,
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Register the same trials, with known misplacements, by every method from every start, and compare."""
    use_plugins(context, plugin)
    names = method or [DEFAULTS["method"]], start or [DEFAULTS["start"]]
    setups = setups_of(given(context), names, config)
    folders = surveys or []
    check_place(out, folders)
    source: Source
    if folders:
        if family:
            raise UsageError("--family is of simulated surveys; leave it out, or the folders.")
        source, notes = of_surveys(folders, (rotation_sd, translation_sd), checkpoints, confidence_property)
    else:
        if checkpoints:
            raise UsageError("--checkpoints are of surveys; give their folders.")
        source = Families(families_of(family or GROUPS))
        notes = [f"Simulated surveys of {len(source.names)} families, {trials} pairs of surveys of each."]
    study = Study(source, setups, range(seed, seed + trials))
    with evaluation_folder(out, folders, overwrite) as log:
        count = partial(console.count, "trials")
        done = run_all(study, log, jobs or os.cpu_count() or 1, count)
        if folders and (doubt := not_in_place(done)):
            console.warn(doubt)
            notes.append(doubt)
        lines = write_evaluation(study, notes, done, log)
    if as_json:
        console.hand_over((out / FILES[1]).read_bytes())
    else:
        console.show(summary(notes, lines, out))


def setups_of(
    values: Mapping[str, Any], names: tuple[Sequence[str], Sequence[str]], config: Path | None
) -> tuple[Options, ...]:
    """The options of every method from every start, each checked. A setting goes to those that have its stage."""
    methods, starts = (list(dict.fromkeys(some)) for some in names)
    settings: Settings = values["settings"]
    common = {name: values[name] for name in ("georeference_sd", "model", "max_failure") if name in values}
    stages = {}
    for method, start in product(methods, starts):
        if start.endswith(".json"):
            raise UsageError(f"--start {start}: one transform is no start for many trials; give a coarse aligner.")
        stages[method, start] = settle({**common, "method": method, "start": start}, config).plugins.keys() | {"judge"}
    check_used(settings, sorted(set().union(*stages.values())))
    setups = []
    for (method, start), own in stages.items():
        mine = {stage: values for stage, values in settings.items() if stage in own}
        setups.append(settle({**common, "method": method, "start": start, "settings": mine}, config).options)
    return tuple(setups)


def families_of(names: Sequence[str]) -> tuple[str, ...]:
    """The families of these names, and of these groups, in their own order. `UsageError` for an unknown one."""
    for name in names:
        if name not in FAMILIES and name not in GROUPS:
            raise UsageError(f"there is no family or group {name!r}{suggestion(name, [*GROUPS, *FAMILIES])}")
    return tuple(name for name, family in FAMILIES.items() if name in names or family.group in names)


def of_surveys(
    folders: Sequence[Path], spread: tuple[float, float], checkpoints: Path | None, confidence_property: str
) -> tuple[Misregistered, list[str]]:
    """The trials of survey folders, and what is to be said about them."""
    if len(folders) > 2:
        raise UsageError("an evaluation takes two surveys at most, the reference and the source.")
    if checkpoints and len(folders) < 2:
        raise UsageError("--checkpoints are points in two surveys; give both.")
    reference, source = io.read_surveys(folders[0], folders[-1], confidence_property=confidence_property)
    for warning in dict.fromkeys((*reference.warnings, *source.warnings)):
        console.warn(warning)
    names = [survey.path.absolute().name for survey in (reference, source)]
    if len(folders) == 1:
        said = f"The survey {names[0]} against itself, misregistered: too easy, the fair trial is of two surveys."
    else:
        said = f"The survey {names[1]} against {names[0]}: both are taken as correctly georeferenced, so errors are "
        said += "against that, and include whatever they are off."
    notes = [said, f"Turned by {spread[0]:g} degrees and shifted by {spread[1]:g} m per axis (1 sd) in each trial."]
    points = io.read_checkpoints(checkpoints, reference.frame) if checkpoints else None
    with io.unchanged({**reference.stamps, **source.stamps}):
        images = io.read_images(reference, source)
    name = " ".join(dict.fromkeys(names))
    return Misregistered(name, reference.features, source.features, *spread, images, points), notes


def summary(notes: Sequence[str], lines: Sequence[Line], out: Path) -> str:
    """What was done, a line for each method, start and family, and where the files are."""
    header = ("method", "trials of", "trials", "right", "silent", "flagged", "failed", "error", "p95")
    rows = [[*header, "coverage", "seconds"]]
    for line in lines:
        error = line.error
        rows.append(
            [
                *(label(line), line.name, str(line.trials), in_words(line.right), silent_in_words(line)),
                *(in_words(line.flagged), in_words(line.failed)),
                *((f"{error.median:.3f} m", f"{error.p95:.3f} m") if error else ("-", "-")),
                in_words(line.covered),
                f"{line.seconds:.2f}" if line.seconds is not None else "-",
            ]
        )
    said = [line for note in notes for line in hanging("", note, width())]
    table = [f"  {line}".rstrip() for line in in_columns(rows, flush_left=2, width=width(GAP))]
    return "\n".join([*said, *table, *hanging("  files  ", [str(out / name) for name in FILES], width())])
