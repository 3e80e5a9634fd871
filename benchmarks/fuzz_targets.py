"""What is fuzzed: each kind of file that is read from outside, a valid one, how to spoil it, and what reads it."""

from __future__ import annotations

import io as streams
import json
import os
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import astuple, dataclass
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.mutations import mutated_bytes, mutated_json, mutated_text
from treereg_core import io, memory
from treereg_core.batch.manifest import read_manifest
from treereg_core.batch.order import RECORD, Order, Work
from treereg_core.batch.order import SCHEMA as BATCH_SCHEMA
from treereg_core.batch.outcome import Outcome, Word
from treereg_core.cli import main
from treereg_core.errors import UsageError
from treereg_core.evaluation.log import FIXED, read
from treereg_core.options import Options
from treereg_core.report.data import SCHEMA
from treereg_core.report.files import NEEDED
from treereg_core.series.files import SCHEMA as SERIES_SCHEMA
from treereg_core.series.files import SERIES, names_of_earlier
from treereg_core.survey import Frame
from treereg_core.transform import Rigid

FRAME = Frame("EPSG:32734", (343_000.0, 6_306_000.0))
DETECTIONS, BOUNDARY = "raw-detections.geojson", "boundary.geojson"
SURVEYS = (f"reference/{DETECTIONS}", f"source/{DETECTIONS}")
Spoil = Callable[[bytes, Random], bytes]
Use = Callable[[Path], object]


@dataclass(frozen=True)
class Target:
    """One kind of file: its name in a folder, whether the valid files of a survey stand beside it, and its use.

    `use` is given the folder; it returns, or raises a `TreeregError`. One that starts processes is `slow`, and gets few
    of the inputs.
    """

    file: str
    valid: Callable[[], bytes]
    spoil: Spoil
    use: Use
    beside: tuple[str, ...] = ()
    slow: bool = False

    def write(self, folder: Path, content: bytes) -> None:
        """Lay out a folder with this content in the file."""
        for name, held in {**{name: _valid(name) for name in self.beside}, self.file: content}.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(held)


def _command(*arguments: str) -> Use:
    """The real command, `{}` being the folder: exit code 0 or 3, or 2 with one sentence, and nothing else."""

    def use(folder: Path) -> None:
        told = streams.StringIO()
        with redirect_stderr(told), redirect_stdout(streams.StringIO()):
            code = main([argument.replace("{}", str(folder)) for argument in arguments])
        last = [line for line in told.getvalue().splitlines() if line.startswith("treereg: ")]
        if code not in (0, 2, 3) or "Traceback" in told.getvalue():
            raise AssertionError(f"exit code {code}: {told.getvalue()[-2000:]}")
        if code == 2:
            if len(last) != 1:
                raise AssertionError(f"not one sentence: {told.getvalue()[-2000:]}")
            raise UsageError(last[0])

    return use


def _run(*arguments: str) -> Use:
    """`treereg run` without what only takes time here."""
    return _command("run", *arguments, "--out", "{}-out", "--overwrite", "--no-report")


def _use_transform(folder: Path) -> None:
    io.read_transform(folder / "registration.json", FRAME)
    io.read_motion(folder / "registration.json", force=True)


def _use_rival(folder: Path) -> None:
    io.read_motion(folder / "registration.json", rival=1)


def _use_memory(folder: Path) -> None:
    survey = memory.Visit("0" * 31 + "2", "source", _grid(), FRAME)
    known = memory.load(folder)
    if known is not None:
        memory.check_methods(folder, known, {"bn_rows": "treereg-bn-rows 0.1.0"})
        memory.check_orchard(folder, known, survey, survey)


def _use_record(folder: Path) -> None:
    """The record of a batch, where it is the right one and where it is of other work."""
    work = Work(Options(method="icp"), {})
    order = Order("north", folder, folder, folder, work)
    record = folder / RECORD
    _ = order.done
    record.write_bytes(record.read_bytes().replace(b"OF THIS WORK", order.digest.encode()))
    _ = order.done


def _use_series(folder: Path) -> None:
    """What a series does to the folder of an earlier one."""
    with io.OutputFolder(folder, overwrite=True, names=names_of_earlier(folder)):
        pass


