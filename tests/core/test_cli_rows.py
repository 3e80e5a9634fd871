"""`treereg rows` from the outside, and `detect_rows`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from tests.core.io_files import CRS, ORIGIN, survey, trees
from tests.core.methods import REGISTRY, Sure
from treereg_core import io
from treereg_core.cli import main
from treereg_core.detection import detect_rows
from treereg_core.errors import InputError, NoRegistration, UsageError
from treereg_core.features import FeatureSet
from treereg_core.method import Context, Method, RowDetector
from treereg_core.options import defaults
from treereg_core.pair import Rows
from treereg_core.recipe import Recipe
from treereg_core.registry import Entry, Registry, installed
from treereg_core.simulate import Scene, simulate, write_simulation

Output = pytest.CaptureFixture[str]


class Alone(Sure):
    """Keeps confident trees, of one survey too."""

    name = "alone"
    needs_pair = False


class Alleys(RowDetector):
    """Rows run north, with an alley of more than 2 m between them; given in a disorderly way."""

    name = "alleys"
    alley: float = 2.0

    def detect(self, features: FeatureSet, context: Context) -> Rows:
        order = np.argsort(features.xy[:, 0])
        rows = np.split(order, np.flatnonzero(np.diff(features.xy[order, 0]) > self.alley) + 1)
        rows = [features.ids[row[np.argsort(features.xy[row, 1])]] for row in rows]
        shuffled = [rows[k] for k in context.rng("shuffle").permutation(len(rows))]
        return Rows(tuple(shuffled))


class Forest(RowDetector):
    """Never finds a row."""

    name = "forest"
    says: bool = True

    def detect(self, features: FeatureSet, context: Context) -> Rows:
        if self.says:
            raise NoRegistration("the trees stand in no rows")
        return Rows(())


def entry(method: type[Method]) -> Entry:
    return Entry(method.name, method.role, "test", "1", method)


INSTALLED = Registry(
    (
        *(entry(method) for method in (Alone, Alleys, Forest)),
        *(found for found in REGISTRY.entries if found.name not in ("columns", "lines")),
        Entry("clean", "recipe", "test", "1", Recipe("clean", "alone+alleys", "both", {"alone": {"least": 0.2}})),
    )
)
ALLEYS = ["--method", "alleys"]
XY = np.array([(5.0 * row, -3.0 * tree) for row in range(4) for tree in range(6)])
"""Rows that run south, the westernmost first: in the order in which they are counted."""


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("treereg_core.cli.rows.installed", lambda: INSTALLED)
    monkeypatch.setattr("treereg_core.detection.installed", lambda: INSTALLED)


@pytest.fixture
def field(tmp_path: Path) -> Path:
    """Four rows of six trees, the second of which has lost its third tree; the first feature has no geometry."""
    features = trees(XY + np.random.default_rng(1).normal(0, 0.1, XY.shape))
    features[8]["properties"]["confidence"] = 0.1
    return survey(
        tmp_path / "field", [{"type": "Feature", "properties": {"confidence": 0.5}, "geometry": None}, *features]
    )


def found(path: str = "rows.geojson") -> list[dict[str, Any]]:
    document = json.loads(Path(path).read_text())
    assert document["type"] == "FeatureCollection"
    return list(document["features"])


def projected(feature: dict[str, Any]) -> np.ndarray:
    """The vertices of a line, metres about the orchard's corner."""
    to_utm = pyproj.Transformer.from_crs("OGC:CRS84", CRS, always_xy=True)
    return np.column_stack(to_utm.transform(*np.transpose(feature["geometry"]["coordinates"]))) - ORIGIN


