"""The bar at the foot of a terminal; imported when one is drawn."""

from __future__ import annotations

from contextlib import suppress
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn
from rich.table import Column
from rich.text import Text


class Time(ProgressColumn):
    """The time left where it can be told, else the time that went by."""

    def render(self, task: Task) -> Text:
        """The column of one task."""
        gone = task.elapsed or 0.0
        if task.total and 0 < task.completed < task.total:
            return Text(f"{timedelta(seconds=round(gone / task.completed * (task.total - task.completed)))} left")
        return Text(str(timedelta(seconds=int(gone))))


class Bar:
    """One line on stderr: what is being done, how much of it, and the time; gone when it is stopped."""

    def __init__(self, message: str) -> None:
        what = TextColumn(
            "{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="crop", ratio=3)
        )
        bar = BarColumn(bar_width=None, table_column=Column(min_width=6, ratio=2))
        self._progress = Progress(
            *(what, bar, TaskProgressColumn(), Time(table_column=Column(no_wrap=True))),
            console=Console(stderr=True, highlight=False),
            transient=True,
            expand=True,
            redirect_stdout=False,
        )
        self._task = self._progress.add_task(message, total=None)
        self._kind = ""

    def start(self) -> None:
        """Draw it; whatever interrupts this, `stop` puts the terminal in order."""
        self._progress.start()

    def show(self, kind: str, message: str, done: float | None) -> None:
        """Show what is being done and the share of it that is done, None where that is not known.

        The time counts from where the kind of work changes.
        """
        if kind != self._kind:
            self._progress.reset(self._task, start=True)
            self._kind = kind
        total = None if done is None else 1.0
        self._progress.update(self._task, description=message, total=total, completed=done or 0.0)

    def stop(self) -> None:
        """Take the line away."""
        with suppress(IndexError):  # raised where an interruption came in the middle of the start
            self._progress.stop()
        self._progress.console.show_cursor(True)
