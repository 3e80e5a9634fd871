"""GeoJSON read some features at a time: nothing is different, except the memory."""

from __future__ import annotations

import json
import tracemalloc
from contextlib import nullcontext

import numpy as np
import pyproj
import pytest
import shapely
from io_files import CRS, ORIGIN, collection, feature, grid, polygon, raw, square, survey, table, trees

from treereg_core import parts
from treereg_core.errors import InputError
from treereg_core.io import (
    Motion,
    holds_geojson,
    json_pieces,
    move_vector,
    read_survey,
    write_registered,
)
from treereg_core.io.layer import read_layer
from treereg_core.survey import Frame
from treereg_core.transform import Rigid

FRAME = Frame(CRS, ORIGIN)
MOTION = Rigid.turn(20, shift=(7, -4))


def in_small_pieces(monkeypatch, size):
    monkeypatch.setattr(json_pieces, "PIECE", size)
    monkeypatch.setattr(json_pieces, "ENOUGH", size)
    monkeypatch.setattr(parts, "PART", 2)


def some():
    """Features of every kind."""
    features = [*trees(), *trees(grid() + 40)]
    features[1]["geometry"] = {"type": "MultiPolygon", "coordinates": [[square((40, 0))], [square((45, 0))]]}
    features[2]["geometry"] = None
    features[3]["properties"] |= {"name": 'Plåt 3 — 果樹園 🌳 "\\', "deep": {"features": [[1, -2.5e-7], None, True]}}
    features[4]["geometry"] = {"type": "GeometryCollection", "geometries": [polygon(square((50, 0)))]}
    features[5]["geometry"]["coordinates"][0].pop()
    features[6]["geometry"]["coordinates"] = []
    return features


def documents():
    """The same features, written in different ways."""
    document = collection(some(), crs={"type": "name", "properties": {"name": "OGC:CRS84"}}, x={"features": [1]}, n=12)
    turned = dict(reversed(document.items()))
    return {
        "plain": json.dumps(document),
        "indented": json.dumps(document, indent=3),
        "features first": json.dumps(turned),
        "other signs": json.dumps(document, ensure_ascii=False),
        "UTF-16": json.dumps(document, ensure_ascii=False).encode("utf-16"),
        "a mark at the beginning": json.dumps(document).encode("utf-8-sig"),
        "features twice": json.dumps(document).replace('"features": [{', '"features": [7], "features": [{'),
        "members twice": json.dumps(document).replace('"x":', '"x": 5, "x":'),
        "a feature": json.dumps({**some()[0], "features": some()}),
        "a geometry": json.dumps({**some()[1]["geometry"], "features": some()}),
    }


@pytest.mark.parametrize("size", [1, 7, 100, 3_000])
@pytest.mark.parametrize("name", documents())
def test_what_is_read_and_moved_does_not_depend_on_the_pieces(tmp_path, monkeypatch, name, size):
    path = raw(tmp_path, documents()[name]) / "raw-detections.geojson"
    found = []
    for folder in (tmp_path / "whole", tmp_path / "pieces"):
        folder.mkdir()
        layer = read_layer(path, "confidence")
        move_vector(path, Motion(CRS, MOTION), folder)
        moved = (folder / path.name).read_bytes()
        found.append((shapely.to_wkb(layer.geometry).tolist(), layer.values, layer.crs, moved, holds_geojson(path)))
        in_small_pieces(monkeypatch, size)
    assert found[0] == found[1]
    assert len(found[0][0]) == (1 if name in ("a feature", "a geometry") else 24)


@pytest.mark.parametrize("size", [1, 100])
@pytest.mark.parametrize("kind", ["geojson", "gpkg", "parquet"])
def test_what_is_registered_does_not_depend_on_the_pieces(tmp_path, monkeypatch, kind, size):
    folder = survey(tmp_path / "s", some(), n=12) if kind == "geojson" else table(tmp_path / "s", kind)
    found = read_survey(folder, frame=FRAME)
    known = {"a": np.arange(len(found.features)) / 3}
    write_registered(found, MOTION, tmp_path / "whole", known)
    in_small_pieces(monkeypatch, size)
    write_registered(found, MOTION, tmp_path / "pieces", known)
    assert (tmp_path / "pieces").read_bytes() == (tmp_path / "whole").read_bytes()