def _use_moved(name: str, folder: Path) -> None:
    with TemporaryDirectory(dir=folder) as out:
        motion = io.Motion(FRAME.crs, Rigid(np.eye(2), (1.0, 2.0)))
        io.move_vector(folder / name, motion, Path(out))


def _use_raster(folder: Path) -> None:
    io.read_survey(folder)
    io.read_raster(folder / "dem_10cm.tif")


def _spoil_parquet(content: bytes, chance: Random) -> bytes:
    """The description of the geometry spoiled in an otherwise sound file, or bytes changed."""
    import pyarrow.parquet as pq

    if chance.randrange(2):
        return mutated_bytes(content, chance)
    table = pq.read_table(streams.BytesIO(content))
    known = dict(table.schema.metadata)
    known[b"geo"] = mutated_json(known[b"geo"], chance)
    changed = streams.BytesIO()
    pq.write_table(table.replace_schema_metadata(known), changed)
    return changed.getvalue()


def _spoil_geopackage(content: bytes, chance: Random) -> bytes:
    """Cells of the tables spoiled in an otherwise sound database, or bytes changed."""
    import sqlite3
    from contextlib import closing

    if chance.randrange(2):
        return mutated_bytes(content, chance)
    with closing(sqlite3.connect(":memory:")) as database:
        database.deserialize(content)
        for trigger in database.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            database.execute(f'DROP TRIGGER "{trigger[0]}"')
        columns = [
            (table, column)
            for table in ("trees", "gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys", "gpkg_extensions")
            for _, column, *_ in database.execute(f'PRAGMA table_info("{table}")')
        ]
        for _ in range(chance.randint(1, 3)):
            table, column = chance.choice(columns)
            cells = database.execute(f'SELECT "{column}" FROM "{table}" ORDER BY rowid').fetchall()
            old = chance.choice(cells) if cells else None
            new: Any = chance.choice((None, -1, 2**62, 1e308, "", "EPSG:1", "trees", b"", b"GP\0\1"))
            if old and isinstance(old[0], bytes):
                new = mutated_bytes(old[0], chance)
            if old and isinstance(old[0], str):
                new = mutated_text(old[0].encode(), chance).decode(errors="replace")
            try:
                database.execute(f'UPDATE "{table}" SET "{column}" = ? WHERE rowid % 3 = ?', (new, chance.randrange(3)))
            except sqlite3.Error:
                continue
        database.commit()
        return bytes(database.serialize())


def _grid() -> np.ndarray[Any, np.dtype[np.float64]]:
    rows = np.array([(3.0 * i, 5.0 * j) for j in range(3) for i in range(4)])
    return rows + np.random.default_rng(1).normal(0, 0.1, rows.shape)


def _frame_of_trees() -> Any:
    import geopandas
    import shapely

    xy = _grid() + np.array(FRAME.origin)
    shapes = [shapely.box(x - 1, y - 1, x + 1, y + 1) for x, y in xy]
    return geopandas.GeoDataFrame({"confidence": [0.5] * len(xy), "name": "a"}, geometry=shapes, crs=FRAME.crs)


def _file(suffix: str) -> bytes:
    """The trees as a vector file of this kind."""
    import pyogrio

    frame = _frame_of_trees()
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"trees{suffix}"
        if suffix == ".parquet":
            frame.to_parquet(path, write_covering_bbox=True)
        else:
            pyogrio.write_dataframe(frame, path)
        return path.read_bytes()


def _geojson() -> bytes:
    document = json.loads(_frame_of_trees().to_crs("OGC:CRS84").to_json())
    document["crs"] = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    return json.dumps(document).encode()


def _boundary() -> bytes:
    import shapely

    frame = _frame_of_trees().to_crs("OGC:CRS84")
    outline = json.loads(shapely.to_geojson(shapely.box(*frame.total_bounds)))
    return json.dumps({"type": "Feature", "properties": {}, "geometry": outline}).encode()


def _registration() -> bytes:
    matrix = [[1, 0, 2.5], [0, 1, -3.0], [0, 0, 1]]
    transform = {"model": "rigid", "matrix": matrix, "rotation_deg": 0.0, "translation_m": [2.5, -3.0]}
    document = {"schema": "treereg/registration/1", "crs": FRAME.crs, "verdict": "accepted", "transform": transform}
    return json.dumps({**document, "rivals": [{"matrix": matrix, "log_odds": -9.0}]}).encode()