def test_one_line_per_row_numbered_from_the_north_west(field: Path) -> None:
    assert main(["rows", "field", *ALLEYS, "-q"]) == 0
    lines = found()
    assert [line["properties"]["row"] for line in lines] == [1, 2, 3, 4]
    assert [line["properties"]["trees"] for line in lines] == [list(range(1 + 6 * k, 7 + 6 * k)) for k in range(4)]
    centroids = {int(i): xy for i, xy in zip(*centroids_of(field), strict=True)}
    for line in lines:
        properties = line["properties"]
        assert properties["tree_numbers"] == [1, 2, 3, 4, 5, 6]
        assert line["geometry"]["type"] == "LineString"
        vertices = projected(line)
        assert np.allclose(vertices, [centroids[tree] for tree in properties["trees"]], atol=0.001)
        assert properties["length_m"] == pytest.approx(np.hypot(*np.diff(vertices, axis=0).T).sum(), abs=0.002)
        assert properties["length_m"] == pytest.approx(15, abs=1)


def centroids_of(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    read = io.read_survey(folder)
    return read.features.ids, read.features.xy + np.array(read.frame.origin) - ORIGIN


def test_who_found_them_is_named(field: Path, capsys: Output) -> None:
    assert main(["rows", "field", "--method", "clean"]) == 0
    document = json.loads(Path("rows.geojson").read_text())
    assert document["plugins"] == {"alleys": "test 1", "alone": "test 1", "clean": "test 1"}
    assert "clean (test 1)" in capsys.readouterr().out


def test_coordinates_have_nine_decimals(field: Path) -> None:
    assert main(["rows", "field", *ALLEYS, "-q"]) == 0
    numbers = [n for line in found() for vertex in line["geometry"]["coordinates"] for n in vertex]
    assert numbers == [round(n, 9) for n in numbers]
    assert any(round(n, 8) != n for n in numbers)


def test_filters_narrow_what_the_detector_sees(field: Path, capsys: Output) -> None:
    assert main(["rows", "field", "--method", "alone+alleys"]) == 0
    assert [line["properties"]["trees"] for line in found()][1] == [7, 8, 10, 11, 12]
    assert "23 of 24 (1 in none)" in capsys.readouterr().out
    assert main(["rows", "field", "--method", "alone+alleys", "--set", "alone.least=0", "--overwrite", "-q"]) == 0
    assert [len(line["properties"]["trees"]) for line in found()] == [6, 6, 6, 6]
    assert main(["rows", "field", "--method", "clean", "--out", "clean.geojson", "-q"]) == 0
    assert [len(line["properties"]["trees"]) for line in found("clean.geojson")] == [6, 5, 6, 6]


def test_a_tree_alone_is_no_row(field: Path) -> None:
    document = json.loads((field / "raw-detections.geojson").read_text())
    document["features"] = document["features"][:8]
    survey(field, document["features"])
    assert main(["rows", "field", *ALLEYS, "-q"]) == 0
    assert [line["properties"]["trees"] for line in found()] == [[1, 2, 3, 4, 5, 6]]


def test_what_is_said(field: Path, capsys: Output) -> None:
    assert main(["rows", "field", *ALLEYS]) == 0
    stdout, stderr = capsys.readouterr()
    said = stdout.splitlines()
    assert said[0] == "4 rows"
    assert "24 of 24 (0 in none)" in stdout
    assert said[-1].split() == ["file", "rows.geojson"]
    assert "1 dropped (1 without geometry)" in stderr
    assert "detect: alleys" in stderr
    assert main(["rows", "field", *ALLEYS, "-q", "--overwrite"]) == 0
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert [line for line in stderr.splitlines() if not line.startswith("warning: ")] == []


def test_options_from_a_file(field: Path) -> None:
    Path("rows.toml").write_text('method = "alone+alleys"\nout = "there/a.geojson"\nquiet = true\n[alone]\nleast = 0\n')
    assert main(["rows", "field", "--config", "rows.toml"]) == 0
    assert [len(line["properties"]["trees"]) for line in found("there/a.geojson")] == [6, 6, 6, 6]


def test_another_confidence_property(field: Path) -> None:
    text = (field / "raw-detections.geojson").read_text()
    (field / "raw-detections.geojson").write_text(text.replace('"confidence"', '"score"'))
    command = ["rows", "field", "--method", "alone+alleys", "--confidence-property", "score", "-q"]
    assert main(command) == 0
    assert [len(line["properties"]["trees"]) for line in found()] == [6, 5, 6, 6]


def test_the_same_command_gives_the_same_bytes_at_any_number_of_threads(field: Path) -> None:
    for threads in ("1", "2"):
        assert main(["rows", "field", *ALLEYS, "-q", "--out", f"{threads}.geojson", "--threads", threads]) == 0
    assert Path("1.geojson").read_bytes() == Path("2.geojson").read_bytes()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--method", "nearest"], "nearest (point matcher) needs two surveys, and here is one; the nearest"),
        (["--method", "alleys+nearest"], "needs two surveys, and here is one; the nearest expression"),
        (["--method", "alleys+same_rows"], "same_rows (row matcher) needs two surveys"),
        (["--method", "sure+alleys"], "sure (feature filter) needs two surveys"),
        (["--method", "sure+alleys"], "detects rows is 'alleys'."),
        (["--method", "alone"], "detects rows is 'alone+alleys'."),
        (["--method", "alone+nearest"], "detects rows is 'alone+alleys'."),
        (["--method", "alleys+alone"], "nothing after alone would see what it selects; the nearest"),
        (["--method", "alleys+forest"], "alleys and forest are both of the role row detector"),
        (["--method", "aleys"], "there is no method 'aleys'; the nearest expression that detects rows is 'alleys'."),
        (["--method", "middle"], "middle is of the role coarse aligner"),
        (["--method", "both"], "the recipe both stands for"),
        (["--method", "lost"], "'lost' cannot be used"),
        (["--set", "alone.least=1"], "alone.least: the stage 'alone' is not used here; there are: alleys."),
        (["--set", "alleys.ally=1"], "there is no setting alleys.ally; did you mean 'alley'?"),
        (["--seed", "-1"], "--seed is -1, but must be at least 0"),
        (["--threads", "0"], "--threads is 0, but must be at least 1"),
        (["--out", "rows.gpkg"], "--out rows.gpkg: rows are written as GeoJSON"),
        (["--out", "field/raw_detections.geojson"], "would be read as a file of a survey"),
        (["--out", "boundary.geojson"], "would be read as a file of a survey"),
        (["--out", "taken.geojson"], "taken.geojson is there already"),
        (["--out", "folder.geojson", "--overwrite"], "is a folder"),
        (["--start", "identity"], "No such option: --start"),
    ],
)  # fmt: skip
def test_bad_usage_is_one_sentence_and_leaves_nothing(
    options: list[str], sentence: str, field: Path, capsys: Output
) -> None:
    Path("taken.geojson").write_text("precious")
    Path("folder.geojson").mkdir()
    before = sorted(Path().rglob("*"))
    assert main(["rows", "field", *ALLEYS, *options]) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert sorted(Path().rglob("*")) == before
    assert Path("taken.geojson").read_text() == "precious"


