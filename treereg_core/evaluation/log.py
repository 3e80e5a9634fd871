"""The log of trials: a CSV file, a row for each trial as it finishes, so that an interrupted study loses nothing."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from treereg_core.errors import InputError, UsageError
from treereg_core.evaluation.trial import Trial, setup

if TYPE_CHECKING:
    from treereg_core.evaluation.running import Study

FIXED = [field.name for field in fields(Trial) if field.name != "figures"]
READ: dict[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}
READERS = {field.name: READ[str(field.type)] for field in fields(Trial) if field.name != "figures"}


class Log:
    """A file of trials, begun with the first one; `trials` are those that it held when it was opened.

    Opening raises `UsageError` when it holds trials of something else, `InputError` when it cannot be used. A row that
    was cut off is taken out.
    """

    def __init__(self, path: Path, study: Study) -> None:
        self.path = path
        self.trials: tuple[Trial, ...] = ()
        self._columns: tuple[str, ...] = ()
        with self._writing():
            if path.exists() and path.stat().st_size:
                _cut_at_last_row(path)
                self._columns, self.trials = read(path)
                _check(path, self.trials, study)

    def append(self, trials: Sequence[Trial]) -> None:
        """Add a row for each of these. `InputError` when it cannot be written."""
        text = ""
        if not self._columns:
            self._columns = (*FIXED, *sorted({name for trial in trials for name in trial.figures}))
            text = _row(self._columns)
        text += "".join(_row([_value(trial, column) for column in self._columns]) for trial in trials)
        with self._writing(), self.path.open("a", encoding="utf-8", newline="") as file:
            file.write(text)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"{self.path} cannot be written ({reason}); mend that, and run it again.") from error


def read(path: Path) -> tuple[tuple[str, ...], tuple[Trial, ...]]:
    """The columns and the trials of a log. `UsageError` for a file that is none, `OSError` when it cannot be read."""
    wrong = UsageError(f"{path}: not a file of trials of this version; give one that treereg evaluate wrote.")
    with path.open(encoding="utf-8", newline="") as file:
        try:
            rows = csv.DictReader(file)
            columns = tuple(rows.fieldnames or ())
            if columns[: len(FIXED)] != tuple(FIXED):
                raise wrong
            figures = columns[len(FIXED) :]
            trials = tuple(
                Trial(
                    **{name: READERS[name](row[name]) for name in FIXED},
                    figures={name: float(row[name]) for name in figures},
                )
                for row in rows
            )
        except (TypeError, ValueError, csv.Error):
            raise wrong from None
    return columns, trials


def _check(path: Path, trials: Sequence[Trial], study: Study) -> None:
    setups, names = {setup(options) for options in study.setups}, set(study.source.names)
    other = next((trial for trial in trials if trial.setup not in setups or trial.name not in names), None)
    if other is not None:
        raise UsageError(
            f"{path} holds trials of {other.name} under other options; give the same ones again, or write elsewhere."
        )


def _cut_at_last_row(path: Path) -> None:
    """Take out what an interrupted run left of a row."""
    with path.open("rb+") as file:
        content = file.read()
        file.truncate(content.rfind(b"\n") + 1)


def _value(trial: Trial, column: str) -> Any:
    return getattr(trial, column) if column in READERS else trial.figures.get(column, float("nan"))


def _row(values: Iterable[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue()
