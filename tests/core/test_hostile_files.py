"""Files made to do harm: they open no other file and no address, run nothing, and take no more than a machine has."""

from __future__ import annotations

import json
import os
import pickle
import sqlite3
import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from io_files import survey

from benchmarks.fuzz_targets import FRAME, TARGETS, valid
from treereg_core.errors import InputError
from treereg_core.io import Motion, move_vector, read_image, read_raster, read_survey
from treereg_core.io.crs import check_no_files, parse_crs
from treereg_core.io.untrusted import check_geopackage
from treereg_core.memory import load
from treereg_core.transform import Rigid

VRT = """<VRTDataset rasterXSize="40" rasterYSize="40"><SRS>EPSG:32734</SRS>
<GeoTransform>342996, 0.5, 0, 6306015, 0, -0.5</GeoTransform>
<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="0">{}</SourceFilename>
<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"""
READERS = (read_raster, lambda path: read_image(path, FRAME), lambda path: read_survey(path.parent))


@contextmanager
def server() -> Iterator[tuple[str, list[str]]]:
    """The address of a server on this machine, and what it was asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        do_HEAD = do_GET  # noqa: N815

        def log_message(self, *_: Any) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as http:
        thread = threading.Thread(target=http.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{http.server_port}", asked
        finally:
            http.shutdown()
            thread.join()


def with_raster(folder: Path, content: bytes, name: str = "visible_10cm.tif") -> Path:
    survey(folder)
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("read", READERS)
def test_a_vrt_by_the_name_of_an_orthomosaic_opens_no_other_file(read: Any, tmp_path: Path) -> None:
    (tmp_path / "secret.tif").write_bytes(valid("raster"))
    path = with_raster(tmp_path / "s", VRT.format(tmp_path / "secret.tif").encode())
    with pytest.raises(InputError, match=r"visible_10cm\.tif cannot be read as a raster"):
        read(path)


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("kind", ["vrt", "wms", "address"])
def test_no_raster_reaches_the_network(read: Any, kind: str, tmp_path: Path) -> None:
    with server() as (address, asked):
        text = {
            "vrt": VRT.format(f"/vsicurl/{address}/a.tif"),
            "wms": f'<GDAL_WMS><Service name="TMS"><ServerUrl>{address}/${{z}}</ServerUrl></Service></GDAL_WMS>',
            "address": f"/vsicurl/{address}/a.tif\n",
        }[kind]
        with pytest.raises(InputError):
            read(with_raster(tmp_path / "s", text.encode()))
    assert asked == []


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("read", READERS)
def test_overviews_elsewhere_are_not_opened(read: Any, inside: bool, tmp_path: Path) -> None:
    import rasterio

    path = with_raster(tmp_path / "s", valid("raster"))
    with server() as (address, asked):
        if inside:
            with rasterio.open(path, "r+") as file:
                file.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=f"/vsicurl/{address}/a.tif")
        else:
            item = f'<MDI key="OVERVIEW_FILE">/vsicurl/{address}/a.tif</MDI>'
            text = f'<PAMDataset><Metadata domain="OVERVIEWS">{item}</Metadata></PAMDataset>'
            (path.parent / f"{path.name}.aux.xml").write_text(text)
        with pytest.raises(InputError, match="overviews"):
            read(path)
    assert asked == []


@pytest.mark.parametrize("word", ["nadgrids=", "nadgr&#105;ds=", "nadgrids=@null,"])
def test_the_crs_beside_a_raster_has_no_file_opened(word: str, tmp_path: Path) -> None:
    path = with_raster(tmp_path / "s", valid("raster"))
    grid = tmp_path / "grid.gsb"
    os.mkfifo(grid)  # whoever opens it waits for ever
    text = f"<PAMDataset><SRS>+proj=longlat +ellps=bessel +{word}{grid}</SRS></PAMDataset>"
    (path.parent / f"{path.name}.aux.xml").write_text(text)
    with pytest.raises(InputError, match="names another file"):
        read_raster(path)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize("how", [".tif", ".tif.ovr", ".tif.msk", ".tif.ovr.aux.xml"])
@pytest.mark.parametrize("key", ["OVERVIEW_FILE", "overview_file"])
def test_overviews_and_masks_have_no_overviews_elsewhere(key: str, how: str, tmp_path: Path) -> None:
    import rasterio

    path = with_raster(tmp_path / "s", valid("raster"))
    with rasterio.Env(TIFF_USE_OVR=True, GDAL_TIFF_INTERNAL_MASK=False), rasterio.open(path, "r+") as file:
        file.build_overviews([2])
        file.write_mask(True)
    side = path.with_suffix(how)
    if how.endswith(".xml"):
        item = f'<MDI key="{key}">/elsewhere.tif</MDI>'
        side.write_text(f'<PAMDataset><Metadata domain="OVERVIEWS">{item}</Metadata></PAMDataset>')
    else:
        with rasterio.open(side, "r+") as file:
            file.update_tags(ns="OVERVIEWS", **{key: "/elsewhere.tif"})
    for read in READERS:
        with pytest.raises(InputError, match="names another file as its overviews"):
            read(path)


@pytest.mark.parametrize("suffix", [".ovr", ".msk"])
def test_overviews_and_masks_beside_are_no_vrt(suffix: str, tmp_path: Path) -> None:
    path = with_raster(tmp_path / "s", valid("raster"))
    (path.parent / f"{path.name}{suffix}").write_text(VRT.format("/etc/hostname"))
    with pytest.raises(InputError, match="is no TIFF"):
        read_raster(path)


def test_a_raster_of_impossible_size_is_refused_before_heights_are_read(tmp_path: Path) -> None:
    import rasterio

    path = with_raster(tmp_path / "s", b"", "dem_10cm.tif")
    profile = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": FRAME.crs, "sparse_ok": True}
    where = rasterio.Affine(1e-4, 0, FRAME.origin[0], 0, -1e-4, FRAME.origin[1])
    size = {"width": 500_000, "height": 500_000, "tiled": True, "bigtiff": "yes"}
    with rasterio.open(path, "w", transform=where, **profile, **size):
        pass
    with pytest.raises(InputError, match="too many to be true"):
        read_survey(path.parent)


def geopackage(path: Path, *statements: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(valid("geopackage"))
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA writable_schema = ON")
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


def entry(kind: str, name: str, sql: str, stored: str = "TEXT") -> str:
    table = "trees" if kind == "trigger" else name
    return f"INSERT INTO sqlite_master VALUES ('{kind}', '{name}', '{table}', 0, CAST('{sql}' AS {stored}))"


@pytest.mark.parametrize(
    ("statement", "words"),
    [
        (entry("table", "out", 'CREATE VIRTUAL TABLE out USING VirtualOGR("/etc/passwd")'), "virtual table"),
        (entry("table", "out", 'CREATE VIRTUAL TABLE out USING VirtualOGR("/etc/passwd")', "BLOB"), "virtual table"),
        (entry("table", "out", "CREATE VIRTUAL TABLE out USING csv(filename=/etc/passwd)"), "virtual table"),
        (entry("table", "out", "CREATE/*a*/VIRTUAL TABLE out USING csv(filename=/etc/passwd)"), "virtual table"),
        (entry("table", "out", 'CREATE VIRTUAL TABLE out USING csv("/etc/passwd", " USING rtree")'), "virtual table"),
        (
            "CREATE VIEW v AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n",
            "computes",
        ),
        ("CREATE VIEW v AS WITH n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n", "computes"),
        ("ALTER TABLE trees ADD COLUMN vast AS (zeroblob(1000000000))", "computes 'vast'"),
    ],
)
def test_a_geopackage_that_computes_its_content(statement: str, words: str, tmp_path: Path) -> None:
    path = geopackage(tmp_path / "s" / "raw-detections.gpkg", statement)
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=words):
        read_survey(path.parent)
    with pytest.raises(InputError, match=words):
        move_vector(path, Motion(FRAME.crs, Rigid(np.eye(2), (0.0, 0.0))), tmp_path / "out")


@pytest.mark.parametrize(
    "statement",
    [
        entry("trigger", "t", "CREATE" + 60 * "/**/" + "TRIGGER t AFTER UPDATE ON trees BEGIN SELECT 1; END"),
        f"CREATE TABLE t (x /* {30_000 * 'with '}{30_000 * 'as '} */)",
    ],
)
def test_a_definition_is_looked_over_at_once(statement: str, tmp_path: Path) -> None:
    """Where each word more takes as long as all before, this does not end."""
    check_geopackage(geopackage(tmp_path / "raw-detections.gpkg", statement))


@pytest.mark.parametrize("virtual", ["[other one]", "`other one`", '"other one"', "other"])
def test_an_index_of_any_name_is_no_harm(virtual: str, tmp_path: Path) -> None:
    path = geopackage(tmp_path / "raw-detections.gpkg", f"CREATE VIRTUAL TABLE {virtual} USING rtree(id, a, b)")
    assert len(read_survey(path.parent).features) == 12


@pytest.mark.parametrize("stored", ["TEXT", "BLOB"])
def test_a_geopackage_with_views_is_moved_but_not_read(stored: str, tmp_path: Path) -> None:
    """GDAL asks every view for its columns, and one over many tables need not come to an end."""
    tables = ", ".join(f"sqlite_master a{k}" for k in range(12))
    nothing = " || ".join(f"a{k}.name" for k in range(12))
    view = f"CREATE VIEW v AS SELECT a0.rowid AS fid FROM {tables} WHERE {nothing} = 0"
    path = geopackage(tmp_path / "s" / "raw-detections.gpkg", entry("view", "v", view, stored))
    with pytest.raises(InputError, match="computes 'v'"):
        read_survey(path.parent)
    (tmp_path / "out").mkdir()
    move_vector(path, Motion(FRAME.crs, Rigid(np.eye(2), (0.0, 0.0))), tmp_path / "out")
    assert (tmp_path / "out" / path.name).exists()


def test_a_geopackage_whose_pages_are_used_again_and_again(tmp_path: Path) -> None:
    more = "INSERT INTO trees (geom, confidence, name) SELECT geom, confidence, zeroblob(500) FROM trees"
    path = geopackage(tmp_path / "raw-detections.gpkg", "DROP TRIGGER rtree_trees_geom_insert", *[more] * 4)
    with closing(sqlite3.connect(path)) as database:
        ((root,),) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'trees'")
        ((size,),) = database.execute("PRAGMA page_size")
    content = bytearray(path.read_bytes())
    begin = (root - 1) * size
    assert content[begin] == 5  # an inner page
    (count,) = struct.unpack_from(">H", content, begin + 3)
    cells = [begin + at for at in struct.unpack_from(f">{count}H", content, begin + 12)]
    for cell in cells[1:]:
        content[cell : cell + 4] = content[cells[0] : cells[0] + 4]
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"raw-detections\.gpkg is damaged"):
        read_survey(tmp_path)


@pytest.mark.parametrize("code", [struct.pack("<BII", 1, 7, 1), struct.pack(">BIII", 0, 0xA0000006, 4326, 1)])
def test_geometry_in_geometry_takes_no_stack(code: bytes, tmp_path: Path) -> None:
    """A million collections, each in the next, take the stack of a process that reads them one in the other."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    deep = code * 1_000_000
    packed, table = tmp_path / "g", tmp_path / "p"
    triggers = (f"DROP TRIGGER rtree_trees_geom_update{k}" for k in (2, 4, 5, 6, 7))
    path = geopackage(packed / "raw-detections.gpkg", *triggers)
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE trees SET geom = ? WHERE fid = 3", (b"GP\0\1" + struct.pack("<i", 32734) + deep,))
        database.commit()
    table.mkdir()
    TARGETS["geoparquet"].write(table, valid("geoparquet"))
    (parquet,) = table.iterdir()
    whole = pq.read_table(parquet)
    at = whole.schema.get_field_index("geometry")
    column = [deep, *whole.column(at).to_pylist()[1:]]
    pq.write_table(whole.set_column(at, whole.schema.field(at), pa.array(column, pa.binary())), parquet)
    (tmp_path / "out").mkdir()
    for file, feature in ((path, 2), (parquet, 0)):
        with pytest.raises(InputError, match=f"feature {feature} .* nested too deeply"):
            read_survey(file.parent)
        with pytest.raises(InputError, match="nested too deeply"):
            move_vector(file, Motion(FRAME.crs, Rigid(np.eye(2), (0.0, 0.0))), tmp_path / "out")