def test_a_config_file_is_named_in_what_it_spoils(field: Path, capsys: Output) -> None:
    Path("rows.toml").write_text("seed = -1")
    assert main(["rows", "field", *ALLEYS, "--config", "rows.toml"]) == 2
    assert "--seed is -1, but must be at least 0 (options are read from rows.toml too)" in capsys.readouterr().err


def test_a_file_is_replaced_only_when_that_is_wanted_and_only_when_it_works(field: Path) -> None:
    assert main(["rows", "field", *ALLEYS, "-q"]) == 0
    before = Path("rows.geojson").read_bytes()
    assert main(["rows", "field", *ALLEYS, "-q"]) == 2
    assert main(["rows", "field", "--method", "forest", "-q", "--overwrite"]) == 2
    assert Path("rows.geojson").read_bytes() == before
    assert main(["rows", "field", "--method", "alone+alleys", "-q", "--overwrite"]) == 0
    assert Path("rows.geojson").read_bytes() != before


def test_a_place_that_cannot_be_written(field: Path, capsys: Output) -> None:
    Path("file").write_text("x")
    assert main(["rows", "field", *ALLEYS, "-q", "--out", "file/rows.geojson"]) == 2
    assert "file/rows.geojson cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("says", "reason"), [("true", "the trees stand in no rows"), ("false", "forest finds no rows")]
)
def test_a_survey_without_rows_is_named_and_nothing_is_written(
    says: str, reason: str, field: Path, capsys: Output
) -> None:
    assert main(["rows", "field", "--method", "forest", "--set", f"forest.says={says}", "-q"]) == 2
    stderr = capsys.readouterr().err
    (line,) = [line for line in stderr.splitlines() if not line.startswith("warning: ")]
    assert line.startswith(f"treereg: field/raw-detections.geojson shows no rows ({reason});")
    assert not Path("rows.geojson").exists()


