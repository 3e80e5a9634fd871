"""What `read_survey` and `read_surveys` make of good folders."""

from __future__ import annotations

import json

import numpy as np
import pyproj
import pytest
from io_files import CRS, ORIGIN, collection, feature, grid, lonlat, polygon, raw, square, survey, table, trees

from treereg_core.io import read_survey, read_surveys
from treereg_core.survey import Frame

FRAME = Frame(CRS, ORIGIN)


def named_crs(name):
    return {"type": "name", "properties": {"name": name}}


def in_crs(code):
    """The usual trees with coordinates in another CRS."""
    convert = pyproj.Transformer.from_crs("OGC:CRS84", code, always_xy=True)
    features = trees()
    for f in features:
        ring = np.array(f["geometry"]["coordinates"][0])
        f["geometry"]["coordinates"] = [np.column_stack(convert.transform(*ring.T)).tolist()]
    return features


def agrees_with_the_grid(found):
    np.testing.assert_allclose(found.features.xy + found.frame.origin, grid() + ORIGIN, atol=1e-4)
    np.testing.assert_allclose(found.features.area, 4, atol=1e-3)


@pytest.mark.parametrize("name", ["raw-detections", "raw_detections", "detections_raw"])
def test_names_of_the_detections(tmp_path, name):
    found = read_survey(survey(tmp_path / "s", name=f"{name}.geojson"))
    agrees_with_the_grid(found)
    assert (found.path, found.detections) == (tmp_path / "s", tmp_path / "s" / f"{name}.geojson")
    assert (found.count, found.warnings, found.boundary) == (12, (), None)
    assert found.features.ids.tolist() == list(range(12))
    assert (found.features.confidence == 0.5).all()


def test_the_frame_is_the_utm_zone_about_a_whole_metre_nearby(tmp_path):
    frame = read_survey(survey(tmp_path / "s")).frame
    assert frame.crs == CRS
    assert all(value == round(value) for value in frame.origin)
    assert np.hypot(*(np.array(frame.origin) - ORIGIN)) < 20


@pytest.mark.parametrize(
    "code", ["EPSG:4326", "OGC:CRS84", "EPSG:32734", "EPSG:32735", "EPSG:3857", "EPSG:4148", "EPSG:9518"]
)
def test_legacy_crs_member(tmp_path, code):
    agrees_with_the_grid(read_survey(survey(tmp_path / "s", in_crs(code), crs=named_crs(code)), frame=FRAME))


@pytest.mark.parametrize(
    "crs",
    [
        None,
        named_crs("urn:ogc:def:crs:OGC:1.3:CRS84"),
        named_crs("urn:ogc:def:crs:EPSG::4326"),
        {"type": "EPSG", "properties": {"code": 4326}},
    ],
)
def test_ways_to_say_wgs84(tmp_path, crs):
    agrees_with_the_grid(read_survey(survey(tmp_path / "s", crs=crs)))


@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
@pytest.mark.parametrize("code", ["EPSG:4326", "EPSG:32734", "EPSG:32735", "EPSG:3857"])
def test_tables_in_any_crs(tmp_path, suffix, code):
    found = read_survey(table(tmp_path / "s", suffix, code))
    agrees_with_the_grid(found)
    assert found.warnings == ()
    assert (found.features.confidence == 0.5).all()


@pytest.mark.filterwarnings("ignore:'crs' was not provided:UserWarning")
@pytest.mark.parametrize("suffix", ["gpkg", "parquet"])
def test_table_without_crs_in_degrees(tmp_path, suffix):
    found = read_survey(table(tmp_path / "s", suffix, None))
    agrees_with_the_grid(found)
    assert "no CRS" in found.warnings[0]
    assert "WGS 84" in found.warnings[0]


