"""The folder of a batch: held by one batch at a time, with a folder in it for each orchard."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType

from treereg_core.errors import UsageError
from treereg_core.io.lock import take_if_possible
from treereg_core.io.output import check_place, unwritable
from treereg_core.io.staging import settle_left

LOCK = ".treereg-batch"


class BatchFolder:
    """The folder of a batch, for use in a `with` statement, made where there is none.

    It may be new or empty, or hold an earlier batch, which goes on; with `overwrite` any other too. Entering raises
    `UsageError` for a folder that must not be written into, is or contains one of `inputs`, or in which another batch
    is at work, `InputError` for one that cannot be written. The lock goes with the process that holds it.
    """

    def __init__(self, path: Path, inputs: Iterable[Path], overwrite: bool = False) -> None:
        self.path = path
        self._inputs = inputs
        self._overwrite = overwrite
        self._lock = -1

    def __enter__(self) -> Path:
        check_place(self.path, self._inputs)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            foreign = next((entry.name for entry in sorted(self.path.iterdir())), None)
            if foreign and not self._overwrite and not (self.path / LOCK).exists():
                raise UsageError(
                    f"{self.path} is in use, it holds {foreign}; choose another folder, or give --overwrite."
                )
            lock = take_if_possible(self.path / LOCK)
            if lock is None:
                raise UsageError(
                    f"another batch is at work in {self.path}; wait until it is done, or choose another folder."
                )
            self._lock = lock
            for folder in [self.path, *self.path.iterdir()]:
                settle_left(folder)
        except OSError as error:
            raise unwritable(self.path, error) from error
        return self.path

    def __exit__(self, kind: type[BaseException] | None, value: object, traceback: TracebackType | None) -> None:
        os.close(self._lock)
