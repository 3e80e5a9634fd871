"""`treereg apply` from the outside: every format, every file of a transform, and what is refused."""

from __future__ import annotations

import json
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyarrow.parquet as pq
import pyogrio
import pyproj
import pytest
import rasterio
import shapely
from io_files import CRS, ORIGIN, collection, feature, lonlat, polygon, square, trees
from raster_files import GRIDS, MOTION, after, misplaced, north_up, painted, write

from treereg_core.cli import main
from treereg_core.transform import Affine, Rigid

Output = pytest.CaptureFixture[str]
FULL = MOTION.reference_from_source
OTHER = Rigid.turn(-40, about=np.add(ORIGIN, 20))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    transform_file(Path("there.json"))
    transform_file(Path("back.json"), FULL.inverse())
    Path("in").mkdir()


def transform_file(path: Path, transform: Affine | None = FULL, crs: str = CRS, **more: Any) -> Path:
    record = transform and {"matrix": transform.matrix.tolist()}
    path.write_text(json.dumps({"crs": crs, "transform": record, **more}))
    return path


def apply(*arguments: Any) -> int:
    return main(["apply", *map(str, arguments), "-q"])


def there_and_back(name: str) -> tuple[Path, Path]:
    """The file `in/NAME` moved, and moved back again."""
    assert apply("there.json", f"in/{name}", "--out", "out") == 0
    assert apply("back.json", f"out/{name}", "--out", "back") == 0
    return Path("out", name), Path("back", name)


def frame(crs: str = CRS) -> geopandas.GeoDataFrame:
    """Shapes of every kind, some with heights, one missing and one empty."""
    shapes = [
        shapely.Point(3, 4),
        shapely.Point(3, 4, 5),
        shapely.LineString([(0, 0, 1), (5, 5, 2)]),
        shapely.Polygon([(0, 0), (9, 0), (9, 9)], [[(5, 1), (6, 1), (6, 2)]]),
        shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 2, 3, 3)]),
        shapely.GeometryCollection([shapely.Point(1, 1), shapely.LineString([(0, 0), (1, 2)])]),
        None,
        shapely.Polygon(),
    ]
    moved = shapely.transform(np.array(shapes, dtype=object), lambda xy: xy + ORIGIN)
    for k in (1, 2):
        moved[k] = shapely.force_3d(moved[k], 5.0)
    columns = {"name": [f"Bäume {k}" for k in range(8)], "n": range(8), "share": [0.1 * k for k in range(8)]}
    return geopandas.GeoDataFrame(columns, geometry=moved, crs=CRS).to_crs(crs)


def positions(table: geopandas.GeoDataFrame) -> np.ndarray:
    """Every position (n, 3)."""
    return np.asarray(shapely.get_coordinates(table.geometry.array, include_z=True))


def expected(before: geopandas.GeoDataFrame) -> np.ndarray:
    """The positions (n, 3) that the shapes should have after the move."""
    xyz = positions(before)
    to, back = (pyproj.Transformer.from_crs(*pair, always_xy=True) for pair in ((before.crs, CRS), (CRS, before.crs)))
    xy = FULL(np.column_stack(to.transform(xyz[:, 0], xyz[:, 1])))
    return np.column_stack([*back.transform(xy[:, 0], xy[:, 1]), xyz[:, 2]])


def check(before: geopandas.GeoDataFrame, out: geopandas.GeoDataFrame, back: geopandas.GeoDataFrame) -> None:
    finest = 1e-9 if before.crs.is_geographic else 1e-4
    for found, xyz in ((out, expected(before)), (back, positions(before))):
        assert found.crs == before.crs
        np.testing.assert_allclose(positions(found), xyz, rtol=0, atol=finest)
        assert (shapely.has_z(found.geometry) == shapely.has_z(before.geometry)).all()
        plain = [table.drop(columns=table.geometry.name) for table in (before, found)]
        assert plain[0].equals(plain[1])


