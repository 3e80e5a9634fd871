"""The folder that a command writes into: its rules, and files that arrive all together or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType

from treereg_core.errors import InputError, TreeregError, UsageError
from treereg_core.io.files import check_writable, reason
from treereg_core.io.staging import GONE, NEW, OLD, arriving, files_below, staging_folder

DEFAULT_OUT = Path("treereg-out")
REFUSED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""What a system says that takes no more of a file."""

_SURVEY = ("raw-detections.geojson", "boundary.geojson", "visible_10cm.tif", "dem_10cm.tif")
SIMULATION_NAMES = ("truth.json", *(f"{role}/{name}" for role in ("reference", "source") for name in _SURVEY))
"""The files that `treereg simulate` writes."""
_RASTER_ENDS = (".tif", ".tif.ovr", ".tif.msk", ".tif.aux.xml", ".tif.points", ".tfw")
RUN_NAMES = (
    "registration.json",
    "detections_registered.geojson",
    "tree_matches.geojson",
    *(f"{kind}_registered{end}" for kind in ("visible", "dem") for end in _RASTER_ENDS),
    "report.html",
    "report-data.json",
    *(f"demonstration/{name}" for name in SIMULATION_NAMES),
)
"""The files that `treereg run` writes."""


class OutputFolder:
    """A folder to write into, for use in a `with` statement, which gives a staging folder in its stead.

    What the block wrote into the staging folder arrives in `path` when the block ends well; when it raises, whatever
    the exception, nothing arrives and what was there stays. A new folder appears with all its files at once. In one
    that is there, old files are put aside before any new one arrives; should the process be killed in between, the
    next run puts them back, or lets the rest arrive.

    - `path`: new, empty, or, at the default place, holding nothing but files of an earlier run. With `overwrite` any
      folder; the files of an earlier run are removed then, and no others.
    - `inputs`: folders that are read; `path` must neither be nor contain one.
    - `names`: the files that a run may leave behind, relative to `path`, or a function of `path` that tells them; glob
      patterns are allowed.

    Entering raises `UsageError` for a folder that must not be written into or that another run writes into,
    `InputError` for one that cannot be; leaving raises `InputError` when the files cannot arrive.
    """

    def __init__(
        self,
        path: Path,
        *,
        inputs: Iterable[Path] = (),
        overwrite: bool = False,
        names: Iterable[str] | Callable[[Path], Iterable[str]] = RUN_NAMES,
    ) -> None:
        self.path = path
        self._inputs = tuple(inputs)
        self._overwrite = overwrite
        self._names = names if callable(names) else tuple(names)
        self._staging: Path | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Path:
        check_place(self.path, self._inputs)
        try:
            self._staging = self._stack.enter_context(staging_folder(self.path.absolute()))
        except OSError as error:
            raise unwritable(self.path, error) from error
        try:
            self._check_use()
        except OSError as error:
            self._stack.close()
            raise unwritable(self.path, error) from error
        except BaseException:
            self._stack.close()
            raise
        return self._staging / NEW

    def __exit__(self, kind: type[BaseException] | None, value: object, traceback: TracebackType | None) -> None:
        assert self._staging is not None
        with self._stack:
            if isinstance(value, TreeregError) and str(self._staging) in str(value):  # where the file will never be
                raise InputError(str(value).replace(str(self._staging / NEW), str(self.path))) from value
            if isinstance(value, OSError) and value.errno in REFUSED:
                raise unwritable(self.path, value) from value
            if kind is None:
                try:
                    self._arrive(self._staging)
                except OSError as error:
                    raise unwritable(self.path, error) from error

    def _check_use(self) -> None:
        """Refuse a folder that holds what must stay."""
        if self._overwrite:
            return
        earlier = self._earlier()
        foreign = next((file for file in files_below(self.path) if file not in earlier), None)
        at_default = self.path.resolve() == DEFAULT_OUT.resolve()
        found = foreign or (next(iter(sorted(earlier)), None) if not at_default else None)
        if found:
            raise UsageError(
                f"{self.path} is in use, it holds {found.relative_to(self.path)}; choose another folder, or replace "
                "the files of an earlier run, and no others, with --overwrite."
            )

    def _earlier(self) -> set[Path]:
        """The files of an earlier run."""
        names = self._names(self.path) if callable(self._names) else self._names
        return {file for name in names for file in self.path.glob(name) if file.is_symlink() or file.is_file()}

    def _arrive(self, staging: Path) -> None:
        """Put the old files aside and the new ones in place; undone altogether if any step fails."""
        new, old, gone = (staging / name for name in (NEW, OLD, GONE))
        if staging.parent != self.path.absolute():
            made = _make_folder(self.path.parent)
            try:
                os.replace(new, self.path)
            except BaseException:
                _remove_empty(made)
                raise
            return
        earlier = [file.relative_to(self.path) for file in reversed(arriving(self._earlier()))]
        fresh = [file.relative_to(new) for file in arriving(files_below(new))]
        made = []
        try:
            old.mkdir()
            for name in earlier:
                (old / name.parent).mkdir(parents=True, exist_ok=True)
                os.replace(self.path / name, old / name)
            os.replace(old, gone)
            for name in fresh:
                made += _make_folder((self.path / name).parent)
                os.replace(new / name, self.path / name)
        except BaseException:
            with suppress(OSError):  # then the next run settles it
                self._undo(staging, earlier, fresh)
            _remove_empty(made)
            raise
        shutil.rmtree(gone, ignore_errors=True)
        _remove_empty({folder for name in (*earlier, *fresh) for folder in _between(self.path / name, self.path)})

    def _undo(self, staging: Path, earlier: list[Path], fresh: list[Path]) -> None:
        """Take the new files away again and put the old ones back; broken off, it can be settled as an arrival can."""
        new, old, gone = (staging / name for name in (NEW, OLD, GONE))
        if gone.exists():
            for name in reversed(fresh):
                if not (new / name).exists():
                    os.replace(self.path / name, new / name)
            os.replace(gone, old)
        for name in reversed(earlier):
            if (old / name).exists():
                os.replace(old / name, self.path / name)


def check_place(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Refuse a folder to write into that cannot be one, is an input folder or contains one, before any work.

    Raises `UsageError`, and `InputError` where the system refuses.
    """
    try:
        Path.cwd()
    except FileNotFoundError:
        raise UsageError("the current folder is no longer there; change into another one.") from None
    try:
        if path.is_symlink() and not path.exists():
            raise UsageError(f"{path} is a link to a folder that is not there; make it, or choose another folder.")
        if path.exists() and not path.is_dir():
            raise UsageError(f"{path} is a file, not a folder; choose another folder.")
        target = path.resolve()
        for given in inputs:
            folder = given.resolve()
            if os.path.isdir(folder) and (folder == target or target in folder.parents):
                raise UsageError(f"--out {path} is or contains the input folder {given}; choose another folder.")
        check_writable(path)
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> InputError:
    """What to say of a folder that the system does not let us write into."""
    return InputError(f"{path} cannot be written ({reason(error)}); choose another folder.")


def _make_folder(folder: Path) -> list[Path]:
    """Make a folder with those above it; gives the new ones."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _between(file: Path, folder: Path) -> list[Path]:
    """The folders that hold a file below another folder, which is not among them."""
    return [place for place in file.parents if folder in place.parents]


def _remove_empty(folders: Iterable[Path]) -> None:
    """Remove those folders that are empty, deepest first."""
    for folder in sorted(folders, key=lambda place: len(place.parts), reverse=True):
        with suppress(OSError):
            folder.rmdir()
