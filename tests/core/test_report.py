"""The report of a run: its data, and the page as text. What the page does in a browser is in tests/browser."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from io_files import CRS, ORIGIN, feature, grid, polygon, square, survey, trees
from rasterio.transform import Affine as Geotransform

from treereg_core import io, register
from treereg_core.cli import main
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.judgement import ExpectedError, Judgement, Matches, Verdict
from treereg_core.outlines import Outlines
from treereg_core.report import page
from treereg_core.report.data import report_data
from treereg_core.report.words import chance, sentence
from treereg_core.simulate import Scene, simulate, simulate_family, write_simulation
from treereg_core.transform import Affine, Rigid

Output = pytest.CaptureFixture[str]
CLEAR = Scene(trees=500, jitter=0.1, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)
HOSTILE = "</script><script>alert(1)</script><!-- \u2028\u2029 & '\""


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder)
    return folder


@pytest.fixture(scope="module")
def rowed(orchard: Path) -> Path:
    """A run by rows."""
    out = orchard / "rowed"
    assert main(["run", *surveys(orchard), "-q", "--method", "aco+icp", "--out", str(out)]) == 0
    return out


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def surveys(folder: Path) -> list[str]:
    return [str(folder / "reference"), str(folder / "source")]


def data_in(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "report-data.json").read_text(), parse_constant=lambda name: pytest.fail(name))


def data_of_page(text: str) -> Any:
    (content,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    return json.loads(content)


def corners(side: dict[str, Any]) -> list[np.ndarray]:
    """The rings of a survey as the page reads them, metres."""
    steps = np.split(np.array(side["outline"]["xy"]).reshape(-1, 2), np.cumsum(side["outline"]["ring"])[:-1])
    centres = np.column_stack([side["x"], side["y"]])[side["outline"]["tree"]]
    return [(centre + np.cumsum(ring, axis=0)) / 100 for centre, ring in zip(centres, steps, strict=True)]


def test_the_data_say_what_the_registration_says(rowed: Path, orchard: Path) -> None:
    data, registration = data_in(rowed), json.loads((rowed / "registration.json").read_text())
    assert data["schema"] == "treereg/report/1"
    assert data["timings_s"] == registration.pop("timings_s")
    assert data["registration"] == registration
    before, after, *rivals = data["placements"]
    assert [p["name"] for p in data["placements"][:3]] == ["before", "after", "rival 1"]
    assert len(rivals) == len(registration["rivals"])
    for placement, told in ((before, registration["before"]), (after, registration)):
        assert placement["matched"] == told["matched"] == sum(partner >= 0 for partner in placement["source"])
        assert placement["residual_rms_m"] == told["residual_rms_m"]
    full = Affine.from_matrix([*after["matrix"], [0, 0, 1]]).about(-np.array(data["origin"]))
    assert np.allclose(full.matrix, registration["transform"]["matrix"])
    matches = json.loads((rowed / "tree_matches.geojson").read_text())["features"]
    pairs = {(match["properties"]["reference"], match["properties"]["source"]) for match in matches}
    ids = data["reference"]["id"], data["source"]["id"]
    assert pairs == {(ids[0][r], ids[1][s]) for s, r in enumerate(after["source"]) if r >= 0}


def test_trees_without_a_partner_are_missing_new_or_not_covered(rowed: Path) -> None:
    data = data_in(rowed)
    after = data["placements"][1]
    for side, other in (("reference", "source"), ("source", "reference")):
        assert len(after[side]) == len(data[side]["x"])
        assert {partner for partner in after[side] if partner < 0} <= {-1, -2}
        for tree, partner in enumerate(after[side]):
            assert partner < 0 or after[other][partner] == tree
    assert -1 in after["reference"]


def test_canopies_keep_their_place_and_shape(orchard: Path) -> None:
    result = register(*surveys(orchard))
    data = data_of(result)
    features, outlines = result.reference.features, result.reference.outlines
    side = data["reference"]
    assert np.allclose(np.column_stack([side["x"], side["y"]]) / 100, features.xy, atol=0.0051)
    assert np.allclose(side["confidence"], features.confidence, atol=0.0006)
    assert np.allclose(side["area_m2"], features.area, atol=0.006)
    rings = corners(side)
    assert len(rings) == len(outlines.tree)
    assert np.allclose([turn(ring) for ring in rings], features.area, rtol=0.15)
    assert sum(map(len, rings)) < 0.8 * len(outlines.xy)


def data_of(result: Any) -> dict[str, Any]:
    return report_data(result, json.loads(json.dumps(result.to_json())))


def test_holes_and_separate_parts_are_rings_of_their_tree() -> None:
    xy = grid()
    two = {"type": "MultiPolygon", "coordinates": [[square(xy[1], 1.0)], [square(xy[1] + 1.2, 0.5)]]}
    features = [feature(g, confidence=0.5) for g in (polygon(square(xy[0]), square(xy[0], 1.0)), two)]
    found = io.read_survey(survey(Path("survey"), [*features, *trees(xy[2:])]))
    assert found.outlines.tree[:5].tolist() == [0, 0, 1, 1, 2]
    assert len(found.outlines.tree) == len(xy) + 2
    assert np.bincount(found.outlines.ring).tolist() == [5] * len(found.outlines.tree)
    assert isinstance(found.outlines, Outlines)
    turns = [turn(found.outlines.xy[found.outlines.ring == ring]) for ring in range(4)]
    assert np.sign(turns).tolist() == [1, -1, 1, 1]
    assert not found.outlines.xy.flags.writeable


@pytest.mark.parametrize("order", [1, -1])
def test_outlines_run_counter_clockwise_whatever_the_file_does(order: int) -> None:
    rings = [polygon(square(point)[::order]) for point in grid()]
    found = io.read_survey(survey(Path("survey"), [feature(ring, confidence=0.5) for ring in rings]))
    assert all(turn(found.outlines.xy[found.outlines.ring == ring]) > 3.9 for ring in range(len(rings)))


def turn(ring: np.ndarray) -> float:
    """The signed area of a ring."""
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def test_rows_are_numbered_and_gaps_lie_in_them(rowed: Path) -> None:
    data = data_in(rowed)
    rows, after = data["rows"], data["placements"][1]
    in_rows = [tree for row in rows["reference"] for tree in row]
    assert len(in_rows) == len(set(in_rows)) > 0.7 * len(data["reference"]["x"])
    assert len(rows["partner"]) == len(rows["source"])
    row_of = {tree: number for number, row in enumerate(rows["reference"]) for tree in row}
    pairs = [
        (row_of[after["source"][tree]], partner)
        for row, partner in zip(rows["source"], rows["partner"], strict=True)
        for tree in row
        if partner >= 0 and after["source"][tree] in row_of
    ]
    assert np.mean([mine == its for mine, its in pairs]) > 0.9
    xy = np.column_stack([data["reference"]["x"], data["reference"]["y"]]) / 100
    gaps = np.array(rows["gaps"]) / 100
    apart = np.hypot(*(gaps[:, None] - xy[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(gaps)
    assert (apart > 1.0).all()


def test_without_rows_or_images_there_are_none(orchard: Path) -> None:
    data = data_of(register(*surveys(orchard)))
    assert data["rows"] is None
    assert data["reference"]["image"] is None


def test_what_filters_know_and_heights_are_quantities_of_trees(orchard: Path) -> None:
    data = data_of(register(*surveys(orchard), method="bn_landmarks+icp"))
    for side in ("reference", "source"):
        known = data[side]["attributes"]["landmark_probability"]
        assert len(known) == len(data[side]["x"])
        assert all(0 <= value <= 1 for value in known)


def test_plain_trees_have_no_outlines() -> None:
    made = simulate(CLEAR, 5)
    result = register(made.reference, made.source)
    data = data_of(result)
    assert data["reference"]["outline"] is None
    assert data_of_page(page(data)) == data


def test_the_same_run_gives_the_same_bytes_timings_apart(orchard: Path) -> None:
    for threads in ("1", "2"):
        assert main(["run", *surveys(orchard), "-q", "--threads", threads, "--out", threads]) == 0
    first, second = ((Path(n) / "report-data.json").read_text().splitlines() for n in ("1", "2"))
    differing = {a.partition(":")[0] for a, b in zip(first, second, strict=True) if a != b}
    assert differing <= {'"timings_s"'}


@pytest.mark.parametrize(
    ("family", "verdict"), [("different", "failed"), ("periodic_crops", "ambiguous"), ("small_150", "accepted")]
)
def test_there_is_a_report_whatever_the_verdict(family: str, verdict: str) -> None:
    write_simulation(simulate_family(family, 1), Path("made"))
    assert main(["run", *surveys(Path("made")), "-q"]) == (0 if verdict == "accepted" else 3)
    data = data_in(Path("treereg-out"))
    assert data["registration"]["verdict"] == verdict
    names = [placement["name"] for placement in data["placements"]]
    assert names[0] == "before"
    assert ("after" in names) == (verdict != "failed")
    assert data_of_page(Path("treereg-out/report.html").read_text()) == data


def test_no_report_and_a_report_again(orchard: Path, capsys: Output) -> None:
    assert main(["run", *surveys(orchard), "-q"]) == 0
    assert "treereg-out/report.html" in capsys.readouterr().out
    made = Path("treereg-out/report.html").read_bytes()
    Path("treereg-out/report.html").unlink()
    assert main(["report", "treereg-out"]) == 0
    assert capsys.readouterr().out == "treereg-out/report.html\n"
    assert Path("treereg-out/report.html").read_bytes() == made
    assert main(["run", *surveys(orchard), "-q", "--no-report"]) == 0
    assert not any(path.name.startswith("report") for path in Path("treereg-out").iterdir())


@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"schema": "treereg/report/1"}', '{"schema": "x/2"}'])
def test_what_is_no_data_of_a_report_is_refused(content: str | None, capsys: Output) -> None:
    if content is not None:
        Path("report-data.json").write_text(content)
    assert main(["report", "."]) == 2
    assert "report-data.json" in capsys.readouterr().err
    assert not Path("report.html").exists()


def test_markup_in_the_data_opens_no_tag(rowed: Path) -> None:
    data = data_in(rowed)
    plain = page(data)
    data["registration"]["reference"]["path"] = data["sentence"] = data["headline"] = HOSTILE
    data["source"]["attributes"] = {HOSTILE: data["source"]["confidence"]}
    text = page(data)
    assert text.count("<") == plain.count("<")
    assert "\u2028" not in text
    assert data_of_page(text) == data


def test_half_a_letter_in_a_name_survives(orchard: Path) -> None:
    data = data_of(register(*surveys(orchard)))
    data["registration"]["source"]["path"] = "\udcff"
    io.write_text(Path("page.html"), page(data))
    assert data_of_page(Path("page.html").read_text())["registration"]["source"]["path"] == "\udcff"


def test_the_page_asks_for_nothing_and_lets_only_its_own_scripts_run(rowed: Path) -> None:
    text = (rowed / "report.html").read_text()
    assert not re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?:https?:)?//', text)
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert policy.count("sha256-") == 3
    assert len((rowed / "report.html").read_bytes()) < 2e6


def paint(path: Path, side: int = 400, dtype: str = "uint8", bands: int = 3, empty: bool = True) -> None:
    """An orthomosaic of 100 m about the orchard; its western quarter may be empty."""
    values = np.full((bands, side, side), 90 if dtype == "uint8" else 9000, dtype)
    values[:, :, : side // 4] = 0 if empty else 30
    pixel = 100 / side
    place = Geotransform(pixel, 0, ORIGIN[0] - 30, 0, -pixel, ORIGIN[1] + 70)
    options = {"driver": "GTiff", "width": side, "height": side, "count": bands, "dtype": dtype, "nodata": 0}
    with rasterio.open(path, "w", crs=CRS, transform=place, **options) as file:
        file.write(values)


def decoded(preview: io.Preview) -> np.ndarray:
    with rasterio.MemoryFile(preview.image) as memory, memory.open() as image:
        return image.read()


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize(("dtype", "bands", "side"), [("uint8", 3, 400), ("uint16", 4, 400), ("uint8", 1, 2600)])
def test_a_preview_lies_where_the_orthomosaic_lies(dtype: str, bands: int, side: int) -> None:
    folder = survey(Path("survey"))
    paint(folder / "visible_25cm.tif", dtype=dtype, bands=bands, side=side)
    found = io.read_survey(folder)
    preview = io.read_preview(found)
    assert preview is not None
    assert max(preview.width, preview.height) <= 1000
    corner = preview.frame_from_pixel(np.array([[0.0, 0.0], [preview.width, preview.height]])) + found.frame.origin
    assert np.allclose(corner, [ORIGIN + np.array([-30, 70]), ORIGIN + np.array([70, -30])], atol=1e-6)
    pixels = decoded(preview)
    assert pixels.shape == (4, preview.height, preview.width)
    assert pixels[3, 50, 2] == 0
    assert pixels[3, 50, -2] == 255


def test_an_image_of_which_no_preview_can_be_made_is_left_out(
    orchard: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setattr("treereg_core.io.preview.MOST_PIXELS", 1000)
    folder = survey(Path("survey"))
    paint(folder / "visible_25cm.tif")
    with pytest.raises(InputError, match="has no overviews"):
        io.read_preview(io.read_survey(folder))
    assert main(["run", "survey", "survey", "-q", "--rasters", "none"]) in (0, 3)
    assert "The report does without it" in capsys.readouterr().err
    data = data_in(Path("treereg-out"))
    assert data["reference"]["image"] is None
    assert len(data["warnings"]) == 2


@pytest.mark.parametrize(("empty", "kind", "magic"), [(True, "webp", b"RIFF"), (False, "jpeg", b"\xff\xd8\xff")])
def test_images_stand_in_the_page(empty: bool, kind: str, magic: bytes) -> None:
    folder = survey(Path("survey"))
    paint(folder / "visible_25cm.tif", empty=empty)
    assert main(["run", "survey", "survey", "-q", "--rasters", "none"]) in (0, 3)
    image = data_in(Path("treereg-out"))["source"]["image"]
    named, content = image["url"].split(",")
    assert named == f"data:image/{kind};base64"
    assert base64.b64decode(content).startswith(magic)


def judgement(verdict: Verdict, probability: float, rms: float | None = 0.014) -> Judgement:
    nothing = Matches(np.empty((0, 2)), np.empty(0))
    error = None if rms is None else ExpectedError(rms, (rms / 2, rms * 2))
    return Judgement(verdict, "because", rms and Rigid.identity(), nothing, nothing, error, probability, ())


def test_sentences_for_a_grower() -> None:
    assert "within about 1.4 cm" in sentence(judgement(Verdict.ACCEPTED, 2e-5))
    assert "1 in 50,000" in sentence(judgement(Verdict.ACCEPTED, 2e-5))
    assert "within a millimetre of" in sentence(judgement(Verdict.ACCEPTED, 1e-6, 0.0))
    assert "within about 1.2 m of" in sentence(judgement(Verdict.ACCEPTED, 1e-6, 1.2))
    assert "do not use it" in sentence(judgement(Verdict.AMBIGUOUS, 0.9))
    assert "nothing was moved" in sentence(judgement(Verdict.FAILED, 1.0, None))


@pytest.mark.parametrize(
    ("probability", "words"),
    [(1.0, "100 %"), (0.5, "50 %"), (0.001, "1 in 1,000"), (1e-6, "1 in 1,000,000"), (0.0, "less than 1 in a million")],
)
def test_a_chance_in_words(probability: float, words: str) -> None:
    assert chance(probability) == words


def test_many_trees_have_coarser_outlines_and_more_have_none(orchard: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = register(*surveys(orchard))
    size: Callable[[], int] = lambda: len(data_of(result)["reference"]["outline"]["xy"])  # noqa: E731
    fine = size()
    monkeypatch.setattr("treereg_core.report.canopies.MANY", 100)
    assert size() < fine
    monkeypatch.setattr("treereg_core.report.canopies.MOST", 100)
    assert data_of(result)["reference"]["outline"] is None


def test_trees_on_one_spot_have_no_pairs() -> None:
    features = FeatureSet.of(np.zeros((4, 2)))
    data = data_of(register(features, features))
    assert data["placements"][0]["reference"] == [-2] * 4
    assert page(data)