@pytest.mark.parametrize("crs", [CRS, "EPSG:4326", "EPSG:32733"])
def test_geoparquet(crs: str) -> None:
    before = frame(crs)
    before.to_parquet("in/a.parquet", write_covering_bbox=True, schema_version="1.1.0")
    out, back = map(geopandas.read_parquet, there_and_back("a.parquet"))
    check(before, out, back)
    boxes = pq.read_table("out/a.parquet").column("bbox").to_pylist()
    assert boxes[3] == dict(zip(("xmin", "ymin", "xmax", "ymax"), out.geometry[3].bounds, strict=True))
    meta = json.loads(pq.read_schema("out/a.parquet").metadata[b"geo"])["columns"]["geometry"]
    np.testing.assert_allclose(meta["bbox"][:2], out.total_bounds[:2])


@pytest.mark.parametrize("crs", [CRS, "EPSG:4326"])
def test_geopackage_with_all_its_layers(crs: str) -> None:
    before = frame(crs)
    pyogrio.write_dataframe(before, "in/a.gpkg", layer="shapes", geometry_type="Unknown")
    points = frame(crs).iloc[:1]
    pyogrio.write_dataframe(points, "in/a.gpkg", layer='odd "name"', append=True)
    pyogrio.write_dataframe(before.drop(columns="geometry"), "in/a.gpkg", layer="notes", append=True)
    paths = (Path("in/a.gpkg"), *there_and_back("a.gpkg"))
    for layer in ("shapes", 'odd "name"'):
        check(*(pyogrio.read_dataframe(path, layer=layer, fid_as_index=True) for path in paths))
    assert [list(row) for row in pyogrio.list_layers("out/a.gpkg")] == [
        list(row) for row in pyogrio.list_layers("in/a.gpkg")
    ]
    box = frame(crs).iloc[[3]].geometry.total_bounds
    moved = pyogrio.read_dataframe("out/a.gpkg", layer="shapes")
    low = moved.geometry[3].bounds
    found = pyogrio.read_dataframe("out/a.gpkg", layer="shapes", bbox=(low[0], low[1], low[0] + 1e-9, low[3]))
    assert 3 in found["n"].tolist()
    assert not np.allclose(box, low, rtol=0, atol=1e-9)
    with sqlite3.connect("out/a.gpkg") as database:
        bounds = database.execute("SELECT min_x, min_y, max_x, max_y FROM gpkg_contents").fetchone()
    np.testing.assert_allclose(bounds, moved.total_bounds, rtol=1e-12)


@pytest.mark.parametrize("crs", [CRS, "EPSG:4326"])
@pytest.mark.parametrize("which", [[0], [1], [2], [3, 4], "multipoint"])
def test_shapefile(crs: str, which: Any) -> None:
    whole = frame(crs)
    before = whole.iloc[[3, 4] if which == "multipoint" else which]
    if which == "multipoint":
        hulls = [shapely.MultiPoint(shape.convex_hull.exterior.coords) for shape in before.geometry]
        before = before.set_geometry(hulls, crs=crs)
    pyogrio.write_dataframe(before, "in/a.shp")
    paths = [Path("in/a.shp"), *there_and_back("a.shp")]
    check(*(pyogrio.read_dataframe(path) for path in paths))
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.cpg", "a.dbf", "a.prj", "a.shp", "a.shx"]
    info = pyogrio.read_info("out/a.shp", force_total_bounds=True)
    np.testing.assert_allclose(info["total_bounds"], pyogrio.read_dataframe("out/a.shp").total_bounds, rtol=1e-14)


