"""Reading the transform that a file holds, into a working frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import converter, crs_name, full_coordinates, parse_crs
from treereg_core.io.files import read_json
from treereg_core.io.grid import Motion
from treereg_core.survey import Frame
from treereg_core.transform import Affine, FloatArray, Model, Rigid, Similarity

REACH_M = 500.0


def read_transform(path: Path, frame: Frame) -> Affine:
    """The transform `reference_from_source` in a JSON file, brought into a working frame, metres.

    The file is one of ours (`registration.json`, `misregistration.json`, `truth.json`): `crs`, and `transform` with
    `matrix` and perhaps `model`; without a model it is of the narrowest kind that the matrix is. In another CRS it is
    fitted anew around the frame's origin. Raises `InputError` for a file without such a transform.
    """
    document = _document(path)
    record = document["transform"]
    if record is None:
        raise InputError(f"{path} is of a registration that failed and has no transform; give another one.")
    if not isinstance(record, dict):
        record = {"matrix": record}
    full = _affine(record.get("matrix"), path)
    model = _model(record.get("model"), path)
    crs = _crs(document, path)
    if crs == frame.crs:
        return _of_kind(full.about(frame.origin), model, path)
    return _converted(full, crs, frame, model, path)


def read_motion(path: Path, rival: int | None = None, force: bool = False) -> Motion:
    """The transform in a file of ours, in the file's own CRS.

    `rival` takes another placement of the registration, counted from 1. A registration that was not accepted needs
    that, or `force`. Raises `InputError` for a file without such a transform.
    """
    document = _document(path)
    crs = _crs(document, path)
    if rival is not None:
        return Motion(crs, _affine(_rival(document, rival, path), path))
    record, verdict = document["transform"], document.get("verdict", "accepted")
    if record is None:
        raise InputError(
            f"{path} is of a registration that failed and has no transform; choose a placement with --rival, or give "
            "another file."
        )
    if verdict != "accepted" and not force:
        raise InputError(
            f"{path} is of a registration that is {verdict!s:.40}, not accepted; choose a placement with --rival, or "
            "take its own with --force."
        )
    return Motion(crs, _affine(record.get("matrix") if isinstance(record, dict) else record, path))


def _document(path: Path) -> dict[str, Any]:
    """The object in a file of ours, which has a transform, perhaps null."""
    document = read_json(path)
    if not isinstance(document, dict) or "transform" not in document:
        raise InputError(
            f"{path} holds no transform; give a registration.json, misregistration.json or truth.json instead."
        )
    return document


def _crs(document: dict[str, Any], path: Path) -> str:
    if not isinstance(document.get("crs"), str):
        raise InputError(f"{path} does not say in which CRS its transform is; add it as 'crs', such as EPSG:32734.")
    known = parse_crs(document["crs"], path)
    if not known.is_projected:
        raise InputError(f"{path} has a transform in {known.name}, which is not projected; give one in metres.")
    return crs_name(known)


def _rival(document: dict[str, Any], number: int, path: Path) -> Any:
    """The matrix of a rival, counted from 1."""
    rivals = document.get("rivals")
    if not isinstance(rivals, list) or not rivals:
        raise InputError(f"{path} names no rivals; leave out --rival.")
    if not 1 <= number <= len(rivals):
        raise InputError(f"{path} names {len(rivals)} rivals, and there is no number {number}; count from 1.")
    chosen = rivals[number - 1]
    return chosen.get("matrix") if isinstance(chosen, dict) else None


def full_from_frame(frame: Frame, crs: str) -> Affine:
    """The transform that takes working coordinates to full ones in `crs`, metres.

    It is a shift where that is the frame's own CRS, else fitted to a square of points around the frame's origin.
    Raises `ValueError` where `crs` does not reach.
    """
    if crs == frame.crs:
        return Rigid(np.eye(2), frame.origin)
    here = _square()
    there = full_coordinates(here, frame, crs)
    if not np.isfinite(there).all():
        raise ValueError(f"{crs:.40} does not reach this place")
    centre = there.mean(axis=0)
    return Rigid(np.eye(2), centre) @ Model.AFFINE.fit(here, there - centre)


def _affine(matrix: Any, path: Path) -> Affine:
    try:
        return Affine.from_matrix(matrix)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(
            f"{path} has no usable matrix ({error}); give 3 rows of 3 numbers, the last 0, 0, 1."
        ) from error


def _model(name: Any, path: Path) -> Model | None:
    if name is None:
        return None
    try:
        return Model(name)
    except ValueError as error:
        known = ", ".join(model.value for model in Model)
        raise InputError(
            f"{path} has a transform of the unknown model {name!r:.40}; it must be one of {known}."
        ) from error


def _of_kind(affine: Affine, model: Model | None, path: Path) -> Affine:
    """The same map as a transform of its model's kind, or of the narrowest kind it is."""
    kinds: tuple[type[Affine], ...] = (model.kind,) if model else (Rigid, Similarity, Affine)
    for kind in kinds:
        try:
            return kind(affine.linear, affine.shift)
        except ValueError:
            continue
    raise InputError(
        f"{path} calls its transform {kinds[0].__name__.lower()}, but its matrix is not; correct the model."
    )


def _converted(full: Affine, crs: str, frame: Frame, model: Model | None, path: Path) -> Affine:
    """The same motion in another CRS, fitted to a square of points around the frame's origin, where it acts."""
    reference = _square()
    origin = np.array(frame.origin)
    there = converter(frame.crs, crs)(reference + origin)
    centre = there.mean(axis=0)
    if np.isfinite(centre).all():
        inverse = full.about(centre).inverse()
        source = converter(crs, frame.crs)(inverse(there - centre) + centre) - origin
        if np.isfinite(source).all():
            kind = model or next(m for m in Model if isinstance(_of_kind(full, None, path), m.kind))
            return kind.fit(source, reference)
    raise InputError(f"{path} has a transform in {crs:.40}, which does not reach these surveys; correct its CRS.")


def _square() -> FloatArray:
    """Points (25, 2) of a square around the origin, metres."""
    steps = np.linspace(-REACH_M, REACH_M, 5)
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