@pytest.mark.parametrize(
    "where", ["dem_10cm.tif.aux.xml", "dem_10cm.aux", "dem_10cm.xml", "raw-detections.gpkg-journal"]
)
def test_nobody_waits_for_a_pipe(where: str, tmp_path: Path) -> None:
    geopackage(tmp_path / "raw-detections.gpkg")
    (tmp_path / "dem_10cm.tif").write_bytes(valid("raster"))
    os.mkfifo(tmp_path / where)
    with pytest.raises(InputError, match="is no file; remove it"):
        read_survey(tmp_path)


def test_a_geopackage_attaches_nothing(tmp_path: Path) -> None:
    """SQLite takes no ATTACH in what a file stores; one that is there all the same makes it damaged."""
    text = f'CREATE TRIGGER t AFTER UPDATE ON trees BEGIN ATTACH "{tmp_path / "made"}" AS other; END'
    path = geopackage(tmp_path / "s" / "raw-detections.gpkg", entry("trigger", "t", text))
    with pytest.raises(InputError, match=r"raw-detections\.gpkg .* near \"ATTACH\""):
        read_survey(path.parent)
    assert not (tmp_path / "made").exists()


def test_a_table_that_would_become_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from treereg_core.io import untrusted

    folder = tmp_path / "s"
    folder.mkdir()
    TARGETS["geoparquet"].write(folder, valid("geoparquet"))
    assert len(read_survey(folder).features) == 12
    for name, limit in (("MOST_ROWS", 11), ("LARGEST_TABLE", 1_000)):
        with monkeypatch.context() as patch:
            patch.setattr(untrusted, name, limit)
            with pytest.raises(InputError, match="12 rows"):
                read_survey(folder)