def test_geojson_keeps_everything_but_positions() -> None:
    features = trees()
    features[0] |= {"id": "a/b", "properties": {"big": 2**80 + 1, "nested": {"a": [1, None]}}, "bbox": [0, 0, 1, 1]}
    features[1]["geometry"] = {"type": "Point", "coordinates": [*lonlat(np.array([ORIGIN]))[0].tolist(), 7.25]}
    features[2]["geometry"] = None
    document = collection(features, name="survey", bbox=[0, 0, 1, 1], more={"x": [1]})
    Path("in/a.geojson").write_text(json.dumps(document))
    out, back = (json.loads(path.read_text()) for path in there_and_back("a.geojson"))
    assert {key: out[key] for key in ("type", "name", "more")} == {
        "type": "FeatureCollection",
        "name": "survey",
        "more": {"x": [1]},
    }
    assert "bbox" not in out
    assert [f["properties"] for f in out["features"]] == [f["properties"] for f in features]
    assert out["features"][0]["id"] == "a/b"
    assert out["features"][2]["geometry"] is None
    assert out["features"][1]["geometry"]["coordinates"][2] == 7.25
    place = np.array([out["features"][1]["geometry"]["coordinates"][:2]])
    np.testing.assert_allclose(place, lonlat(FULL([ORIGIN])), rtol=0, atol=6e-10)
    assert np.abs(np.round(place, 9) - place).max() == 0
    for before, after_both in zip(features[3:], back["features"][3:], strict=True):
        rings = [np.array(f["geometry"]["coordinates"]) for f in (before, after_both)]
        np.testing.assert_allclose(rings[0], rings[1], rtol=0, atol=1.6e-9)


def test_geojson_in_another_crs_and_without_a_collection() -> None:
    legacy = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32734"}}
    point = {"type": "Point", "coordinates": [*ORIGIN], "crs": legacy}
    Path("in/a.json").write_text(json.dumps(point))
    out, back = (json.loads(path.read_text()) for path in there_and_back("a.json"))
    assert out["crs"] == legacy
    np.testing.assert_allclose(out["coordinates"], FULL([ORIGIN])[0], atol=1e-6)
    np.testing.assert_allclose(back["coordinates"], ORIGIN, atol=1e-6)
    Path("in/b.geojson").write_text(json.dumps(feature(polygon(square((0, 0))))))
    assert json.loads(there_and_back_again("b.geojson").read_text())["type"] == "Feature"


def there_and_back_again(name: str) -> Path:
    assert apply("there.json", f"in/{name}", "--out", "again") == 0
    return Path("again", name)


def test_a_field_on_the_antimeridian_stays_whole() -> None:
    ring = [[179.9999, -17.0], [180.0001, -17.0], [180.0001, -17.0001], [179.9999, -17.0]]
    Path("in/a.geojson").write_text(json.dumps(feature(polygon(ring))))
    transform_file(Path("fiji.json"), Rigid(np.eye(2), (3, 3)), "EPSG:3460")
    assert apply("fiji.json", "in/a.geojson", "--out", "out") == 0
    found = np.array(json.loads(Path("out/a.geojson").read_text())["geometry"]["coordinates"][0])
    assert np.abs(found - ring).max() < 1e-4


@pytest.mark.parametrize("name", GRIDS)
def test_rasters_in_any_crs(name: str, capsys: Output) -> None:
    painted(Path("in/a.tif"), name, bands=3)
    assert main(["apply", "there.json", "in/a.tif", "--out", "out", "--threads", "2"]) == 0
    assert "1 file moved\n  out/a.tif" in capsys.readouterr().out
    assert misplaced(Path("out/a.tif"), after()) < 0.1
    assert apply("there.json", "in/a.tif", "--out", "exact", "--lossless", "--world-file", "--gcp-points") == 0
    assert misplaced(Path("exact/a.tif"), after()) < 0.1
    assert sorted(path.name for path in Path("exact").iterdir()) == ["a.tfw", "a.tif", "a.tif.points"]
    with rasterio.open("out/a.tif") as file:
        assert file.transform.b == file.transform.d == 0
        assert file.transform.e < 0


