"""The files of an evaluation: the log of trials, then the summary and the page."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

from treereg_core import io
from treereg_core.errors import InputError, UsageError
from treereg_core.evaluation.page import page
from treereg_core.evaluation.running import Study
from treereg_core.evaluation.summary import Line, summed_up
from treereg_core.evaluation.trial import Trial, plugins
from treereg_core.io.files import reason
from treereg_core.io.lock import take_if_possible
from treereg_core.io.output import check_apart
from treereg_core.io.staging import PREFIX
from treereg_core.page import made_by

SCHEMA = "treereg/evaluation/1"
LOCK = f"{PREFIX}evaluation"
TRIALS, SUMMARY, PAGE = FILES = ("trials.csv", "evaluation.json", "evaluation.html")
"""The log is there while trials run, the other two once all are done."""


@contextmanager
def evaluation_folder(folder: Path, inputs: Sequence[Path], overwrite: bool) -> Iterator[Path]:
    """The folder of an evaluation, made ready and held by one at a time; gives the place of its log.

    It may be new or empty, or hold an evaluation that was interrupted or done, which goes on; with `overwrite` that is
    begun anew, and other files in the folder stay. `UsageError` for another folder, and while another evaluation is at
    work in it; `InputError` for one that cannot be written.
    """
    check_apart(folder, inputs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        others = (entry.name for entry in sorted(folder.iterdir()) if entry.name not in FILES)
        foreign = next((name for name in others if not name.startswith(PREFIX)), None)
        if foreign and not overwrite and not (folder / TRIALS).exists():
            raise UsageError(f"{folder} is in use, it holds {foreign}; choose another folder, or give --overwrite.")
        lock = take_if_possible(folder / LOCK)
        if lock is None:
            raise UsageError(f"another evaluation is at work in {folder}; wait until it is done, or choose another.")
        for name in FILES if overwrite else FILES[1:]:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({reason(error)}); choose another folder.") from error
    try:
        yield folder / TRIALS
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(lock)


def write_evaluation(study: Study, notes: Sequence[str], trials: Sequence[Trial], out: Path) -> list[Line]:
    """Write the summary and the page of the trials that were done, and give the lines of their table.

    `notes` say in sentences what was done.
    """
    lines = summed_up(trials)
    io.write_json(out / SUMMARY, to_json(study, notes, lines))
    by = made_by(plugins(study.setups))
    io.write_text(out / PAGE, page("Evaluation of registrations", [*notes, by], trials, lines))
    return lines


def to_json(study: Study, notes: Sequence[str], lines: Sequence[Line]) -> dict[str, Any]:
    """The content of evaluation.json: plain values, every number finite or null."""
    return {
        "schema": SCHEMA,
        "version": metadata.version("treereg"),
        "plugins": plugins(study.setups),
        "notes": list(notes),
        "setups": [options.model_dump(mode="json", exclude={"memory", "threads"}) for options in study.setups],
        "names": list(study.source.names),
        "seeds": [study.seeds.start, study.seeds.stop - 1],
        "results": [line.to_json() for line in lines],
    }
