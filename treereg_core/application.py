"""Applying a transform to files: what each will become, settled and checked before any is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from treereg_core import io
from treereg_core.errors import InputError, UsageError


@dataclass(frozen=True)
class Application:
    """One file to be moved: the names of the files that come of it, and the job where it is a raster."""

    path: Path
    motion: io.Motion
    names: tuple[str, ...]
    job: io.RasterJob | None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know before the work."""
        return self.job.warnings if self.job else ()

    def write(self, folder: Path, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write what comes of the file into a folder; gives warnings. `InputError` when that cannot be done."""
        if self.job:
            return self.job.write(folder / self.names[0], progress)
        io.move_vector(self.path, self.motion, folder)
        return ()


def applications(
    files: Sequence[Path], motion: io.Motion, grid: Path | None, options: io.RasterOptions, folder: Path
) -> tuple[Application, ...]:
    """What will become of files that are moved into `folder`, or one below it; `grid` is a raster whose grid is taken.

    Raises `UsageError` for files that would get one name, `InputError` for one that cannot be moved.
    """
    onto = io.read_raster(grid).grid if grid else None
    found = [_application(file, motion, onto, options, folder) for file in files]
    taken: dict[str, Path] = {}
    for one in found:
        for name in one.names:
            other = taken.setdefault(name.casefold(), one.path)
            if other is not one.path:
                raise UsageError(f"{other} and {one.path} would both become {name}; move them one by one")
    return tuple(found)


def _application(
    file: Path, motion: io.Motion, onto: io.Grid | None, options: io.RasterOptions, folder: Path
) -> Application:
    if not file.is_file():
        what = "is a folder; give the files in it" if file.is_dir() else "there is no such file; check the path"
        raise InputError(f"{file}: {what}.")
    if io.is_vector(file):
        return Application(file, motion, io.vector_names(file), None)
    job = io.raster_job(io.read_raster(file, (motion.crs, None)), motion, onto, options, folder)
    name = file.name if file.suffix.lower() in (".tif", ".tiff") else f"{file.stem}.tif"
    return Application(file, motion, tuple(path.name for path in job.files(Path(name))), job)