@pytest.mark.parametrize("crs", [pyproj.CRS(CRS).to_wkt(), CRS])
def test_geoparquet_of_older_versions_names_its_crs_as_text(tmp_path, crs):
    import pyarrow.parquet as pq

    path = table(tmp_path / "s", "parquet", CRS) / "raw-detections.parquet"
    content = pq.read_table(path)
    known = json.loads(content.schema.metadata[b"geo"])
    known["columns"]["geometry"]["crs"] = crs
    geo = {b"geo": json.dumps({**known, "version": "0.4.0"}).encode()}
    pq.write_table(content.replace_schema_metadata(geo), path)
    agrees_with_the_grid(read_survey(tmp_path / "s"))


def test_source_in_another_crs_comes_into_the_frame_of_the_reference(tmp_path):
    reference = survey(tmp_path / "ref")
    source = survey(tmp_path / "src", in_crs("EPSG:32735"), crs=named_crs("EPSG:32735"))
    first, second = read_surveys(reference, source)
    assert first.frame == second.frame
    np.testing.assert_allclose(first.features.xy, second.features.xy, atol=1e-4)


def write_raster(path, crs):
    import rasterio

    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=2,
        height=2,
        count=1,
        dtype="uint8",
        crs=crs,
        transform=rasterio.Affine.scale(2),
    ) as dataset:
        dataset.write(np.zeros((1, 2, 2), dtype=np.uint8))


@pytest.mark.parametrize(
    ("visible", "dem", "expected"),
    [
        ("EPSG:32735", None, "EPSG:32735"),
        (None, "EPSG:32735", "EPSG:32735"),
        ("EPSG:32735", "EPSG:32734", "EPSG:32735"),
        ("EPSG:4326", "EPSG:32735", "EPSG:32735"),
        ("EPSG:4326", None, CRS),
        ("EPSG:3857", None, CRS),
        ("EPSG:2278", None, CRS),
        ("EPSG:2048", None, CRS),
        (None, None, CRS),
    ],
)
def test_working_crs_is_the_rasters_where_that_is_in_true_metres(tmp_path, visible, dem, expected):
    folder = survey(tmp_path / "s")
    for name, crs in (("visible_5cm.tif", visible), ("dem_20cm.tif", dem)):
        if crs:
            write_raster(folder / name, crs)
    assert read_survey(folder).frame.crs == expected


def test_crs_without_authority_is_named_by_its_wkt(tmp_path):
    folder = survey(tmp_path / "s")
    write_raster(folder / "visible_1cm.tif", "+proj=tmerc +lat_0=-33.3 +lon_0=19.3 +k=1 +x_0=7 +y_0=9 +datum=WGS84")
    found = read_survey(folder)
    assert found.frame.crs.startswith("PROJCRS[")
    np.testing.assert_allclose(found.features.area, 4, rtol=2e-3)


@pytest.mark.parametrize(
    ("crs", "origin", "zone"),
    [
        ("EPSG:32633", (500_000, 5_500_000), "EPSG:32633"),
        ("EPSG:32660", (780_000, 1_000), "EPSG:32660"),
        ("EPSG:32601", (500_000, 9_200_000), "EPSG:32601"),
        ("EPSG:5041", (2_000_000, 2_000_000), "EPSG:5041"),
        ("EPSG:5042", (2_300_000, 1_900_000), "EPSG:5042"),
    ],
)
def test_anywhere_on_earth(tmp_path, crs, origin, zone):
    found = read_survey(survey(tmp_path / "s", trees(crs=crs, origin=origin)))
    assert found.frame.crs == zone
    np.testing.assert_allclose(found.features.area, 4, atol=1e-3)
    np.testing.assert_allclose(found.features.xy + found.frame.origin, grid() + origin, atol=1e-3)


