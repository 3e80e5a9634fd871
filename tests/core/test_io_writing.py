"""The files that a registration gives."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime

import numpy as np
import pyproj
import pytest
from io_files import CRS, ORIGIN, feature, grid, lonlat, polygon, square, survey, table, trees

from treereg_core.errors import InputError
from treereg_core.io import read_survey, read_surveys, write_json, write_matches, write_registered
from treereg_core.judgement import Matches
from treereg_core.survey import Frame
from treereg_core.transform import Affine, Rigid

FRAME = Frame(CRS, ORIGIN)
MOTION = Rigid.turn(20, shift=(7, -4))


def registered(folder, transform=MOTION, **options):
    """The document that `write_registered` makes of a survey, as strict JSON."""
    found = read_survey(folder, frame=FRAME, **options)
    path = folder.parent / "detections_registered.geojson"
    write_registered(found, transform, path)

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def ring_of(moved):
    return np.array(moved["geometry"]["coordinates"][0])


def test_features_move_where_the_transform_says(tmp_path):
    document = registered(survey(tmp_path / "s"))
    assert set(document) == {"type", "features"}
    for before, after in zip(trees(), document["features"], strict=True):
        full = np.column_stack(
            pyproj.Transformer.from_crs("OGC:CRS84", CRS, always_xy=True).transform(*ring_of(before).T)
        )
        expected = lonlat(MOTION(full - ORIGIN) + ORIGIN)
        np.testing.assert_allclose(ring_of(after), expected, atol=6e-10, rtol=0)
        assert np.abs(np.round(ring_of(after), 9) - ring_of(after)).max() == 0


def test_the_identity_changes_nothing_beyond_rounding(tmp_path):
    for before, after in zip(trees(), registered(survey(tmp_path / "s"), Rigid.identity())["features"], strict=True):
        np.testing.assert_allclose(ring_of(after), ring_of(before), atol=6e-10, rtol=0)


def test_registered_features_read_back_as_the_moved_trees(tmp_path):
    before = read_survey(survey(tmp_path / "s"), frame=FRAME)
    write_registered(before, MOTION, tmp_path / "raw-detections.geojson")
    after = read_survey(tmp_path, frame=FRAME)
    np.testing.assert_allclose(after.features.xy, MOTION(before.features.xy), atol=2e-4)


PROPERTIES = {
    "confidence": 0.5,
    "nested": {"a": [1, {"b": None}], "bbox": [1, 2, 3, 4]},
    "unicode": "Plåt 3 — 果樹園 \u202e <script>alert('&amp;')</script>",
    "half a surrogate": "\ud800",
    "big": 2**80 + 1,
    "float": 0.1,
    "none": None,
    "": True,
    "crs": "EPSG:1",
}


def test_properties_ids_and_order_are_kept_and_every_feature_written(tmp_path):
    features = trees()
    features[0] |= {"properties": PROPERTIES, "id": "a/b<c>", "bbox": [1, 2, 3, 4], "foreign": {"x": [1]}}
    features[1] |= {"geometry": None, "id": 10**30}
    features[2] |= {"geometry": features[3]["geometry"], "id": 7}
    features[4] |= {"geometry": {"type": "Polygon", "coordinates": []}, "id": 7}
    line = features[5]["geometry"]["coordinates"][0][:2]
    features[5] |= {"geometry": polygon([*line, *line[::-1]])}
    features[6] |= {"geometry": {"type": "GeometryCollection", "geometries": [features[6]["geometry"]]}}
    document = registered(survey(tmp_path / "s", features, name="raw-detections.geojson", about={"by": "<me>"}))
    assert document["about"] == {"by": "<me>"}
    after = document["features"]
    assert [f["properties"] for f in after] == [f["properties"] for f in features]
    assert [f.get("id") for f in after] == [f.get("id") for f in features]
    assert after[0]["foreign"] == {"x": [1]}
    assert "bbox" not in after[0]
    assert [f["geometry"] and f["geometry"]["type"] for f in after] == [
        f["geometry"] and f["geometry"]["type"] for f in features
    ]
    assert after[4]["geometry"]["coordinates"] == []
    assert np.abs(ring_of(after[5]) - ring_of(features[5])).max() > 1e-6
    assert after[6]["geometry"]["geometries"][0] != features[6]["geometry"]["geometries"][0]


def test_nan_in_a_property_becomes_null(tmp_path):
    features = trees()
    features[0]["properties"] |= {"height": math.nan, "list": [math.inf, 1, "NaN"]}
    after = registered(survey(tmp_path / "s", features))["features"][0]["properties"]
    assert after == {"confidence": 0.5, "height": None, "list": [None, 1, "NaN"]}


def test_a_third_dimension_and_holes_are_kept(tmp_path):
    ring, hole = ([[*p, 701.25] for p in square((0, 0), side)] for side in (4, 2))
    features = [feature({"type": "MultiPolygon", "coordinates": [[ring, hole]]}, confidence=0.5), *trees(grid() + 20)]
    after = registered(survey(tmp_path / "s", features))["features"][0]["geometry"]["coordinates"]
    assert [[p[2] for p in r] for r in after[0]] == [[701.25] * 5] * 2


def test_an_input_in_another_crs_is_written_in_wgs84_without_crs(tmp_path):
    convert = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32735", always_xy=True)
    features = trees()
    for f in features:
        f["geometry"]["coordinates"] = [np.column_stack(convert.transform(*ring_of(f).T)).tolist()]
    member = {"type": "name", "properties": {"name": "EPSG:32735"}}
    document = registered(survey(tmp_path / "a", features, crs=member))
    assert "crs" not in document
    (tmp_path / "b").mkdir()
    expected = registered(survey(tmp_path / "b" / "s"))
    for one, other in zip(document["features"], expected["features"], strict=True):
        np.testing.assert_allclose(ring_of(one), ring_of(other), atol=2e-9, rtol=0)


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_tables_give_the_same_features(tmp_path, suffix):
    when = [datetime(2024, 8, 1, 12, tzinfo=UTC)] * 12
    folder = table(
        tmp_path / "s",
        suffix,
        "EPSG:32735",
        confidence=[0.5] * 12,
        big=[2**62 + 1] * 12,
        name=["<b>å</b>", None] * 6,
        height=[math.nan, 2.5] * 6,
        when=when,
        flag=[True] * 12,
    )
    after = registered(folder)["features"]
    assert len(after) == 12
    for i, moved in enumerate(after):
        properties = moved["properties"]
        assert datetime.fromisoformat(properties.pop("when")) == when[i]
        assert properties == {
            "confidence": 0.5,
            "big": 2**62 + 1,
            "name": ["<b>å</b>", None][i % 2],
            "height": [None, 2.5][i % 2],
            "flag": True,
        }
    expected = registered(survey(tmp_path / "t"))["features"]
    for one, other in zip(after, expected, strict=True):
        np.testing.assert_allclose(ring_of(one), ring_of(other), atol=2e-9, rtol=0)


def test_a_nested_parquet_column_stays_nested(tmp_path):
    folder = table(tmp_path / "s", "parquet", confidence=[0.5] * 12, box=[{"a": [1, 2], "b": None}] * 12)
    assert registered(folder)["features"][3]["properties"]["box"] == {"a": [1, 2], "b": None}


def test_a_field_across_the_antimeridian_stays_whole(tmp_path):
    x, y = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32760", always_xy=True).transform(180, -17)
    folder = survey(tmp_path / "s", trees(crs="EPSG:32760", origin=(x - 5, y)))
    found = read_survey(folder)
    path = tmp_path / "t" / "raw-detections.geojson"
    path.parent.mkdir()
    write_registered(found, Rigid.identity(), path)
    for f in json.loads(path.read_text())["features"]:
        assert np.ptp(ring_of(f)[:, 0]) < 1e-4
    again = read_survey(path.parent, frame=found.frame)
    np.testing.assert_allclose(again.features.xy, found.features.xy, atol=1e-3)


def test_matches_run_from_the_moved_source_to_the_reference(tmp_path):
    features = [feature(None, confidence=0.5), *trees()]
    reference, source = read_surveys(survey(tmp_path / "r"), survey(tmp_path / "s", features))
    matches = Matches(np.array([[0, 1], [5, 6], [11, 2]]), np.array([0.1, 0.25, 3]))
    write_matches((reference, source), MOTION, matches, tmp_path / "tree_matches.geojson")
    document = json.loads((tmp_path / "tree_matches.geojson").read_text())
    assert [f["properties"] for f in document["features"]] == [
        {"reference": 0, "source": 1, "residual_m": 0.1},
        {"reference": 5, "source": 6, "residual_m": 0.25},
        {"reference": 11, "source": 2, "residual_m": 3.0},
    ]
    origin = np.array(reference.frame.origin)
    at = grid() + ORIGIN - origin
    for f, (i, j) in zip(document["features"], matches.pairs, strict=True):
        assert f["geometry"]["type"] == "LineString"
        expected = lonlat(np.vstack([MOTION(at[[j - 1]]), at[[i]]]) + origin)
        np.testing.assert_allclose(f["geometry"]["coordinates"], expected, atol=2e-9, rtol=0)


def test_no_matches_and_unknown_ids(tmp_path):
    found = read_survey(survey(tmp_path / "s"))
    path = tmp_path / "tree_matches.geojson"
    write_matches((found, found), MOTION, Matches(np.empty((0, 2)), np.empty(0)), path)
    assert json.loads(path.read_text()) == {"type": "FeatureCollection", "features": []}
    with pytest.raises(ValueError, match="not in its survey"):
        write_matches((found, found), MOTION, Matches(np.array([[0, 12]]), np.zeros(1)), path)


def test_json_is_readable_and_exact(tmp_path):
    value = {
        "matrix": np.eye(3).tolist(),
        "far": [[0.1 + 0.2, -1e-17, 6_200_000.123456789]] * 3,
        "text": "å<b>" * 40,
        "none": None,
        "empty": [{}, []],
        "records": [{"a": 1, "b": [2]}] * 9,
    }
    write_json(tmp_path / "x.json", value)
    text = (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json.loads(text) == value
    assert '  "matrix": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],\n' in text
    assert "    [0.30000000000000004, -1e-17, 6200000.123456789]" in text
    assert '    {"a": 1, "b": [2]},\n' in text


@pytest.mark.parametrize("value", [math.nan, [math.inf], {"a": -math.inf}])
def test_json_has_no_nan_and_leaves_nothing(tmp_path, value):
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "x.json", value)
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_complete_or_absent(tmp_path):
    write_json(tmp_path / "x.json", "old")
    with pytest.raises(TypeError):
        write_json(tmp_path / "x.json", {"a": object()})
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]
    assert (tmp_path / "x.json").read_text() == '"old"\n'


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "nowhere" / "x.json", tmp_path / "file" / "x.json"):
        with pytest.raises(InputError, match="cannot be written"):
            write_json(path, 1)


def test_what_is_known_of_trees_is_a_property_of_every_feature(tmp_path):
    features = trees()
    features[0]["properties"] |= {"health": "as it was", "name": "a"}
    features[1]["geometry"] = None
    features[2]["properties"] = {"confidence": 0.5, "health": {"nested": 1}}
    found = read_survey(survey(tmp_path / "s", features), frame=FRAME)
    path = tmp_path / "detections_registered.geojson"
    values = np.arange(len(found.features)) + 1 / 3
    write_registered(found, MOTION, path, {"health": values, "reach": -1e308 * np.ones(len(values))})
    after = [f["properties"] for f in json.loads(path.read_text())["features"]]
    assert after[0] == {"confidence": 0.5, "health": 0.333333, "name": "a", "reach": -1e308}
    assert after[1] == {"confidence": 0.5, "health": None, "reach": None}
    assert [p["health"] for p in after[2:]] == [round(i + 1 / 3, 6) for i in range(1, 11)]


def test_features_without_properties_get_what_is_known(tmp_path):
    features = [{**f, "properties": None} for f in trees()]
    found = read_survey(survey(tmp_path / "s", features), frame=FRAME)
    path = tmp_path / "detections_registered.geojson"
    write_registered(found, MOTION, path, {"health": np.ones(12)})
    assert [f["properties"] for f in json.loads(path.read_text())["features"]] == [{"health": 1.0}] * 12
    write_registered(found, MOTION, path)
    assert [f["properties"] for f in json.loads(path.read_text())["features"]] == [None] * 12


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_rows_of_a_table_get_what_is_known_too(tmp_path, suffix):
    folder = table(tmp_path / "s", suffix, confidence=[0.5] * 12, health=["as it was"] * 12)
    found = read_survey(folder, frame=FRAME)
    path = tmp_path / "detections_registered.geojson"
    write_registered(found, MOTION, path, {"health": np.arange(12.0)})
    after = [f["properties"] for f in json.loads(path.read_text())["features"]]
    assert after == [{"confidence": 0.5, "health": float(i)} for i in range(12)]


def test_matches_say_what_is_known_of_both_trees(tmp_path):
    features = [feature(None, confidence=0.5), *trees()]
    reference, source = read_surveys(survey(tmp_path / "r"), survey(tmp_path / "s", features))
    matches = Matches(np.array([[0, 1], [5, 6]]), np.array([0.1, 0.25]))
    described = {"health": np.arange(12) / 3}, {"health": np.arange(12.0), "age": np.ones(12)}
    write_matches((reference, source), MOTION, matches, tmp_path / "tree_matches.geojson", described)
    assert [f["properties"] for f in json.loads((tmp_path / "tree_matches.geojson").read_text())["features"]] == [
        {
            "reference": i,
            "source": j,
            "residual_m": residual,
            "reference_health": health,
            "source_health": float(j - 1),
            "source_age": 1.0,
        }
        for i, j, residual, health in [(0, 1, 0.1, 0.0), (5, 6, 0.25, 1.666667)]
    ]


def test_an_affine_transform_is_applied_in_full(tmp_path):
    shear = Affine([[1, 0.1], [0, 1]], (0, 0))
    after = registered(survey(tmp_path / "s"), shear)["features"]
    full = np.column_stack(
        pyproj.Transformer.from_crs("OGC:CRS84", CRS, always_xy=True).transform(*ring_of(after[11]).T)
    )
    np.testing.assert_allclose((full - ORIGIN)[:4].mean(axis=0), shear(grid()[[11]])[0], atol=3e-4)
