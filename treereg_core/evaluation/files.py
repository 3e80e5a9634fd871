"""The files of an evaluation: the log of trials, then the summary and the page."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

from treereg_core import io
from treereg_core.errors import UsageError
from treereg_core.evaluation.page import page
from treereg_core.evaluation.running import Study
from treereg_core.evaluation.summary import Line, summed_up
from treereg_core.evaluation.trial import Trial, plugins
from treereg_core.io.lock import take_if_possible
from treereg_core.io.output import check_place, unwritable
from treereg_core.io.staging import PREFIX
from treereg_core.page import made_by

SCHEMA = "treereg/evaluation/1"
LOCK = f"{PREFIX}evaluation"
TRIALS, SUMMARY, PAGE = FILES = ("trials.csv", "evaluation.json", "evaluation.html")
"""The log is there while trials run, the other two once all are done."""
ANEW = "trials-new.csv"
"""The log of an evaluation that is begun anew, until it takes the place of the one before."""


@contextmanager
def evaluation_folder(folder: Path, inputs: Sequence[Path], overwrite: bool) -> Iterator[Path]:
    """The folder of an evaluation, made ready and held by one at a time; gives the place of its log.

    It may be new or empty, or hold an evaluation that was interrupted or done, which goes on; with `overwrite` one is
    begun anew, the one before stays until that is done, and other files in the folder stay. `UsageError` for another
    folder, and while another evaluation is at work in it; `InputError` for one that cannot be written.
    """
    check_place(folder, inputs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = take_if_possible(folder / LOCK)
    except OSError as error:
        raise unwritable(folder, error) from error
    if lock is None:
        raise UsageError(f"another evaluation is at work in {folder}; wait until it is done, or choose another.")
    try:
        io.settle_left(folder)
        yield _log(folder, overwrite)
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(lock)


def _log(folder: Path, overwrite: bool) -> Path:
    """The place of the log in a folder that may be used; what is left of one begun anew goes on, or is removed."""
    log, anew = folder / TRIALS, folder / ANEW
    others = sorted(entry.name for entry in folder.iterdir() if entry.name not in (*FILES, ANEW))
    foreign = next((name for name in others if not name.startswith(PREFIX)), None)
    if foreign and not overwrite and not log.exists():
        raise UsageError(f"{folder} is in use, it holds {foreign}; choose another folder, or give --overwrite.")
    if overwrite:
        anew.unlink(missing_ok=True)
    return anew if anew.exists() or (overwrite and log.exists()) else log


def write_evaluation(study: Study, notes: Sequence[str], trials: Sequence[Trial], log: Path) -> list[Line]:
    """Write the summary and the page of the trials that were done beside their log; gives the lines of their table.

    All three take the place of those of an earlier evaluation at once. `notes` say in sentences what was done.
    """
    lines = summed_up(trials)
    by = made_by(plugins(study.setups))
    with io.OutputFolder(log.parent, overwrite=True, names=(*FILES, ANEW)) as folder:
        shutil.copyfile(log, folder / TRIALS)
        io.write_json(folder / SUMMARY, to_json(study, notes, lines))
        io.write_text(folder / PAGE, page("Evaluation of registrations", [*notes, by], trials, lines))
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