@pytest.mark.parametrize("style", ["wrapped", "running on"])
def test_a_field_across_the_antimeridian(tmp_path, style):
    x, y = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32760", always_xy=True).transform(180, -17)
    features = trees(crs="EPSG:32760", origin=(x - 5, y))
    longitudes = np.array([p[0] for f in features for p in f["geometry"]["coordinates"][0]])
    assert (longitudes > 179).any()
    assert (longitudes < -179).any()
    if style == "running on":
        for f in features:
            for p in f["geometry"]["coordinates"][0]:
                p[0] %= 360
    found = read_survey(survey(tmp_path / "s", features))
    assert found.frame.crs in ("EPSG:32760", "EPSG:32701")
    np.testing.assert_allclose(found.features.area, 4, atol=1e-2)
    assert found.features.spacing == pytest.approx(3, abs=0.3)


def test_multipolygons_and_holes(tmp_path):
    ring, hole, other = square((0, 0), 4), square((0.5, 0), 2), square((6, 0), 2)
    point = {"type": "Point", "coordinates": other[0]}
    features = [
        *trees(grid() + 20),
        feature(polygon(ring, hole), confidence=1),
        feature({"type": "MultiPolygon", "coordinates": [[ring, hole], [other]]}, confidence=0),
        feature({"type": "GeometryCollection", "geometries": [polygon(other), point]}, confidence=0.25),
    ]
    found = read_survey(survey(tmp_path / "s", features), frame=FRAME)
    np.testing.assert_allclose(found.features.area[12:], [12, 16, 4], atol=1e-2)
    np.testing.assert_allclose(found.features.xy[12:], [(-1 / 6, 0), (11 / 8, 0), (6, 0)], atol=1e-3)
    assert found.features.confidence[12:].tolist() == [1, 0, 0.25]


def test_a_third_dimension_is_left_out(tmp_path):
    features = trees()
    for f in features[:6]:
        f["geometry"]["coordinates"][0] = [[*p, 700.5] for p in f["geometry"]["coordinates"][0]]
    agrees_with_the_grid(read_survey(survey(tmp_path / "s", features), frame=FRAME))


def test_unclosed_rings_are_closed(tmp_path):
    features = trees()
    for f in features:
        f["geometry"]["coordinates"][0].pop()
    agrees_with_the_grid(read_survey(survey(tmp_path / "s", features)))


def test_unusable_features_are_dropped_and_counted(tmp_path):
    a, b, c, d, _ = square((40, 0), 4)
    features = [
        feature(None, confidence=0.5),
        *trees(),
        feature({"type": "Polygon", "coordinates": []}, confidence=0.5),
        feature({"type": "MultiPolygon", "coordinates": []}, confidence=0.5),
        feature(polygon([a, b]), confidence=0.5),
        feature(polygon([a, b, a, a]), confidence=0.5),
        feature(polygon([a, a, a, a]), confidence=0.5),
        feature(polygon([a, b, c, d, a]), confidence=0.5),
        feature(polygon([c, d, a, b, c]), confidence=0.9),
        feature(polygon([a, c, b, d, a]), confidence=0.5),
    ]
    found = read_survey(survey(tmp_path / "s", features), frame=FRAME)
    assert found.count == 21
    assert found.features.ids.tolist() == [*range(1, 13), 18, 20]
    assert found.features.area[-2:] == pytest.approx([16, 8], abs=0.01)
    assert len(found.warnings) == 1
    for words in (
        "of 21 features",
        "1 with invalid",
        "7 dropped",
        "4 without geometry",
        "2 without area",
        "1 a duplicate",
    ):
        assert words in found.warnings[0]
    assert "raw-detections.geojson" in found.warnings[0]


def test_no_confidence_anywhere_is_one_and_one_warning(tmp_path):
    features = [{**f, "properties": None} for f in trees()]
    found = read_survey(survey(tmp_path / "s", features))
    assert (found.features.confidence == 1).all()
    assert len(found.warnings) == 1
    assert "'confidence'" in found.warnings[0]