def test_rasters_onto_a_grid() -> None:
    painted(Path("in/a.tif"), "rotated")
    Path("other").mkdir()
    grid = write(Path("other/grid.tif"), np.zeros((1, 100, 90), np.uint8), CRS, north_up(pixel=0.4, size=100))
    assert apply("there.json", "in/a.tif", "--out", "out", "--grid", grid) == 0
    with rasterio.open("out/a.tif") as file:
        assert file.shape == (100, 90)
    assert apply("there.json", "in/a.tif", "--out", "wide", "--grid", grid, "--extent", "source") == 0
    assert misplaced(Path("wide/a.tif"), after()) < 0.1


def test_an_image_with_a_world_file_becomes_a_geotiff(capsys: Output) -> None:
    painted(Path("a.tif"))
    rasterio.shutil.copy("a.tif", "in/a.png", driver="PNG", worldfile=True)
    Path("in/a.png.aux.xml").unlink(missing_ok=True)
    assert apply("there.json", "in/a.png", "--out", "out") == 0
    assert "has no CRS; it is taken to be in EPSG:32734, in which it lies at where" in capsys.readouterr().err
    assert misplaced(Path("out/a.tif"), after()) < 0.1


def test_many_files_at_once_and_again_with_overwrite() -> None:
    painted(Path("in/a.tif"))
    shutil.copy("in/a.tif", "in/b [1].tif")
    Path("in/a.geojson").write_text(json.dumps(collection(trees())))
    files = ["in/a.tif", "in/b [1].tif", "in/a.geojson"]
    assert apply("there.json", *files, "--out", "out") == 0
    assert apply("there.json", *files, "--out", "out") == 2
    Path("out/mine.txt").write_text("keep")
    assert apply("there.json", *files, "--out", "out", "--overwrite") == 0
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.geojson", "a.tif", "b [1].tif", "mine.txt"]


RIVALS = {"rivals": [{"matrix": OTHER.matrix.tolist(), "log_odds": -1.0}]}


def test_a_placement_that_a_person_chose() -> None:
    painted(Path("in/a.tif"))
    for verdict, transform in (("ambiguous", FULL), ("failed", None), ("accepted", FULL)):
        transform_file(Path("r.json"), transform, verdict=verdict, **RIVALS)
        assert apply("r.json", "in/a.tif", "--out", verdict, "--rival", 1) == 0
        assert misplaced(Path(verdict, "a.tif"), OTHER.about(ORIGIN)(after(Affine.identity()))) < 0.1
    transform_file(Path("r.json"), FULL, verdict="ambiguous", **RIVALS)
    assert apply("r.json", "in/a.tif", "--out", "forced", "--force") == 0
    assert misplaced(Path("forced/a.tif"), after()) < 0.1


def test_a_transform_in_another_crs() -> None:
    painted(Path("in/a.tif"))
    to = pyproj.Transformer.from_crs(CRS, "EPSG:32733", always_xy=True)
    places = np.random.default_rng(0).uniform(0, 48, (40, 2)) + ORIGIN
    here, there = (np.column_stack(to.transform(*points.T)) for points in (places, FULL(places)))
    middle = here.mean(axis=0)
    slopes, *_ = np.linalg.lstsq(here - middle, there - there.mean(axis=0), rcond=None)
    fitted = Affine(slopes.T, there.mean(axis=0) - slopes.T @ middle)
    transform_file(Path("zone.json"), fitted, "EPSG:32733")
    assert apply("zone.json", "in/a.tif", "--out", "out") == 0
    assert misplaced(Path("out/a.tif"), after()) < 0.1