def _memory() -> bytes:
    begun = memory.Memory.begun(memory.Visit("0" * 31 + "1", "reference", _grid(), FRAME))
    state = {"counts": {"a": [1, 2.5]}}
    taught = begun.taught("bn_rows", "treereg-bn-rows 0.1.0", ("0" * 31 + "1", "0" * 31 + "3"), {}, state)
    return json.dumps(taught.to_json()).encode()


@cache
def _taught() -> dict[str, bytes]:
    """Two surveys of a small orchard and the memory that they left, by their names in a folder."""
    from treereg_core import register
    from treereg_core.simulate import Scene, simulate, write_simulation

    scene = Scene(trees=80, jitter=0.05, area_persistence=0.9, rotation=1.0, shift=(1.0, 0.5))
    names = (*SURVEYS, "memory/memory.json")
    with TemporaryDirectory() as folder:
        write_simulation(simulate(scene, 1), Path(folder))
        surveys = Path(folder) / "reference", Path(folder) / "source"
        register(*surveys, method="bn_landmarks+icp", start="identity", memory=Path(folder) / "memory")
        return {name: (Path(folder) / name).read_bytes() for name in names}


def _truth() -> bytes:
    transform = json.loads(_registration())["transform"]
    return json.dumps({"schema": "treereg/truth/1", "crs": FRAME.crs, "transform": transform, "trees": []}).encode()


def _record() -> bytes:
    outcome = Outcome("north", Word.ACCEPTED, "it fits.", matched=12, expected_error=0.1).to_json()
    record = {"schema": BATCH_SCHEMA, "digest": "OF THIS WORK", "files": {DETECTIONS: len(_valid(DETECTIONS))}}
    return json.dumps({**record, "outcome": outcome}).encode()


def _series() -> bytes:
    surveys = [{"name": name, "verdict": "accepted"} for name in ("2021", "2022")]
    return json.dumps({"schema": SERIES_SCHEMA, "surveys": surveys, "memory": ["memory.json", "a.bif"]}).encode()


def _report() -> bytes:
    data: dict[str, Any] = {name: {"a": [1, "</script>", None]} for name in sorted(NEEDED)}
    return json.dumps({"schema": SCHEMA, **data}).encode()


def _trials() -> bytes:
    from treereg_core.evaluation.trial import Trial

    values = [*astuple(Trial("icp", "coarse", "a", "b", 1, 9, 0.1, 0.2, 0.3, "accepted"))[:-1], 1.5]
    rows = [[*FIXED, "truth.rms"], *[[str(value) for value in values]] * 4]
    return "\n".join(",".join(row) for row in rows).encode()


def _raster() -> bytes:
    from rasterio.io import MemoryFile
    from rasterio.transform import Affine as Geotransform

    east, north = FRAME.origin
    heights = np.random.default_rng(2).random((40, 40), dtype=np.float32)
    profile = {"driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float32", "crs": FRAME.crs}
    where = Geotransform(0.5, 0.0, east - 4, 0.0, -0.5, north + 15)
    with MemoryFile() as file:
        with file.open(**profile, transform=where, compress="deflate", nodata=-9999) as dataset:
            dataset.write(heights, 1)
        return bytes(file.read())


CONFIG = b"""method = "icp"
max-failure = 0.01
seed = 3
model = "rigid"
start = "coarse"
[icp]
reach = 1.5
[judge]
[coarse]
"""
MANIFEST = b'orchard,reference,source\nnorth,a/2023,a/2024\nsouth,b/2023,b/2024\n"e, w",c,d\n'
CHECKPOINTS = b"reference_x,reference_y,source_x,source_y\n343001,6306002,343002,6306003\n343009,6306008,343001,6306\n"


@cache
def _valid(name: str) -> bytes:
    """A valid file that stands beside another."""
    if name in SURVEYS:
        return _taught()[name]
    return _geojson() if name == DETECTIONS else _boundary()


