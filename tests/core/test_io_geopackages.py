"""GeoPackages as QGIS, GDAL and others leave them are read, and moved with all that is in them."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from io_files import CRS, table

from treereg_core.errors import InputError
from treereg_core.io import Motion, move_vector, read_survey, unchanged
from treereg_core.transform import Rigid

LAYER = "raw-detections"
STYLES = (
    """CREATE TABLE "layer_styles" ("id" INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, "f_table_name" TEXT(256),
    "f_geometry_column" TEXT(256), "styleQML" TEXT, "useAsDefault" BOOLEAN,
    "update_time" DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')))""",
    f"INSERT INTO layer_styles (f_table_name, f_geometry_column, styleQML) VALUES ('{LAYER}', 'geom', '<qgis/>')",
)
ORDINARY = {
    "styles of QGIS": (
        *STYLES,
        "INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('layer_styles', 'attributes', 'styles')",
    ),
    "styles that no table tells of": STYLES,
    "a project of QGIS": ("CREATE TABLE qgis_projects (name TEXT PRIMARY KEY, metadata BLOB, content BLOB)",),
    "checks of the standard": (
        "CREATE TABLE gpkg_metadata (id INTEGER PRIMARY KEY, md_scope TEXT NOT NULL DEFAULT 'dataset')",
        """CREATE TRIGGER gpkg_metadata_md_scope_insert BEFORE INSERT ON gpkg_metadata FOR EACH ROW BEGIN
        SELECT RAISE(ABORT, 'insert on table gpkg_metadata violates constraint: md_scope must be one of undefined')
        WHERE NOT (NEW.md_scope IN ('undefined', 'dataset')); END""",
    ),
    "a search of texts": ("CREATE VIRTUAL TABLE words USING fts5(name)",),
}


def geopackage(folder: Path, *statements: str) -> Path:
    path = table(folder, "gpkg", CRS) / f"{LAYER}.gpkg"
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()
    return path


def moved(path: Path, folder: Path) -> Path:
    """The file, moved by a metre; its pages are sound and it is the only thing that is written."""
    folder.mkdir()
    move_vector(path, Motion(CRS, Rigid(np.eye(2), (1.0, 0.0))), folder)
    assert [entry.name for entry in folder.iterdir()] == [path.name]
    with closing(sqlite3.connect(folder / path.name)) as database:
        assert database.execute("PRAGMA quick_check").fetchone() == ("ok",)
    there, here = read_survey(folder), read_survey(path.parent)
    np.testing.assert_allclose(there.features.xy + there.frame.origin, here.features.xy + here.frame.origin + (1, 0))
    return folder / path.name


@pytest.mark.parametrize("statements", ORDINARY.values(), ids=ORDINARY)
def test_what_other_programs_add_is_no_harm_and_stays(statements: tuple[str, ...], tmp_path: Path) -> None:
    path = geopackage(tmp_path / "s", *statements)
    assert len(read_survey(path.parent).features) == 12
    names = []
    for file in (path, moved(path, tmp_path / "out")):
        with closing(sqlite3.connect(file)) as database:
            names.append(database.execute("SELECT name, sql FROM sqlite_master ORDER BY name").fetchall())
    assert names[0] == names[1]


def with_log(folder: Path) -> Path:
    """One that keeps a log of changes beside it, as QGIS has while it is open; nothing is in the log."""
    path = geopackage(folder)
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
    return path


def change(database: sqlite3.Connection) -> None:
    """Every confidence half of it; what is in the log is so until the database is closed."""
    for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):  # which triggers may ask for
        database.create_function(name, 1, lambda blob: 0)
    database.execute(f"UPDATE '{LAYER}' SET confidence = confidence / 2")
    database.commit()


def test_with_a_log_of_changes(tmp_path: Path) -> None:
    path = with_log(tmp_path / "s")
    assert read_survey(path.parent).features.confidence[0] == 0.5
    with closing(sqlite3.connect(path)) as other:
        change(other)
        assert Path(f"{path}-wal").stat().st_size
        survey = read_survey(path.parent)
        assert survey.features.confidence[0] == 0.25
        with pytest.raises(InputError, match=r"gpkg-wal was changed while it was used"), unchanged(survey.stamps):
            change(other)
        assert read_survey(moved(path, tmp_path / "out").parent).features.confidence[0] == 0.125


def test_one_that_another_program_holds(tmp_path: Path) -> None:
    path = geopackage(tmp_path / "s")
    with closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(InputError, match=r"raw-detections\.gpkg is in use by another program"):
            read_survey(path.parent)


def test_a_log_that_a_program_left_when_it_crashed_stays_as_it_is(tmp_path: Path) -> None:
    path = with_log(tmp_path / "s")
    with closing(sqlite3.connect(path)) as other:
        change(other)
        left = {file: file.read_bytes() for file in (path, Path(f"{path}-wal"))}
    for file, content in left.items():
        file.write_bytes(content)
    assert read_survey(path.parent).features.confidence[0] == 0.25
    assert {file: file.read_bytes() for file in left} == left


@contextmanager
def only_read(folder: Path) -> Iterator[None]:
    """Whoever we are, nothing can be made in this folder."""
    folder.chmod(0o555)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)
        folder.chmod(0o755)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="the system has other permissions")
def test_with_a_log_in_a_folder_that_is_only_read(tmp_path: Path) -> None:
    read_survey(with_log(tmp_path / "s").parent)  # what is imported once
    with TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        path, out = with_log(Path(name) / "s"), Path(name) / "out"
        out.mkdir()
        out.chmod(0o777)
        with only_read(path.parent):
            assert len(read_survey(path.parent).features) == 12
            move_vector(path, Motion(CRS, Rigid(np.eye(2), (1.0, 0.0))), out)
        with closing(sqlite3.connect(path)) as other:
            change(other)
            shutil.copy(f"{path}-wal", out / "log")
        shutil.copy(out / "log", f"{path}-wal")
        with only_read(path.parent), pytest.raises(InputError, match="into a folder that can be written"):
            read_survey(path.parent)