BAD: list[tuple[list[str], str]] = [
    (["absent.json", "in/a.tif"], "absent.json cannot be read"),
    (["in/a.geojson", "in/a.tif"], "in/a.geojson holds no transform"),
    (["failed.json", "in/a.tif"], "failed.json is of a registration that failed and has no transform; choose"),
    (["failed.json", "in/a.tif", "--force"], "failed.json is of a registration that failed"),
    (["ambiguous.json", "in/a.tif"], "ambiguous.json is of a registration that is ambiguous, not accepted"),
    (["ambiguous.json", "in/a.tif", "--rival", "2"], "names 1 rivals, and there is no number 2"),
    (["ambiguous.json", "in/a.tif", "--rival", "0"], "there is no number 0"),
    (["there.json", "in/a.tif", "--rival", "1"], "there.json names no rivals"),
    (["there.json", "in/absent.tif"], "in/absent.tif: there is no such file"),
    (["there.json", "in"], "in: is a folder"),
    (["there.json", "in/notes.txt"], "in/notes.txt cannot be read as a raster"),
    (["there.json", "in/a.tif", "twin/A.tif"], "in/a.tif and twin/A.tif would both become A.tif"),
    (["there.json", "in/a.tif", "--lossless", "--grid", "in/a.tif"], "--lossless keeps every pixel"),
    (["there.json", "in/a.tif", "--lossless", "--resampling", "cubic"], "--lossless keeps every pixel"),
    (["there.json", "in/a.tif", "--extent", "reference"], "--extent reference needs the grid"),
    (["there.json", "in/a.tif", "--resampling", "best"], "--resampling is best, but must be auto or nearest"),
    (["there.json", "in/a.tif", "--threads", "0"], "--threads is 0"),
    (["there.json", "in/a.tif", "--grid", "in/a.geojson"], "in/a.geojson cannot be read as a raster"),
    (["there.json", "in/a.png", "--lossless"], "in/a.png is no GeoTIFF"),
    (["there.json", "in/a.tif", "in/cut.tif"], "in/cut.tif is cut off"),
    (["there.json", "in/a.tif", "in/broken.geojson"], "in/broken.geojson is not JSON, or is cut off"),
    (["there.json", "in/a.tif", "in/broken.gpkg"], "in/broken.gpkg is not a GeoPackage"),
    (["there.json", "in/a.tif", "in/broken.parquet"], "in/broken.parquet cannot be read as GeoParquet"),
    (["there.json", "in/a.tif", "in/broken.shp"], "in/broken.shp has no CRS"),
    (["there.json", "in/nowhere.geojson"], "in/nowhere.geojson has coordinates that are not finite numbers"),
]


@pytest.mark.parametrize(("arguments", "sentence"), BAD, ids=lambda value: str(value)[:60])
def test_what_is_refused_is_one_sentence_and_leaves_nothing(
    arguments: list[str], sentence: str, capsys: Output
) -> None:
    painted(Path("in/a.tif"), compress="deflate")
    Path("twin").mkdir()
    shutil.copy("in/a.tif", "twin/A.tif")
    Path("in/a.geojson").write_text(json.dumps(collection(trees())))
    Path("in/notes.txt").write_text("x")
    rasterio.shutil.copy("in/a.tif", "in/a.png", driver="PNG", worldfile=True)
    Path("in/cut.tif").write_bytes(Path("in/a.tif").read_bytes()[:-500])
    Path("in/nowhere.geojson").write_text(json.dumps({"type": "Point", "coordinates": [1, None]}))
    for name in ("broken.geojson", "broken.gpkg", "broken.parquet", "broken.shp"):
        Path("in", name).write_text('{"type": ')
    transform_file(Path("failed.json"), None, verdict="failed", rivals=[])
    transform_file(Path("ambiguous.json"), FULL, verdict="ambiguous", **RIVALS)
    assert apply(*arguments, "--out", "out") == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert not Path("out").exists()
    assert not list(Path().glob(".treereg*"))


def test_never_over_its_own_input(capsys: Output) -> None:
    painted(Path("in/a.tif"))
    before = Path("in/a.tif").read_bytes()
    for out in ("in", "."):
        assert apply("there.json", "in/a.tif", "--out", out, "--overwrite") == 2
        assert "input folder" in capsys.readouterr().err
    assert Path("in/a.tif").read_bytes() == before