_detections = partial(_valid, DETECTIONS)
TARGETS: dict[str, Target] = {
    "detections": Target(DETECTIONS, _detections, mutated_json, io.read_survey, (BOUNDARY,)),
    "detections-text": Target(DETECTIONS, _detections, mutated_bytes, io.read_survey),
    "detections-command": Target(
        DETECTIONS, _detections, mutated_json, _command("misregister", "{}", "--out", "{}-out", "--overwrite")
    ),
    "geopackage": Target("raw-detections.gpkg", partial(_file, ".gpkg"), _spoil_geopackage, io.read_survey),
    "geoparquet": Target("raw-detections.parquet", partial(_file, ".parquet"), _spoil_parquet, io.read_survey),
    "boundary": Target(BOUNDARY, partial(_valid, BOUNDARY), mutated_json, io.read_survey, (DETECTIONS,)),
    "transform": Target("registration.json", _registration, mutated_json, _use_transform),
    "rival": Target("registration.json", _registration, mutated_json, _use_rival),
    "transform-command": Target(
        "registration.json",
        _registration,
        mutated_json,
        _command("apply", "{}/registration.json", "{}/" + DETECTIONS, "--out", "{}-out", "--overwrite"),
        (DETECTIONS,),
    ),
    "memory": Target("memory.json", _memory, mutated_json, _use_memory),
    "memory-command": Target(
        "memory/memory.json",
        lambda: _taught()["memory/memory.json"],
        mutated_json,
        _run(
            "{}/reference", "{}/source", "--memory", "{}/memory", "--method", "bn_landmarks+icp", "--start", "identity"
        ),
        SURVEYS,
    ),
    "truth-command": Target(
        "truth.json", _truth, mutated_json, _run("{}", "{}", "--start", "{}/truth.json"), (DETECTIONS,)
    ),
    "batch-command": Target(
        "manifest.csv",
        lambda: MANIFEST,
        mutated_text,
        _command("batch", "{}/manifest.csv", "--out", "{}-out", "--overwrite", "--jobs", "1"),
        slow=True,
    ),
    "batch-record": Target(RECORD, _record, mutated_json, _use_record, (DETECTIONS,)),
    "series-record": Target(SERIES, _series, mutated_json, _use_series, (DETECTIONS,)),
    "manifest": Target("manifest.csv", lambda: MANIFEST, mutated_text, lambda f: read_manifest(f / "manifest.csv")),
    "config-command": Target(
        "options.toml",
        lambda: CONFIG,
        mutated_text,
        _command("run", "{}/no", "{}/neither", "--config", "{}/options.toml", "--out", "{}-out"),
    ),
    "checkpoints": Target(
        "points.csv", lambda: CHECKPOINTS, mutated_text, lambda f: io.read_checkpoints(f / "points.csv", FRAME)
    ),
    "report-command": Target("report-data.json", _report, mutated_json, _command("report", "{}")),
    "trials": Target("trials.csv", _trials, mutated_text, lambda f: read(f / "trials.csv")),
    "raster": Target("dem_10cm.tif", _raster, mutated_bytes, _use_raster, (DETECTIONS,)),
    "moved-geojson": Target("a.geojson", _detections, mutated_json, partial(_use_moved, "a.geojson")),
    "moved-geopackage": Target("a.gpkg", partial(_file, ".gpkg"), _spoil_geopackage, partial(_use_moved, "a.gpkg")),
    "moved-geoparquet": Target(
        "a.parquet", partial(_file, ".parquet"), _spoil_parquet, partial(_use_moved, "a.parquet")
    ),
    "moved-shapefile": Target("a.shp", partial(_file, ".shp"), mutated_bytes, partial(_use_moved, "a.shp")),
}
"""By the name that the table has."""


@cache
def valid(name: str) -> bytes:
    """The valid file of a target."""
    return TARGETS[name].valid()


def spoiled(name: str, chance: Random) -> bytes:
    """The file of a target, spoiled."""
    return TARGETS[name].spoil(valid(name), chance)


def tried(name: str, content: bytes, folder: Path) -> None:
    """Use a file of this content; returns, or raises what the use raises."""
    there = folder / "in"
    there.mkdir()
    try:
        TARGETS[name].write(there, content)
        if name == "moved-shapefile":
            (there / "a.prj").write_text(_prj(), encoding="utf-8")
        TARGETS[name].use(there)
    finally:
        for made in (there, Path(f"{there}-out")):
            if os.path.lexists(made):
                shutil.rmtree(made)


@cache
def _prj() -> str:
    from pyproj import CRS

    return CRS.from_user_input(FRAME.crs).to_wkt("WKT1_ESRI")