@pytest.mark.parametrize("name", ["raw-detections.geojson", "raw-detections.gpkg", "raw-detections.parquet"])
def test_a_file_of_impossible_size_is_refused_unread(name: str, tmp_path: Path) -> None:
    starts = {".geojson": b"{", ".gpkg": b"SQLite format 3\0", ".parquet": b"PAR1"}
    folder = tmp_path / "s"
    folder.mkdir()
    with (folder / name).open("wb") as file:
        file.write(starts[Path(name).suffix])
        file.truncate(5 * 2**30)
    with pytest.raises(InputError, match="too much to be true"):
        read_survey(folder)


@pytest.mark.parametrize(
    "crs",
    [
        "+proj=longlat +ellps=bessel +nadgrids=/etc/hostname +type=crs",
        "+proj=longlat +ellps=bessel +geoidgrids=/vsicurl/http://127.0.0.1/a.gtx +type=crs",
        "+proj=longlat +ellps=bessel +nadgrids=@null,/etc/hostname +type=crs",
        "+init=/etc/hostname:1",
        "epsg:4326 +init=a +init=/etc/hostname:1",
    ],
)
def test_a_crs_names_no_file(crs: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="names another file"):
        parse_crs(crs, tmp_path / "a.geojson")
    assert parse_crs("EPSG:3857", tmp_path / "a.geojson").is_projected


def test_a_crs_is_looked_over_at_once(tmp_path: Path) -> None:
    """In time that grows with the square of the text, this does not end."""
    check_no_files(2_000_000 * "init=", tmp_path / "a.geojson")


class Harmful:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


def test_a_memory_runs_nothing(tmp_path: Path) -> None:
    folder, made = tmp_path / "memory", tmp_path / "made"
    folder.mkdir()
    harm = pickle.dumps(Harmful(made))
    for name in ("memory.pkl", "bn_rows.pickle", "state.joblib", "__init__.py", "conftest.py"):
        (folder / name).write_bytes(harm)
    (folder / "memory.json").write_bytes(valid("memory"))
    assert load(folder) is not None
    (folder / "memory.json").write_bytes(harm)
    with pytest.raises(InputError, match="cannot be used as a memory"):
        load(folder)
    document = json.loads(valid("memory"))
    document["methods"]["bn_rows"]["by"] = "__import__('os').system('touch made') 0.1.0"
    (folder / "memory.json").write_text(json.dumps(document))
    assert load(folder) is not None
    assert not made.exists()
