"""GeoJSON files read some features at a time: a million trees as Python's values take several gigabytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from treereg_core.errors import InputError
from treereg_core.io import geojson
from treereg_core.io.json_pieces import NotInPieces, items_of, read_whole

T = TypeVar("T")
Use = Callable[[list[dict[str, Any]], int], T]
"""What is made of some features; the number is that of the first one."""


def in_pieces(path: Path, use: Use[T]) -> tuple[dict[str, Any], list[T]]:
    """A GeoJSON document, perhaps without its features, and what `use` made of them all, in their order.

    Raises `InputError` for a file that is not sound, and what `use` raises of that kind. An error is the one that would
    be found in the whole file: the JSON's before one of the document, of its features, and of their use.
    """
    document: dict[str, Any] = {}
    found: list[T] = []
    unsound: InputError | None = None
    unusable: InputError | None = None
    first = 0
    try:
        for features in items_of(path, "features", document):
            try:
                if not unsound:
                    geojson.check_features(features, first, path)
            except InputError as error:
                unsound = error
            try:
                if not unsound and not unusable:
                    found.append(use(features, first))
            except InputError as error:
                unusable = error
            first += len(features)
    except NotInPieces:
        return _whole(path, use)
    if geojson.kind_of(document, path) != "FeatureCollection":
        return _whole(path, use)
    if wrong := unsound or unusable:
        raise wrong
    return document, found


def check_pieces(path: Path) -> dict[str, Any]:
    """A GeoJSON document, perhaps without its features, which are checked and not kept. `InputError` as above."""
    return in_pieces(path, lambda features, first: None)[0]


def _whole(path: Path, use: Use[T]) -> tuple[dict[str, Any], list[T]]:
    document = read_whole(path)
    return document, [use(geojson.features_of(document, path), 0)]
