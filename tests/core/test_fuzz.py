"""Whatever a file holds: a result, or one sentence that says what is wrong with it. A longer run: `benchmarks.fuzz`."""

from __future__ import annotations

import contextlib
import json
import sqlite3
import warnings
from contextlib import closing
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from io_files import feature, polygon, raw, survey

from benchmarks import fuzz_guided
from benchmarks.fuzz_targets import FRAME, TARGETS, spoiled, tried, valid
from treereg_core.cli import main
from treereg_core.errors import InputError, TreeregError, UsageError
from treereg_core.evaluation.log import read
from treereg_core.heights import HEIGHT
from treereg_core.io import move_vector, read_survey
from treereg_core.io.crs import WGS84, converter
from treereg_core.io.grid import Motion
from treereg_core.memory import load
from treereg_core.report.files import write_page
from treereg_core.transform import Rigid


@pytest.mark.parametrize("name", TARGETS)
def test_the_valid_file_is_accepted(name: str, tmp_path: Path) -> None:
    if name == "config-command":  # it goes on to surveys that are not there
        with pytest.raises(UsageError, match="no such folder"):
            tried(name, valid(name), tmp_path)
    else:
        tried(name, valid(name), tmp_path)


@pytest.mark.parametrize("name", [name for name in TARGETS if not TARGETS[name].slow])
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(chance=st.randoms(use_true_random=False))
def test_a_spoiled_file_is_used_or_refused_in_a_sentence(name: str, chance: Random) -> None:
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            tried(name, spoiled(name, chance), Path(folder))
        except TreeregError as error:
            assert "\n" not in str(error), error  # noqa: PT017


@pytest.mark.parametrize("seed", range(3))
def test_a_spoiled_manifest_ends_a_batch_as_it_should(seed: int, tmp_path: Path) -> None:
    with contextlib.suppress(UsageError):
        tried("batch-command", spoiled("batch-command", Random(seed)), tmp_path)


def test_a_manifest_with_a_zero_byte_in_a_path(tmp_path: Path) -> None:
    refused(tmp_path, b"orchard,reference,source\nnorth,a\0,b\n", "batch-command", "line 2", "zero byte")


def test_a_path_too_long_for_the_system_is_one_row_of_a_batch_and_no_start(tmp_path: Path) -> None:
    tried("batch-command", b"orchard,reference,source\nnorth," + b"a" * 5000 + b",b\nsouth,c,d\n", tmp_path)
    refused(tmp_path, b'start = "' + b"a" * 5000 + b'.json"', "config-command", "there is no such file")


@pytest.mark.parametrize("content", [b"[" * 100_000, b'{"files": {"\\u0000": 1}}', b"\xff"])
def test_a_record_of_a_batch_that_is_none_is_not_believed(content: bytes, tmp_path: Path) -> None:
    tried("batch-record", content, tmp_path)


@pytest.mark.parametrize("name", ["", "/", "..", "\0", "[", "**"])
def test_what_an_earlier_series_is_said_to_have_left_stays_in_its_folder(name: str, tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "registration.json").touch()
    content = changed("series-record", surveys=[{"name": name}], memory=[name, "../kept/registration.json"])
    tried("series-record", content, tmp_path)
    assert (tmp_path / "kept" / "registration.json").exists()


def test_a_series_told_of_in_nested_values_is_none(tmp_path: Path) -> None:
    tried("series-record", b"[" * 100_000, tmp_path)


def refused(folder: Path, content: bytes, name: str, *words: str) -> None:
    with pytest.raises(TreeregError) as caught:
        tried(name, content, folder)
    assert all(word in str(caught.value) for word in words), caught.value


def changed(name: str, **members: object) -> bytes:
    return json.dumps({**json.loads(valid(name)), **members}).encode()


def test_a_crs_of_half_a_letter(tmp_path: Path) -> None:
    refused(tmp_path, changed("transform", crs="\ud800"), "transform", "unknown CRS", "ud800")
    member = {"type": "name", "properties": {"name": "\ud800"}}
    refused(tmp_path, changed("detections", crs=member), "detections", "unknown CRS", "ud800")


@pytest.mark.parametrize("crs", ["EPSG:327342734", "", "+proj=utm +zone=99"])
def test_a_memory_in_an_unknown_crs(crs: str, tmp_path: Path) -> None:
    (tmp_path / "memory.json").write_bytes(changed("memory", crs=crs))
    with pytest.raises(InputError, match="unknown CRS"):
        load(tmp_path)


def test_a_report_of_what_is_no_number(tmp_path: Path) -> None:
    (tmp_path / "report-data.json").write_bytes(changed("report-command", timings_s=float("nan")))
    with pytest.raises(InputError, match="not finite"):
        write_page(tmp_path)


@pytest.mark.parametrize("spoil", [lambda c: b"\xff" + c, lambda c: c[:9] + b"\x80" + c[9:], lambda c: c + b"\n\xfe"])
def test_trials_that_are_no_text(spoil: object, tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_bytes(spoil(valid("trials")))  # type: ignore[operator]
    with pytest.raises(UsageError, match=r"trials\.csv"):
        read(tmp_path / "trials.csv")


def test_elevations_that_cannot_be_are_none(tmp_path: Path) -> None:
    import rasterio

    folder = tmp_path / "s"
    folder.mkdir()
    TARGETS["raster"].write(folder, valid("raster"))
    with rasterio.open(folder / "dem_10cm.tif", "r+") as file:
        values = file.read(1)
        values[::2] = 1e38
        values[1::4] = -1e38
        file.write(values, 1)
    height = read_survey(folder).features.attributes.get(HEIGHT, np.array([]))
    assert not (np.abs(height) > 1).any()


def test_a_geopackage_that_another_program_holds_is_not_waited_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from treereg_core.io import geopackage

    monkeypatch.setattr(geopackage, "LONGEST_WAIT", 1)
    path = tmp_path / "a.gpkg"
    path.write_bytes(valid("geopackage"))
    (tmp_path / "out").mkdir()
    monkeypatch.setattr(geopackage, "check_geopackage", lambda path, views: None)
    monkeypatch.setattr(geopackage, "open_database", sqlite3.connect)
    with closing(sqlite3.connect(path)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(InputError, match=r"another program"):
            move_vector(path, Motion(FRAME.crs, Rigid(np.eye(2), (0.0, 0.0))), tmp_path / "out")


def test_a_crs_from_which_there_is_no_way() -> None:
    local = 'ENGCRS["a",EDATUM["b"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],LENGTHUNIT["metre",1]]'
    with pytest.raises(InputError, match="no way from the CRS"):
        converter(local, WGS84)


def test_what_lies_out_of_reach_of_the_transform_is_refused_without_a_warning(tmp_path: Path) -> None:
    ring = [[-161.0, 89.0], [-161.1, 89.0], [-161.1, 89.1], [-161.0, 89.0]]
    content = changed("moved-geojson", features=[feature(polygon(ring)), feature(polygon([[1e9, 1e9]] * 4))])
    refused(tmp_path, content, "moved-geojson", "does not reach")


def test_deep_nesting_ends_with_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = raw(tmp_path / "s", "[" * 100_000 + "]" * 100_000)
    assert main(["run", str(folder), str(survey(tmp_path / "t")), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "nested too deeply" in told
    assert "Traceback" not in told


def test_guided_fuzzing_says_what_it_lacks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(fuzz_guided, "find_spec", lambda name: None)
    monkeypatch.setattr("sys.argv", ["fuzz_guided"])
    with pytest.raises(SystemExit):
        fuzz_guided.main()
    assert "--with atheris" in capsys.readouterr().err
