"""Which file of a survey folder plays which role, and reading JSON with errors for people."""

from __future__ import annotations

import gc
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treereg_core.errors import InputError, TreeregError
from treereg_core.io.untrusted import check_file_size

DETECTIONS = ("raw-detections", "raw_detections", "detections_raw")
SUFFIXES = (".geojson", ".gpkg", ".parquet")


@dataclass(frozen=True)
class SurveyFiles:
    """The files of a survey folder by role; None for those it does not have."""

    folder: Path
    detections: Path
    boundary: Path | None
    visible: Path | None
    dem: Path | None

    @property
    def present(self) -> tuple[Path, ...]:
        """Those that there are."""
        return tuple(file for file in (self.detections, self.boundary, self.visible, self.dem) if file)


def find_files(folder: Path) -> SurveyFiles:
    """The files of a survey folder. `InputError` without detections, or with two candidates for one role."""
    try:
        if folder.is_file():
            raise InputError(f"{folder} is a file; give the survey folder that holds {DETECTIONS[0]}.geojson instead.")
        if not folder.is_dir():
            raise InputError(f"{folder}: there is no such folder; check the path of the survey.")
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder} cannot be listed ({reason(error)}); check its permissions.") from error
    detections = _only(folder, [n for n in names if n in {stem + suffix for stem in DETECTIONS for suffix in SUFFIXES}])
    if detections is None:
        visible = [name for name in names if not name.startswith(".")]
        found = f"it holds {_some(visible)}" if visible else "it is empty"
        raise InputError(
            f"{folder} has no detections ({found}); name the file of canopy polygons {DETECTIONS[0]}.geojson, "
            ".gpkg or .parquet."
        )
    return SurveyFiles(
        folder=folder,
        detections=detections,
        boundary=_only(folder, [n for n in names if n in {"boundary" + suffix for suffix in SUFFIXES}]),
        visible=_only(folder, [n for n in names if n.startswith("visible_") and n.endswith(".tif")]),
        dem=_only(folder, [n for n in names if n.startswith("dem_") and n.endswith(".tif")]),
    )


def _only(folder: Path, names: list[str]) -> Path | None:
    if len(names) > 1:
        raise InputError(f"{folder} holds both {names[0]} and {names[1]}, and only one is taken; remove the other.")
    if not names:
        return None
    if not (folder / names[0]).is_file():
        raise InputError(f"{folder / names[0]} cannot be read, it is not a file; put the exported file in its place.")
    return folder / names[0]


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def reason(error: OSError) -> str:
    """Why the system refused, in its own words."""
    return (error.strerror or str(error)).lower()


def nearest(path: Path) -> Path:
    """The path, or the nearest one above it that there is."""
    return next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())


def check_writable(folder: Path) -> None:
    """Raise `OSError` unless a file can be made in a folder or, where that is new, in the nearest one above it."""
    with tempfile.TemporaryFile(dir=nearest(folder)):
        pass


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turns whatever a reader of files raises into an `InputError` that names the file."""
    try:
        yield
    except TreeregError:
        raise
    except OSError as error:
        if error.strerror is None:
            raise InputError(f"{path} cannot be read as {kind} ({first_line(error)}); export it again.") from error
        raise InputError(f"{path} cannot be read ({reason(error)}); check the path and its permissions.") from error
    except Exception as error:
        raise InputError(f"{path} cannot be read as {kind} ({first_line(error)}); export it again.") from error


def first_line(error: Exception) -> str:
    """The first line of an error's text, short enough to stand in a sentence."""
    text = (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= 160 else text[:157] + "..."


@contextmanager
def collector_paused() -> Iterator[None]:
    """No garbage collection while millions of small values come to life that are all needed: it takes half the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _decoded(path: Path) -> str:
    check_file_size(path)
    raw = path.read_bytes()
    return raw.decode(json.detect_encoding(raw))


def read_json(path: Path, hook: Callable[[list[tuple[str, Any]]], Any] | None = None) -> Any:
    """The value in a JSON file. `InputError` for one that is missing, unreadable, cut off or nested too deeply.

    `hook` is given the members of every object and says what stands for it.
    """
    try:
        text = _decoded(path)
        if not text.strip():
            raise InputError(f"{path} is empty; export it again.")
        with collector_paused():
            return json.loads(text, object_pairs_hook=hook)
    except OSError as error:
        raise InputError(f"{path} cannot be read ({reason(error)}); check the path and its permissions.") from error
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is not JSON, or is cut off (line {error.lineno}, column {error.colno}: {error.msg}); "
            "export it again."
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not JSON in UTF-8 (byte {error.start}); export it again.") from error
    except RecursionError as error:
        raise InputError(f"{path} is nested too deeply to be read; remove the deep values.") from error
    except ValueError as error:
        raise InputError(
            f"{path} holds a value that cannot be read ({first_line(error)}); mend or remove it."
        ) from error
