"""The folder that a command writes into: its rules, and files that arrive all together or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from treereg_core.errors import InputError, UsageError
from treereg_core.io.files import reason

DEFAULT_OUT = Path("treereg-out")
STAGING = ".treereg-staging-"

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
    the exception, nothing arrives and what was there stays.

    - `path`: new, empty, or, at the default place, holding nothing but files of an earlier run. With `overwrite` any
      folder; the files of an earlier run are removed then, and no others.
    - `inputs`: folders that are read; `path` must neither be nor contain one.
    - `names`: the files that a run may leave behind, relative to `path`; glob patterns are allowed.

    Entering raises `UsageError` for a folder that must not be written into, `InputError` for one that cannot be;
    leaving raises `InputError` when the files cannot arrive.
    """

    def __init__(
        self, path: Path, *, inputs: Iterable[Path] = (), overwrite: bool = False, names: Iterable[str] = RUN_NAMES
    ) -> None:
        self.path = path
        self._inputs = tuple(inputs)
        self._overwrite = overwrite
        self._names = tuple(names)
        self._staging: Path | None = None

    def __enter__(self) -> Path:
        try:
            self._check()
            target = self.path.absolute()
            base = next(folder for folder in (target, *target.parents) if folder.exists())
            self._staging = Path(tempfile.mkdtemp(prefix=STAGING, dir=base))
            new = self._staging / "new"
            new.mkdir()
        except OSError as error:
            raise self._unwritable(error) from error
        return new

    def __exit__(self, kind: type[BaseException] | None, value: object, traceback: TracebackType | None) -> None:
        assert self._staging is not None
        try:
            if kind is None:
                self._arrive(self._staging)
        except OSError as error:
            raise self._unwritable(error) from error
        finally:
            shutil.rmtree(self._staging, ignore_errors=True)

    def _check(self) -> None:
        target = self.path.resolve()
        if target.exists() and not target.is_dir():
            raise UsageError(f"{self.path} is a file, not a folder; choose another folder.")
        check_apart(self.path, self._inputs)
        if self._overwrite:
            return
        earlier = self._earlier()
        foreign = next((file for file in _files(self.path) if file not in earlier), None)
        at_default = target == DEFAULT_OUT.resolve()
        found = foreign or (next(iter(sorted(earlier)), None) if not at_default else None)
        if found:
            raise UsageError(
                f"{self.path} is in use, it holds {found.relative_to(self.path)}; choose another folder, or replace "
                "the files of an earlier run, and no others, with --overwrite."
            )

    def _earlier(self) -> set[Path]:
        """The files of an earlier run."""
        return {file for name in self._names for file in self.path.glob(name) if file.is_symlink() or file.is_file()}

    def _arrive(self, staging: Path) -> None:
        """Put the old files aside and the new ones in place; undone altogether if any step fails."""
        moves = [(file, staging / "old" / file.relative_to(self.path)) for file in sorted(self._earlier())]
        new = staging / "new"
        moves += [(file, self.path / file.relative_to(new)) for file in sorted(_files(new))]
        made: list[Path] = []
        begun = 0
        try:
            made = _make_folder(self.path)
            for begun, (old, place) in enumerate(moves, start=1):  # noqa: B007
                made += _make_folder(place.parent)
                os.replace(old, place)
        except BaseException:
            for old, place in reversed(moves[:begun]):
                if not old.exists():
                    with suppress(OSError):
                        os.replace(place, old)
            _remove_empty(made)
            raise
        _remove_empty({folder for file, _ in moves for folder in _between(file, self.path)})

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(f"{self.path} cannot be written ({reason(error)}); choose another folder.")


def check_apart(path: Path, inputs: Iterable[Path]) -> None:
    """Raise `UsageError` when a folder to write into is an input folder, or contains one."""
    target = path.resolve()
    for given in inputs:
        folder = given.resolve()
        if os.path.isdir(folder) and (folder == target or target in folder.parents):
            raise UsageError(f"--out {path} is or contains the input folder {given}; choose another folder.")


def _files(folder: Path) -> Iterable[Path]:
    """Every file below a folder, one by one; what an interrupted run left aside does not count."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(STAGING)]
        yield from (Path(place) / name for name in names)


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
