"""Writing GeoJSON: one feature per line, some features at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from treereg_core.errors import InputError
from treereg_core.io.complete import complete_file
from treereg_core.io.files import collector_paused
from treereg_core.io.jsontext import json_line
from treereg_core.parts import parts
from treereg_core.transform import FloatArray


def write_columns(columns: Mapping[str, list[Any]], kind: str, coordinates: FloatArray, path: Path) -> None:
    """Write GeoJSON features of one kind of geometry, one for each entry of the columns. `InputError` if it cannot be.

    `coordinates` (n, ...) are those of each geometry; few are made lists of at a time.
    """

    def some(part: slice) -> bytes:
        shapes: Any = coordinates[part].tolist()
        features = [
            {
                "type": "Feature",
                "properties": dict(zip(columns, values, strict=True)),
                "geometry": {"type": kind, "coordinates": shape},
            }
            for shape, *values in zip(shapes, *(column[part] for column in columns.values()), strict=True)
        ]
        return feature_lines(features, path)

    with collector_paused():
        write_lines(map(some, parts(len(coordinates))), path)


def write_features(features: list[dict[str, Any]], path: Path, members: Mapping[str, Any] | None = None) -> None:
    """Write GeoJSON features, one per line, with further members of the collection. `InputError` if it cannot be."""
    write_lines([feature_lines(features, path)], path, members)


def feature_lines(features: list[dict[str, Any]], path: Path) -> bytes:
    """GeoJSON features, one per line. `InputError` names the file that they are for, if it cannot be."""
    with _not_too_deep(path):
        return b",\n".join(map(json_line, features))


def write_lines(lines: Iterable[bytes], path: Path, members: Mapping[str, Any] | None = None) -> None:
    """Write what `feature_lines` made, with further members of the collection. `InputError` if it cannot be."""
    with complete_file(path) as file:
        file.write(b'{\n"type": "FeatureCollection",\n')
        with _not_too_deep(path):
            for key, item in (members or {}).items():
                file.write(json_line(key) + b": " + json_line(item) + b",\n")
        file.write(b'"features": [')
        for i, part in enumerate(filter(None, lines)):
            file.write((b",\n" if i else b"\n") + part)
        file.write(b"\n]\n}\n")


@contextmanager
def _not_too_deep(path: Path) -> Iterator[None]:
    try:
        yield
    except RecursionError as error:
        raise InputError(f"{path} would be nested too deeply; remove the deep values from the source.") from error