def test_the_survey_does_not_depend_on_the_pieces(tmp_path, monkeypatch):
    features = some()
    features[7]["geometry"]["coordinates"].append(square(grid()[7], 1))
    features[8]["geometry"]["coordinates"][0].reverse()
    folder = survey(tmp_path / "s", [*features, features[9]])
    whole = read_survey(folder)
    monkeypatch.setattr(parts, "PART", 3)
    found = read_survey(folder)
    assert (found.digest, found.warnings, found.count) == (whole.digest, whole.warnings, whole.count)
    for name in ("xy", "ring", "tree"):
        np.testing.assert_array_equal(getattr(found.outlines, name), getattr(whole.outlines, name))
    for name in ("ids", "xy", "area"):
        np.testing.assert_array_equal(getattr(found.features, name), getattr(whole.features, name))


def test_all_longitudes_run_on_to_the_same_side(tmp_path, monkeypatch):
    x, y = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32760", always_xy=True).transform(180, -17)
    found = read_survey(survey(tmp_path / "s", trees(crs="EPSG:32760", origin=(x - 5, y))))
    in_small_pieces(monkeypatch, 1)
    write_registered(found, Rigid.identity(), tmp_path / "moved")
    features = json.loads((tmp_path / "moved").read_text())["features"]
    assert np.ptp([f["geometry"]["coordinates"][0][0][0] for f in features]) < 1


def faults():
    """Documents with several faults each, and what is said of the first."""
    broken, no_number, crs = some(), some(), {"crs": 7}
    no_number[3]["geometry"] = polygon([[0, 0], ["a", 3], [1, 1], [0, 0]])
    broken[3], broken[17] = no_number[3], 5
    return {
        "is not JSON": json.dumps(collection(broken)).encode()[:-3],
        "UTF-8 (byte": json.dumps(collection(broken)).encode() + b"\xe9",
        "value that cannot be read": json.dumps(collection(broken)).encode()[:-1] + b', "a": ' + b"9" * 5000 + b"}",
        "the type 'Topology'": json.dumps({"features": broken, "type": "Topology"}),
        "not GeoJSON;": json.dumps({"features": broken}),
        "item 17 ": json.dumps(collection(broken, **crs)),
        "feature 3 ": json.dumps(collection(no_number, **crs)),
        "'crs' member": json.dumps(collection(some(), **crs)),
        "Extra data": json.dumps(collection(broken)) + "]",
        "Expecting ',' delimiter": json.dumps(collection(broken)).replace('}, {"type"', '} {"type"', 1),
    }


@pytest.mark.parametrize("size", [1, 100, 10**6])
@pytest.mark.parametrize("words", faults())
def test_the_first_fault_is_named_as_of_the_whole_file(tmp_path, monkeypatch, words, size):
    in_small_pieces(monkeypatch, size)
    path = raw(tmp_path / "s", faults()[words]) / "raw-detections.geojson"
    with pytest.raises(InputError) as caught:
        read_layer(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


def ring(centre):
    """A crown of 20 corners."""
    turn = np.arange(21) / 20 * 2 * np.pi
    return (np.array([19.32, -33.37]) + 1e-5 * np.column_stack([np.cos(turn), np.sin(turn)]) + centre).tolist()


@pytest.mark.parametrize("how", ["read", "cut off", "moved", "registered"])
def test_memory_is_a_small_multiple_of_the_file(tmp_path, monkeypatch, how):
    in_small_pieces(monkeypatch, 2**14)
    centres = np.random.default_rng(0).random((3_000, 2)) * 1e-3
    features = [feature(polygon(ring(centre)), confidence=0.5) for centre in centres]
    path = survey(tmp_path / "s", features) / "raw-detections.geojson"
    found = read_survey(path.parent)
    if how == "cut off":
        path.write_bytes(path.read_bytes()[:-9])
    uses = {
        "moved": lambda: move_vector(path, Motion(CRS, MOTION), tmp_path),
        "registered": lambda: write_registered(found, MOTION, tmp_path / "moved"),
    }
    del features
    tracemalloc.start()
    with pytest.raises(InputError, match="is cut off") if how == "cut off" else nullcontext():
        uses.get(how, lambda: read_layer(path))()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.5 * path.stat().st_size