@pytest.mark.parametrize("suffix", ["geojson", "gpkg", "parquet"])
def test_confidence_from_another_property(tmp_path, suffix):
    if suffix == "geojson":
        folder = survey(tmp_path / "s", [{**f, "properties": {"score": 0.25}} for f in trees()])
    else:
        folder = table(tmp_path / "s", suffix, score=[0.25] * 12)
    assert (read_survey(folder, confidence_property="score").features.confidence == 0.25).all()
    assert (read_survey(folder).features.confidence == 1).all()


def test_whole_numbers_are_confidences(tmp_path):
    features = [{**f, "properties": {"confidence": i % 2}} for i, f in enumerate(trees())]
    assert read_survey(survey(tmp_path / "s", features)).features.confidence.tolist() == [0, 1] * 6


def test_boundary_is_read_into_the_frame_and_crops_nothing(tmp_path):
    folder = survey(tmp_path / "s")
    survey(folder, [feature(polygon(square((0, 0), 6)))], "boundary.geojson")
    found = read_survey(folder, frame=FRAME)
    assert found.boundary.area == pytest.approx(36, abs=0.01)
    assert found.boundary.bounds == pytest.approx((-3, -3, 3, 3), abs=0.001)
    assert len(found.features) == 12


def test_boundary_elsewhere_is_left_out_with_a_warning(tmp_path):
    folder = survey(tmp_path / "s")
    survey(folder, [feature(polygon(square((0, 9_000), 6)))], "boundary.geojson")
    found = read_survey(folder)
    assert found.boundary is None
    assert "boundary.geojson" in found.warnings[0]


def test_a_geojson_in_another_encoding(tmp_path):
    for encoding in ("utf-8-sig", "utf-16"):
        agrees_with_the_grid(read_survey(raw(tmp_path / encoding, json.dumps(collection(trees())).encode(encoding))))


def test_order_and_indices_hold_in_tables_with_gaps(tmp_path):
    import geopandas
    import shapely

    shapes = [shapely.Polygon(f["geometry"]["coordinates"][0]) for f in trees()]
    shapes[0] = None
    shapes[5] = shapely.Polygon()
    frame = geopandas.GeoDataFrame({"confidence": np.arange(12) / 12}, geometry=shapes, crs=4326)
    frame.to_file(tmp_path / "raw-detections.gpkg")
    (tmp_path / "other").mkdir()
    frame.to_parquet(tmp_path / "other" / "raw-detections.parquet")
    for folder in (tmp_path, tmp_path / "other"):
        found = read_survey(folder, frame=FRAME).features
        assert found.ids.tolist() == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
        np.testing.assert_allclose(found.confidence, found.ids / 12)
        np.testing.assert_allclose(found.xy, grid()[found.ids], atol=1e-4)


def test_areas_and_centroids_are_exact_far_from_the_origin_of_the_crs(tmp_path):
    point = np.array([[50.123, 20.456]])
    features = [*trees(), feature(polygon(square(point[0], 0.5)), confidence=1)]
    found = read_survey(survey(tmp_path / "s", features), frame=FRAME).features
    assert found.area[-1] == pytest.approx(0.25, rel=1e-3)
    np.testing.assert_allclose(found.xy[-1:], point, atol=1e-6)
    np.testing.assert_allclose(lonlat(found.xy[-1:] + ORIGIN), lonlat(point + ORIGIN), atol=1e-12)


def test_equal_crowns_stay_equal_through_a_file(tmp_path):
    from treereg_core.simulate import Scene, simulate, write_simulation

    lattice = Scene(trees=200, periodic=True, missed=0, false=0, split=0, merged=0)
    write_simulation(simulate(lattice, 1), tmp_path)
    assert len(set(read_survey(tmp_path / "reference").features.area)) == 1


def test_areas_are_kept_to_a_thousandth(tmp_path):
    features = [feature(polygon(square((10 * i, 0), side=1 + 0.37 * i))) for i in range(8)]
    areas = read_survey(survey(tmp_path / "s", features)).features.area
    np.testing.assert_allclose(areas, [(1 + 0.37 * i) ** 2 for i in range(8)], rtol=1.1e-3)
