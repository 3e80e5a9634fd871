"""The memory's folder: what is read, refused and written, and where an orchard's surveys lie."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treereg_core import io, register
from treereg_core.cli import main
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.io.crs import converter
from treereg_core.memory import EDGE_M, Memory, Visit, check_orchard, load
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.survey import Frame
from treereg_core.transform import Rigid

CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=4.0, rotation_sd=2.0)
ZONE_34, ZONE_35 = "EPSG:32734", "EPSG:32735"
HOME = Frame(ZONE_34, (343_000.0, 6_306_000.0))
Output = pytest.CaptureFixture[str]


def visit(
    digest: int = 1, size: tuple[float, float] = (200.0, 100.0), at: tuple[float, float] = (0, 0), frame: Any = HOME
) -> Visit:
    """A rectangle of trees whose corner lies at a place of the frame."""
    xy = np.random.default_rng(digest).uniform((0, 0), size, (300, 2)) + at
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size + np.array(at)
    return Visit(f"{digest:032x}", f"survey-{digest}", np.vstack([corners, xy]), frame)


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder)
    return folder


def surveys(folder: Path) -> list[str]:
    return [str(folder / "reference"), str(folder / "source")]


def memory_of(orchard: Path, folder: Path) -> dict[str, Any]:
    """The document of a memory that one run has made."""
    assert register(*surveys(orchard), memory=folder).accepted
    return dict(json.loads((folder / "memory.json").read_text()))


def test_the_document_is_readable_json_and_comes_back_the_same(orchard: Path, tmp_path: Path) -> None:
    document = memory_of(orchard, tmp_path)
    assert list(document) == ["schema", "crs", "home", "outline", "surveys", "methods"]
    assert document["schema"] == "treereg/memory/1"
    assert [known["name"] for known in document["surveys"].values()] == ["reference", "source"]
    assert document["surveys"][document["home"]]["home_from_survey"] == np.eye(3).tolist()
    assert str(orchard) not in (tmp_path / "memory.json").read_text(), "a memory tells nobody where files lay"
    memory = load(tmp_path)
    assert memory is not None
    assert memory.to_json() == document


def test_the_place_of_a_survey_is_the_transform_of_its_registration(orchard: Path, tmp_path: Path) -> None:
    document = memory_of(orchard, tmp_path / "memory")
    result = register(*surveys(orchard))
    (place,) = (known for digest, known in document["surveys"].items() if digest != document["home"])
    expected = np.array(result.to_json()["transform"]["matrix"])
    centre = np.array([*HOME.origin, 1.0])
    np.testing.assert_allclose(np.array(place["home_from_survey"]) @ centre, expected @ centre, atol=1e-6)


def test_a_survey_is_known_by_its_content_in_any_folder_and_frame(orchard: Path, tmp_path: Path) -> None:
    there = tmp_path / "renamed"
    there.mkdir()
    detections = json.loads((orchard / "source" / "raw-detections.geojson").read_text())
    (there / "raw_detections.geojson").write_text(json.dumps(detections))
    one = io.read_surveys(orchard / "reference", orchard / "source")[1]
    two = io.read_survey(there, frame=Frame(ZONE_35, (0.0, 0.0)))
    assert one.digest == two.digest
    detections["features"][7]["properties"]["confidence"] = 0.123
    (there / "raw_detections.geojson").write_text(json.dumps(detections))
    assert io.read_survey(there).digest != one.digest
    reference = io.read_survey(orchard / "reference")
    assert reference.digest != one.digest


def test_the_command_reads_and_updates_a_memory_and_leaves_registration_json_as_it_is(
    orchard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run.toml").write_text('memory = "kept"\n')
    assert main(["run", *surveys(orchard), "-q", "--out", "plain"]) == 0
    assert main(["run", *surveys(orchard), "-q", "--out", "one", "--memory", "kept"]) == 0
    first = Path("kept/memory.json").read_bytes()
    assert main(["run", *surveys(orchard), "-q", "--out", "two", "--config", "run.toml"]) == 0
    assert Path("kept/memory.json").read_bytes() == first
    said = [json.loads((Path(out) / "registration.json").read_text()) for out in ("plain", "one", "two")]
    assert [record["timings_s"].pop("learn", None) is None for record in said] == [True, False, False]
    for record in said:
        record["timings_s"] = None
    assert said[0] == said[1] == said[2]


def test_an_unaccepted_run_makes_no_memory(orchard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_simulation(simulate(CLEAR.model_copy(update={"same_orchard": False}), 4), tmp_path / "other")
    assert main(["run", *surveys(tmp_path / "other"), "-q", "--memory", "kept", "--force"]) == 3
    assert not Path("kept").exists()


def broken(document: dict[str, Any], *path: Any, to: Any) -> str:
    """The document with one value changed, as text."""
    inner = document = json.loads(json.dumps(document))
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = to
    return json.dumps(document)


DEEP: Any = "bottom"
for _ in range(100):
    DEEP = [DEEP]
KNOWN = {"name": "x", "home_from_survey": np.eye(3).tolist()}
KNOWLEDGE = {"by": "test 1", "pairs": [], "before": {}, "state": {}}


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (["schema"], "treereg/memory/2", "was written by a later version of treereg; update treereg"),
        (["schema"], "treereg/registration/1", "does not begin with the schema treereg/memory/1"),
        (["schema"], "treereg/memory/1.0", "does not begin with the schema"),
        (["schema"], None, "does not begin with the schema"),
        (["crs"], 7, "crs: "),
        (["home"], "../../etc/passwd", "home: "),
        (["outline"], [], "outline: "),
        (["outline"], [[1, 2, 3]], "outline.0"),
        (["outline"], [[1e308, 1e309]], "number that is not finite"),
        (["outline"], [[1, float("nan")]], "number that is not finite"),
        (["outline"], [[1, 10**400]], "number that is not finite"),
        (["outline"], [[1e12, 1]], "outline.0.0"),
        (["outline"], DEEP, "nested too deeply"),
        (["extra"], 1, "extra: "),
        (["surveys"], {"short": KNOWN}, "surveys.short"),
        (["surveys"], {"a" * 32: {**KNOWN, "home_from_survey": np.zeros((3, 3)).tolist()}}, "home_from_survey: "),
        (["surveys"], {"a" * 32: {**KNOWN, "home_from_survey": [[1]]}}, "home_from_survey"),
        (["methods"], [], "methods: "),
        (["methods"], {"counting": {**KNOWLEDGE, "state": []}}, "methods.counting.state"),
        (["methods"], {"counting": {**KNOWLEDGE, "pairs": [["a", "b"]]}}, "methods.counting.pairs.0.0"),
        (["methods"], {"counting": {**KNOWLEDGE, "state": {"deep": DEEP}}}, "nested too deeply"),
    ],
)
def test_a_damaged_memory_is_refused_in_a_sentence(
    path: list[Any], value: Any, sentence: str, orchard: Path, tmp_path: Path, capsys: Output
) -> None:
    (tmp_path / "kept").mkdir()
    document = {"schema": "treereg/memory/1", **Memory.begun(visit()).to_json()}
    (tmp_path / "kept/memory.json").write_text(broken(document, *path, to=value))
    expect_refusal(tmp_path, sentence, capsys)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "cannot be used as a memory"),
        (b"[1, 2]", "it is not a JSON object"),
        (b'{"schema": "treereg/memory/1"', "cannot be used as a memory"),
        (b'{"schema": "treereg/memory/1"}', "crs: Field required"),
        (b"\x80\x04\x95\x0b\x00", "cannot be used as a memory"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"schema": ' + b"9" * 5000 + b"}", "cannot be used as a memory"),
        (b" " * (64 * 2**20 + 1), "it is larger than 64 MB"),
    ],
    ids=["empty", "list", "cut off", "bare", "pickle", "deep", "long number", "large"],
)
def test_a_file_that_is_no_memory_is_refused_in_a_sentence(
    content: bytes, sentence: str, tmp_path: Path, capsys: Output
) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/memory.json").write_bytes(content)
    expect_refusal(tmp_path, sentence, capsys)
    assert (tmp_path / "kept/memory.json").read_bytes() == content


def expect_refusal(folder: Path, sentence: str, capsys: Output, memory: str = "kept") -> None:
    """Before any survey is read: the survey folders of this command do not exist."""
    command = ["run", str(folder / "no"), str(folder / "none"), "-q", "--memory", str(folder / memory)]
    assert main([*command, "--out", str(folder / "out")]) == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert str(folder / memory) in stderr
    assert len(stderr.splitlines()) == 1
    assert not (folder / "out").exists()


def test_what_is_no_folder_for_a_memory_is_refused_before_the_work(tmp_path: Path, capsys: Output) -> None:
    (tmp_path / "file").write_text("x")
    expect_refusal(tmp_path, "is a file, not a folder", capsys, "file")
    expect_refusal(tmp_path, "cannot be written (not a directory)", capsys, "file/below")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("x")
    expect_refusal(tmp_path, "holds notes.txt but no memory.json", capsys, "mine")
    (tmp_path / "odd/memory.json").mkdir(parents=True)
    expect_refusal(tmp_path, "it is not a file", capsys, "odd")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "mine", "odd"]


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "kept").mkdir()
    monkeypatch.setattr("treereg_core.io.files.tempfile.TemporaryFile", refuse)
    expect_refusal(tmp_path, "cannot be written (permission denied), so nothing could be learned", capsys)


def test_a_write_that_fails_leaves_the_memory_as_it_was(
    orchard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory_of(orchard, tmp_path)
    before = (tmp_path / "memory.json").read_bytes()

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("treereg_core.io.complete.os.replace", refuse)
    result = register(*surveys(orchard), memory=tmp_path, seed=1)
    assert result.accepted
    assert "no space left" in result.warnings[0]
    assert {path.name for path in tmp_path.iterdir()} == {"memory.json", ".lock"}
    assert (tmp_path / "memory.json").read_bytes() == before


def test_one_run_at_a_time_holds_a_memory(tmp_path: Path) -> None:
    order: list[str] = []

    def second() -> None:
        with io.memory_lock(tmp_path / "kept"):
            order.append("second")

    with io.memory_lock(tmp_path / "kept"):
        waiting = threading.Thread(target=second)
        waiting.start()
        time.sleep(0.2)
        order.append("first")
    waiting.join(timeout=10)
    assert order == ["first", "second"]


def test_a_memory_of_another_orchard_is_refused(orchard: Path, tmp_path: Path, capsys: Output) -> None:
    memory_of(orchard, tmp_path / "kept")
    for survey in ("reference", "source"):
        path = tmp_path / "far" / survey / "raw-detections.geojson"
        path.parent.mkdir(parents=True)
        detections = json.loads((orchard / survey / "raw-detections.geojson").read_text())
        for feature in detections["features"]:
            feature["geometry"]["coordinates"][0] = [
                [lon + 0.05, lat] for lon, lat in feature["geometry"]["coordinates"][0]
            ]
        path.write_text(json.dumps(detections))
    command = ["run", *surveys(tmp_path / "far"), "-q", "--memory", str(tmp_path / "kept")]
    before = (tmp_path / "kept/memory.json").read_bytes()
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    stderr = capsys.readouterr().err
    assert "kept is the memory of another orchard (reference lies 4," in stderr
    assert "give this orchard's memory, or a new folder" in stderr
    assert (tmp_path / "kept/memory.json").read_bytes() == before
    assert not (tmp_path / "out").exists()


def belongs(memory: Memory, reference: Visit, source: Visit | None = None) -> bool:
    try:
        check_orchard(Path("kept"), memory, reference, source or visit(99, frame=reference.frame))
    except InputError:
        return False
    return True


def test_the_ground_tells_whose_memory_it_is() -> None:
    memory = Memory.begun(visit())
    assert belongs(memory, visit(2, at=(8.0, -5.0)))
    assert belongs(memory, visit(3, size=(60.0, 40.0), at=(90.0, 30.0))), "a survey of a part"
    assert belongs(memory, visit(4, size=(900.0, 800.0), at=(-300.0, -300.0))), "a survey of more"
    assert not belongs(memory, visit(5, at=(205.0, 0.0))), "the next orchard"
    assert not belongs(memory, visit(5, at=(200.0 + 3 * EDGE_M, 0.0)))
    assert belongs(memory, visit(1, at=(205.0, 0.0))), "the first reference itself, wherever"
    known = memory.with_survey(visit(6), Rigid(np.eye(2), HOME.origin))
    assert belongs(known, visit(7, at=(205.0, 0.0)), visit(6, at=(205.0, 0.0))), "a source that it knows"
    row = Visit("8" * 32, "row", np.column_stack([np.arange(50.0), np.zeros(50)]), HOME)
    assert belongs(Memory.begun(row), row)
    assert belongs(Memory.begun(row), Visit("9" * 32, "row", row.xy + 1.0, HOME))


def test_ground_in_another_crs_is_compared_in_the_memorys() -> None:
    memory = Memory.begun(visit())
    there = converter(ZONE_34, ZONE_35)(visit(2).xy + np.array(HOME.origin))
    origin = tuple(np.round(there.mean(axis=0)).tolist())
    frame = Frame(ZONE_35, origin)
    assert belongs(memory, Visit("2" * 32, "survey", there - origin, frame))
    assert not belongs(memory, Visit("2" * 32, "survey", there - origin + [400.0, 0.0], frame))
    assert not belongs(memory, Visit("2" * 32, "survey", there, Frame("EPSG:2193", (0.0, 0.0))))


def test_a_place_holds_in_every_frame_and_crs() -> None:
    found = Rigid.turn(2.0, shift=(7.0, -3.0))
    memory = Memory.begun(visit()).with_survey(visit(2), Rigid(np.eye(2), HOME.origin) @ found)
    home = found(visit(2).xy) + np.array(HOME.origin)
    moved = Frame(ZONE_34, (343_100.0, 6_305_950.0))
    shifted = Visit(visit(2).digest, "", visit(2).xy + np.subtract(HOME.origin, moved.origin), moved)
    there = converter(ZONE_34, ZONE_35)(visit(2).xy + np.array(HOME.origin))
    other = Frame(ZONE_35, tuple(np.round(there.mean(axis=0)).tolist()))
    converted = Visit(visit(2).digest, "", there - other.origin, other)
    for seen, kind, error in ((visit(2), Rigid, 1e-8), (shifted, Rigid, 1e-8), (converted, object, 0.01)):
        home_from_working = memory.home_from_working(seen)
        assert isinstance(home_from_working, kind)
        np.testing.assert_allclose(home_from_working(seen.xy), home, atol=error)
    again = memory.with_survey(converted, memory.home_from_working(converted))
    np.testing.assert_allclose(again.home_from_working(visit(2))(visit(2).xy), home, atol=0.01)
    assert memory.home_from_working(visit(3)) is None


def test_plain_trees_and_surveys_have_memories_of_their_own(orchard: Path, tmp_path: Path) -> None:
    made = simulate(CLEAR, 4)
    assert register(made.reference, made.source, memory=tmp_path).accepted
    with pytest.raises(InputError, match="a memory of plain trees, not of surveys with a CRS"):
        register(*surveys(orchard), memory=tmp_path)
    memory_of(orchard, tmp_path / "other")
    with pytest.raises(InputError, match="a memory of surveys with a CRS, not of plain trees"):
        register(made.reference, made.source, memory=tmp_path / "other")
    assert Visit.of(made.reference).digest == Visit.of(made.reference.replace()).digest
    assert Visit.of(FeatureSet.of([[0, 0]])).digest != Visit.of(FeatureSet.of([[0, 1]])).digest