def test_a_survey_that_cannot_be_read(capsys: Output) -> None:
    assert main(["rows", "absent", *ALLEYS, "-q"]) == 2
    assert capsys.readouterr().err == "treereg: absent: there is no such folder; check the path of the survey.\n"


def test_an_interrupted_run_leaves_nothing(field: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr("treereg_core.io.geojson_writing.json_line", interrupted)
    assert main(["rows", "field", *ALLEYS, "-q"]) == 130
    assert sorted(path.name for path in Path().iterdir()) == ["field"]


def test_without_a_row_detector_it_says_what_to_install(
    field: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = Registry(tuple(e for e in INSTALLED.entries if e.role not in ("row detector", "recipe")))
    monkeypatch.setattr("treereg_core.cli.rows.installed", lambda: bare)
    assert main(["rows", "field", "-q"]) == 2
    assert f"method {defaults()['rows']!r}: " in capsys.readouterr().err


def test_the_default_method_finds_and_numbers_the_planted_rows(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("treereg_core.cli.rows.installed", installed)
    made = simulate(Scene(trees=300, outline="rectangle", missed=0, false=0, split=0, merged=0), 2)
    write_simulation(made, tmp_path)
    assert main(["rows", "reference"]) == 0
    assert f"method           {defaults()['rows']}" in capsys.readouterr().out
    planted = made.trees.row[made.reference_trees[:, 0]]
    in_order = [set(planted[line["properties"]["trees"]].tolist()) for line in found()]
    assert all(len(rows) == 1 for rows in in_order)
    count = len(np.unique(planted))
    assert in_order in ([{k} for k in range(count)], [{k} for k in reversed(range(count))])
    corner = projected(found()[0])[0] - np.mean([xy for line in found() for xy in projected(line)], axis=0)
    assert corner @ (-1, 1) > 0


def test_detect_rows_gives_the_same_as_the_command(field: Path) -> None:
    assert main(["rows", "field", "--method", "alone+alleys", "--set", "alone.least=0.3", "-q"]) == 0
    expected = [line["properties"]["trees"] for line in found()]
    read = io.read_survey(field)
    for given in (field, str(field), read, read.features):
        rows = detect_rows(given, method="alone+alleys", settings={"alone": {"least": 0.3}}, threads=1)
        assert [row.tolist() for row in rows.trees] == expected


def test_detect_rows_refuses_what_cannot_be(field: Path) -> None:
    plain = FeatureSet.of(XY)
    with pytest.raises(UsageError, match="seed is -1"):
        detect_rows(plain, method="alleys", seed=-1)
    with pytest.raises(UsageError, match="needs two surveys"):
        detect_rows(plain, method="nearest")
    with pytest.raises(InputError, match="no such folder"):
        detect_rows(field / "not", method="alleys")
    for says in (True, False):
        with pytest.raises(NoRegistration, match="no rows"):
            detect_rows(plain, method="forest", settings={"forest": {"says": says}})
    with pytest.raises(NoRegistration):
        detect_rows(plain.take(np.arange(0)), method="forest")
