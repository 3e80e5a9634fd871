"""Each bad input gets one sentence that names the file, the place and the mend."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from io_files import ORIGIN, collection, feature, grid, polygon, raw, square, survey, table, trees

from treereg_core.errors import InputError
from treereg_core.io import read_survey, read_surveys


def refusal(folder, *words, **options):
    """The one sentence with which a survey is refused; it must hold these words."""
    with pytest.raises(InputError) as caught:
        read_survey(folder, **options)
    return one_sentence(str(caught.value), folder.name, *words)


def one_sentence(text, *words):
    assert "\n" not in text
    assert text.endswith(".")
    for word in words:
        assert word in text
    return text


def with_(index, **changes):
    """The usual trees with one feature changed."""
    features = trees()
    features[index] = {**features[index], **changes}
    return features


def test_missing_folder(tmp_path):
    refusal(tmp_path / "nowhere", "no such folder", "check the path")


def test_empty_folder(tmp_path):
    refusal(tmp_path, "empty", "raw-detections.geojson")


def test_folder_without_detections_says_what_it_holds(tmp_path):
    refusal(raw(tmp_path / "s", "{}", "detections.geojson"), "it holds detections.geojson", "raw-detections.geojson")


def test_file_instead_of_folder(tmp_path):
    folder = survey(tmp_path / "s")
    refusal(folder / "raw-detections.geojson", "is a file", "folder")


def test_folder_instead_of_file(tmp_path):
    (tmp_path / "s" / "raw-detections.geojson").mkdir(parents=True)
    refusal(tmp_path / "s", "raw-detections.geojson", "cannot be read")


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    folder = survey(tmp_path / "s")

    def refuse(path, *_, **__):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", refuse)
    refusal(folder, "raw-detections.geojson", "permission denied", "check")


@pytest.mark.parametrize("other", ["raw_detections.geojson", "detections_raw.gpkg", "raw-detections.parquet"])
def test_two_candidates_are_both_named(tmp_path, other):
    folder = survey(tmp_path / "s")
    (folder / other).write_text("{}")
    refusal(folder, "raw-detections.geojson", other, "remove")


def test_two_rasters_of_one_role(tmp_path):
    folder = survey(tmp_path / "s")
    for name in ("visible_10cm.tif", "visible_5cm.tif"):
        (folder / name).write_bytes(b"")
    refusal(folder, "visible_10cm.tif", "visible_5cm.tif")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["is empty"]),
        ("  \n", ["is empty"]),
        ("<kml></kml>", ["not JSON"]),
        (json.dumps(collection(trees()))[:-200], ["cut off", "export it again"]),
        ("[1, 2]", ["not GeoJSON"]),
        ('{"a": 1}', ["not GeoJSON"]),
        ('{"type": "Topology", "objects": {}}', ["not GeoJSON", "Topology"]),
        ('{"type": "FeatureCollection"}', ["no list of features"]),
        ('{"type": "FeatureCollection", "features": [3]}', ["item 0", "not a GeoJSON Feature"]),
        ('{"type": "FeatureCollection", "features": []}', ["no features"]),
        (b"\xff\xfe\x00\x01\x02", ["raw-detections.geojson"]),
        (b'{"type": "\xe9"}', ["UTF-8"]),
        ('{"a": ' + "9" * 5000 + "}", ["cannot be read"]),
        ("[" * 200_000, ["nested too deeply"]),
        ('{"type": "FeatureCollection", "features": ' + "[" * 100_000 + "]" * 100_000 + "}", ["nested too deeply"]),
    ],
)
def test_content_that_is_no_geojson(tmp_path, content, words):
    refusal(raw(tmp_path / "s", content), "raw-detections.geojson", *words)


@pytest.mark.parametrize(
    "geometry",
    [
        {"type": "Point", "coordinates": [19.3, -33.3]},
        {"type": "LineString", "coordinates": [[19.3, -33.3], [19.4, -33.3]]},
        {"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [19.3, -33.3]}]},
    ],
)
def test_points_or_lines_instead_of_polygons(tmp_path, geometry):
    folder = survey(tmp_path / "s", with_(2, geometry=geometry))
    refusal(folder, "feature 2", geometry["type"], "Polygon", "raw-detections.geojson")


@pytest.mark.parametrize(
    "geometry",
    [
        "POLYGON",
        {"type": "Circle", "coordinates": [1, 2]},
        {"type": "Polygon"},
        {"type": ["Polygon"], "coordinates": []},
        {"type": "GeometryCollection", "geometries": [7]},
    ],
)
def test_broken_geometry_names_the_feature(tmp_path, geometry):
    refusal(survey(tmp_path / "s", with_(4, geometry=geometry)), "feature 4", "not GeoJSON", "mend")


def nested_collections(depth):
    geometry = polygon(square((0, 0)))
    for _ in range(depth):
        geometry = {"type": "GeometryCollection", "geometries": [geometry]}
    return geometry


def test_a_tangle_of_an_outline_is_refused_at_once(tmp_path):
    ring = (np.array(square((0, 0))[0]) + 1e-4 * np.random.default_rng(0).random((6_000, 2))).tolist()
    refusal(survey(tmp_path / "s", with_(6, geometry=polygon(ring))), "feature 6", "invalid outline", "simplify")


def test_a_deeply_nested_property_does_no_harm(tmp_path):
    features = with_(0, properties={"confidence": 0.5, "deep": json.loads("[" * 800 + "]" * 800)})
    assert len(read_survey(survey(tmp_path / "s", features)).features) == 12


def test_deeply_nested_geometry_is_read_or_refused(tmp_path):
    folder = survey(tmp_path / "s", with_(1, geometry=nested_collections(150)))
    try:
        assert len(read_survey(folder).features) == 12
    except InputError as error:
        one_sentence(str(error), "raw-detections.geojson")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None, "19.3", True, [19.3], 10**400])
def test_coordinates_that_are_no_numbers(tmp_path, value):
    features = trees()
    features[3]["geometry"]["coordinates"][0][1] = [value, -33.3]
    refusal(survey(tmp_path / "s", features), "feature 3", "not finite numbers", "mend")


@pytest.mark.parametrize(
    "ring", [[[1], [2], [3], [1]], [5, 6, 7, 8], [{}, {}, {}], "abcd", [[]] * 4, [7], [[1, 2], ["a", 3]]]
)
def test_positions_that_are_none(tmp_path, ring):
    refusal(survey(tmp_path / "s", with_(3, geometry=polygon(ring))), "feature 3", "mend")


def test_nan_in_a_table(tmp_path):
    import geopandas
    import shapely

    shapes = [shapely.Polygon(f["geometry"]["coordinates"][0]) for f in trees()]
    shapes[2] = shapely.transform(shapes[2], lambda xy: np.where(xy == xy[1], np.nan, xy))
    (tmp_path / "s").mkdir()
    geopandas.GeoDataFrame(geometry=shapes, crs=4326).to_parquet(tmp_path / "s" / "raw-detections.parquet")
    refusal(tmp_path / "s", "feature 2", "not finite", "raw-detections.parquet")


@pytest.mark.parametrize("lon", [200.0, -500.0])
def test_longitude_out_of_range(tmp_path, lon):
    ring = [[lon, -33.0], [lon + 1e-5, -33.0], [lon, -33.00001], [lon, -33.0]]
    refusal(survey(tmp_path / "s", with_(5, geometry=polygon(ring))), "feature 5", "out of range", "correct")


def swapped(features):
    for f in features:
        f["geometry"]["coordinates"] = [[p[::-1] for p in ring] for ring in f["geometry"]["coordinates"]]
    return features


def test_swapped_axes_with_a_latitude_out_of_range(tmp_path):
    alaska = trees(crs="EPSG:32606", origin=(400_000, 6_800_000))
    refusal(survey(tmp_path / "s", swapped(alaska)), "swapped", "write longitude first", "feature 0")


def test_swapped_axes_in_a_pair(tmp_path):
    reference, source = survey(tmp_path / "ref"), survey(tmp_path / "src", swapped(trees()))
    with pytest.raises(InputError) as caught:
        read_surveys(reference, source)
    one_sentence(str(caught.value), str(reference / "raw"), str(source / "raw"), "swapped", "write longitude first")


def test_swapped_axes_against_the_boundary(tmp_path):
    folder = survey(tmp_path / "s", swapped(trees()))
    survey(folder, [feature(polygon(square((5, 5), side=40)))], "boundary.geojson")
    refusal(folder, "swapped", "boundary.geojson", "raw-detections.geojson")


def test_swapped_easting_and_northing(tmp_path):
    features = trees()
    for f, point in zip(features, grid(), strict=True):
        f["geometry"] = polygon([[y + ORIGIN[1], x + ORIGIN[0]] for x, y in point + np.array([[0, 0], [1, 0], [1, 1]])])
    folder = survey(tmp_path / "s", features, crs={"type": "name", "properties": {"name": "EPSG:32734"}})
    refusal(folder, "EPSG:32734", "easting and northing", "swapped")


def projected():
    return [feature(polygon([(c + ORIGIN).tolist() for c in p + np.array([[0, 0], [1, 0], [1, 1]])])) for p in grid()]


def test_projected_coordinates_without_crs(tmp_path):
    refusal(survey(tmp_path / "s", projected()), "feature 0", "projected", "CRS")


def test_degrees_tagged_as_projected(tmp_path):
    folder = survey(tmp_path / "s", crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32734"}})
    refusal(folder, "EPSG:32734", "degrees", "EPSG:4326")


def test_projected_crs_of_another_continent(tmp_path):
    folder = survey(tmp_path / "s", projected(), crs={"type": "name", "properties": {"name": "EPSG:27700"}})
    refusal(folder, "EPSG:27700", "outside", "correct the CRS")


@pytest.mark.parametrize("name", ["EPSG:999999", "nonsense", "urn:ogc:def:crs:EPSG::0"])
def test_unknown_crs(tmp_path, name):
    folder = survey(tmp_path / "s", crs={"type": "name", "properties": {"name": name}})
    refusal(folder, "unknown CRS", name, "EPSG:32734")


@pytest.mark.parametrize("crs", [{"type": "link", "properties": {"href": "http://x"}}, "EPSG:4326", 7])
def test_crs_member_that_names_none(tmp_path, crs):
    refusal(survey(tmp_path / "s", crs=crs), "'crs' member", "raw-detections.geojson")


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_table_without_crs_that_cannot_be_degrees(tmp_path, suffix):
    import geopandas
    import pyogrio
    import shapely

    frame = geopandas.GeoDataFrame(geometry=[shapely.box(*ORIGIN, ORIGIN[0] + i, ORIGIN[1] + 1) for i in (1, 2, 3)])
    if suffix == "gpkg":
        with pytest.warns(UserWarning, match="crs"):
            pyogrio.write_dataframe(frame, tmp_path / "raw-detections.gpkg")
    else:
        frame.to_parquet(tmp_path / "raw-detections.parquet")
    refusal(tmp_path, "has no CRS", "assign its CRS", suffix)


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_damaged_tables(tmp_path, suffix):
    name = f"raw-detections.{suffix}"
    refusal(raw(tmp_path / "a", "not a table", name), name, "export it again")
    whole = (table(tmp_path / "b", suffix) / name).read_bytes()
    refusal(raw(tmp_path / "c", whole[: len(whole) // 3], name), name, "export it again")


def test_parquet_without_geometry(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({"x": [1]}), tmp_path / "raw-detections.parquet")
    refusal(tmp_path, "GeoParquet")


def test_geopackage_with_two_layers(tmp_path):
    import geopandas
    import pyogrio

    folder = table(tmp_path / "s", "gpkg")
    path = folder / "raw-detections.gpkg"
    pyogrio.write_dataframe(geopandas.read_file(path), path, layer="other")
    refusal(folder, "raw-detections, other", "exactly one layer")


def test_surveys_in_different_places(tmp_path):
    reference = survey(tmp_path / "ref")
    for k, origin in enumerate([(343_000, 6_309_000), (343_000, 7_000_000)]):
        source = survey(tmp_path / f"src{k}", trees(origin=origin))
        with pytest.raises(InputError) as caught:
            read_surveys(reference, source)
        one_sentence(str(caught.value), "different places", "km apart", str(reference), str(source))
        assert len(read_surveys(reference, source, same_place=False)[1].features) == 12


def test_surveys_beyond_the_reach_of_one_frame(tmp_path):
    reference = survey(tmp_path / "ref")
    antipode = survey(tmp_path / "src", trees(crs="EPSG:32615", origin=(500_000, 3_700_000)))
    with pytest.raises(InputError, match="src"):
        read_surveys(reference, antipode)


def test_surveys_two_kilometres_apart_are_in_one_place(tmp_path):
    reference, source = survey(tmp_path / "ref"), survey(tmp_path / "src", trees(grid() + np.array([0, 1_950])))
    np.testing.assert_allclose(read_surveys(reference, source)[1].features.xy[:, 1].min(), 1_942, atol=12)


def test_a_tree_far_from_the_others(tmp_path):
    ring = [[0.0, 0.0], [1e-5, 0.0], [0.0, 1e-5], [0.0, 0.0]]
    refusal(survey(tmp_path / "s", with_(7, geometry=polygon(ring))), "feature 7", "km from the middle", "remove it")


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_trees(tmp_path, count):
    refusal(survey(tmp_path / "s", trees()[:count]), f"{count} usable tree", "at least 3")


def test_fewer_than_three_usable_trees(tmp_path):
    features = [*trees()[:2], feature(None), *trees()[:2]]
    refusal(survey(tmp_path / "s", [{**f, "properties": {}} for f in features]), "2 usable trees among 5 features")


def test_confidence_missing_on_some(tmp_path):
    features = with_(3, properties={})
    features[5]["properties"] = None
    refusal(survey(tmp_path / "s", features), "2 of 12", "feature 3", "'confidence'", "raw-detections.geojson")


@pytest.mark.parametrize("value", [1.5, -0.1, math.nan, math.inf, "high", True, [0.5], 10**400])
def test_confidence_out_of_range(tmp_path, value):
    features = with_(4, properties={"confidence": value})
    features[9]["properties"]["confidence"] = value
    refusal(survey(tmp_path / "s", features), "2 of 12", "feature 4", "0 to 1", "raw-detections.geojson")


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_confidence_in_a_table(tmp_path, suffix):
    some = [0.5] * 5 + [None] + [0.5] * 6
    refusal(table(tmp_path / "a", suffix, confidence=some), "1 of 12", "feature 5")
    refusal(table(tmp_path / "b", suffix, confidence=[0.5] * 11 + [7.0]), "1 of 12", "feature 11")
    refusal(table(tmp_path / "c", suffix, confidence=["0.5"] * 12), "12 of 12", "feature 0")


def test_broken_boundary_is_named(tmp_path):
    folder = survey(tmp_path / "s")
    refusal(raw(folder, "{", "boundary.geojson"), "boundary.geojson", "cut off")
    refusal(raw(folder, json.dumps({"type": "Point", "coordinates": [19.3, -33.3]}), "boundary.geojson"), "no polygon")


def test_broken_raster_is_named(tmp_path):
    refusal(raw(survey(tmp_path / "s"), b"II*\0nonsense", "visible_10cm.tif"), "visible_10cm.tif", "raster")


def test_markup_in_names_is_shown_as_data(tmp_path):
    folder = survey(tmp_path / "<b>&amp;\u202e", with_(0, properties={"confidence": "<script>\x1b[31m\n"}))
    text = refusal(folder, "<b>&amp;")
    assert "\x1b" not in text


def test_hidden_files_are_not_shown_as_what_a_folder_holds(tmp_path):
    (tmp_path / ".treereg-staging-x").mkdir()
    refusal(tmp_path, "it is empty")
