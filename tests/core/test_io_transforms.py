"""The transform in a file, into the working frame."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from io_files import CRS, ORIGIN

from treereg_core.errors import InputError
from treereg_core.io import read_transform, write_json
from treereg_core.io.crs import converter
from treereg_core.survey import Frame
from treereg_core.transform import Affine, Model, Rigid, Similarity

FRAME = Frame(CRS, ORIGIN)
NEIGHBOUR = "EPSG:32735"
POINTS = np.random.default_rng(0).uniform(-300, 300, (50, 2))


def write(path, transform, crs=CRS, **more):
    write_json(path, {"crs": crs, "transform": {"matrix": transform.about(-np.array(ORIGIN)).matrix.tolist(), **more}})
    return path


MOTIONS = {
    Model.RIGID: Rigid.turn(30, shift=(12.5, -3)),
    Model.SIMILARITY: Similarity(1.02 * Rigid.turn(-170).linear, (4, 5)),
    Model.AFFINE: Affine([[1, 0.01], [0.02, 0.98]], (1, 2)),
}


@pytest.mark.parametrize("model", Model)
@pytest.mark.parametrize("told", [True, False])
def test_kind_and_motion_come_back(tmp_path, model, told):
    path = write(tmp_path / "registration.json", MOTIONS[model], **({"model": model.value} if told else {}))
    found = read_transform(path, FRAME)
    assert type(found) is model.kind
    np.testing.assert_allclose(found(POINTS), MOTIONS[model](POINTS), atol=1e-6)


def test_a_wider_model_keeps_its_kind(tmp_path):
    path = write(tmp_path / "t.json", MOTIONS[Model.RIGID], model="affine")
    assert type(read_transform(path, FRAME)) is Affine


def test_a_bare_matrix_and_other_members_are_taken(tmp_path):
    matrix = MOTIONS[Model.RIGID].about(-np.array(ORIGIN)).matrix.tolist()
    (tmp_path / "truth.json").write_text(json.dumps({"crs": CRS, "transform": matrix, "trees": []}))
    np.testing.assert_allclose(
        read_transform(tmp_path / "truth.json", FRAME)(POINTS), MOTIONS[Model.RIGID](POINTS), atol=1e-6
    )


@settings(max_examples=40, deadline=None)
@given(
    angle=st.floats(-180, 180),
    shift=st.tuples(st.floats(-200, 200), st.floats(-200, 200)),
    model=st.sampled_from(list(Model)),
    crs=st.sampled_from([NEIGHBOUR, "EPSG:32733"]),
)
def test_a_transform_in_another_crs_moves_the_same_ground(tmp_path_factory, angle, shift, model, crs):
    """Full circle: a motion of the frame, fitted in another CRS, written there, read back into the frame."""
    truth = MOTIONS[model] @ Rigid.turn(angle, shift=shift)
    there = converter(CRS, crs)
    source, reference = there(POINTS + ORIGIN), there(truth(POINTS) + ORIGIN)
    centre = source.mean(axis=0)
    fitted = model.fit(source - centre, reference - centre).about(-centre)
    path = tmp_path_factory.mktemp("t") / "registration.json"
    write_json(path, {"crs": crs, "transform": {"model": model.value, "matrix": fitted.matrix.tolist()}})
    found = read_transform(path, FRAME)
    assert type(found) is model.kind
    np.testing.assert_allclose(found(POINTS), truth(POINTS), atol=0.005)


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([1], ["holds no transform", "registration.json"]),
        ({"crs": CRS}, ["holds no transform"]),
        ({"crs": CRS, "verdict": "failed", "transform": None}, ["failed", "another"]),
        ({"crs": CRS, "transform": {}}, ["no usable matrix"]),
        ({"crs": CRS, "transform": {"matrix": [[1, 0], [0, 1]]}}, ["no usable matrix", "3x3"]),
        ({"crs": CRS, "transform": {"matrix": [["a"] * 3] * 3}}, ["no usable matrix"]),
        ({"crs": CRS, "transform": {"matrix": [[1, 0, 0], [0, 1], [0]]}}, ["no usable matrix"]),
        ({"crs": CRS, "transform": {"matrix": [[0, 0, 0], [0, 0, 0], [0, 0, 1]]}}, ["no usable matrix"]),
        ({"crs": CRS, "transform": {"matrix": [[math.nan, 0, 0], [0, 1, 0], [0, 0, 1]]}}, ["no usable matrix"]),
        ({"crs": CRS, "transform": {"matrix": np.eye(3).tolist(), "model": "tps"}}, ["'tps'", "rigid"]),
        ({"crs": CRS, "transform": {"matrix": np.eye(3).tolist(), "model": [1]}}, ["[1]", "rigid"]),
        ({"crs": CRS, "transform": {"matrix": np.diag([2, 2, 1]).tolist(), "model": "rigid"}}, ["rigid", "correct"]),
        ({"transform": {"matrix": np.eye(3).tolist()}}, ["CRS", "EPSG:32734"]),
        ({"crs": "EPSG:0", "transform": {"matrix": np.eye(3).tolist()}}, ["unknown CRS"]),
        ({"crs": "+proj=gnom +lat_0=33 +lon_0=-160", "transform": {"matrix": np.eye(3).tolist()}}, ["does not reach"]),
    ],
)
def test_files_without_a_usable_transform(tmp_path, document, words):
    (tmp_path / "t.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        read_transform(tmp_path / "t.json", FRAME)
    for word in ["t.json", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize("content", [None, "", "{", "[" * 100_000])
def test_files_that_are_no_json(tmp_path, content):
    if content is not None:
        (tmp_path / "t.json").write_text(content)
    with pytest.raises(InputError, match=r"t\.json"):
        read_transform(tmp_path / "t.json", FRAME)


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:5773", "EPSG:4978"])
def test_a_crs_without_eastings_is_refused(tmp_path, crs):
    path = write(tmp_path / "registration.json", Rigid.identity(), crs)
    with pytest.raises(InputError, match="which is not projected"):
        read_transform(path, FRAME)


def test_a_number_beyond_all_floats_is_refused(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps({"crs": CRS, "transform": {"matrix": [[1, 0, 10**400], [0, 1, 0], [0, 0, 1]]}}))
    with pytest.raises(InputError, match="no usable matrix"):
        read_transform(path, FRAME)
