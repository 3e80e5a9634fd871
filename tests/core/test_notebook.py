"""`register` and its result in Python: what it takes, what it gives, how it shows itself."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import matplotlib
import numpy as np
import pytest
from geopandas.testing import assert_geodataframe_equal

import treereg_core
from treereg_core import FeatureSet, register
from treereg_core.cli import main
from treereg_core.errors import InputError, TreeregError, UsageError
from treereg_core.judgement import Verdict
from treereg_core.result import Result
from treereg_core.simulate import Scene, simulate, write_simulation

matplotlib.use("Agg")
CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)
BROKEN = [
    {"type": "Feature", "properties": {"confidence": 0.5, "note": {"deep": [1]}}, "geometry": None},
    {
        "type": "Feature",
        "properties": {"confidence": 0.25},
        "geometry": {
            "type": "Polygon",
            "coordinates": [[[19.31, -33.37], [19.32, -33.37], [19.31, -33.37], [19.31, -33.37]]],
        },
    },
]
"""Features that are no trees, before all others."""


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two surveys of an orchard, and in `out` what the command makes of them."""
    folder = tmp_path_factory.mktemp("orchard")
    write_simulation(simulate(CLEAR, 4), folder)
    path = folder / "source" / "raw-detections.geojson"
    document = json.loads(path.read_text())
    document["features"] = BROKEN + document["features"]
    path.write_text(json.dumps(document))
    assert main(["run", str(folder / "reference"), str(folder / "source"), "--out", str(folder / "out"), "-q"]) == 0
    return folder


@pytest.fixture(scope="module")
def result(orchard: Path) -> Result:
    return register(orchard / "reference", orchard / "source")


def frames(orchard: Path) -> tuple[Any, Any]:
    reference, source = (geopandas.read_file(orchard / s / "raw-detections.geojson") for s in ("reference", "source"))
    return reference, source


def plain(result: Result) -> dict[str, Any]:
    """What a registration says, apart from where the surveys come from and how long it took."""
    found: dict[str, Any] = json.loads(json.dumps(result.to_json()))
    found["timings_s"] = found["reference"]["path"] = found["source"]["path"] = None
    return found


def test_folders_geodataframes_and_the_command_give_the_same(orchard: Path, result: Result) -> None:
    said = json.loads((orchard / "out" / "registration.json").read_text())
    said["timings_s"] = said["reference"]["path"] = said["source"]["path"] = None
    reference, source = frames(orchard)
    assert plain(result) == said
    assert plain(register(reference, source)) == said
    assert plain(register(orchard / "reference", source)) == said
    assert register(reference, source).to_json()["source"]["path"] is None


def test_a_geodataframe_in_any_crs_and_with_confidences_of_any_name(orchard: Path, result: Result) -> None:
    reference, source = frames(orchard)
    renamed = [f.to_crs("EPSG:32733").rename(columns={"confidence": "score"}) for f in (reference, source)]
    found = register(*renamed, confidence_property="score")
    assert found.frame == result.frame
    assert np.allclose(found.to_json()["transform"]["matrix"], result.to_json()["transform"]["matrix"], atol=1e-5)
    assert np.array_equal(found.source.features.confidence, result.source.features.confidence)  # type: ignore[union-attr]


def test_registered_is_the_file_of_the_command(orchard: Path, result: Result) -> None:
    written = geopandas.read_file(orchard / "out" / "detections_registered.geojson")
    found = result.registered("EPSG:4326")
    assert list(found.index) == list(range(len(written)))
    assert found.note[0] == {"deep": [1]}
    usable = result.source.features.ids  # type: ignore[union-attr]
    assert np.array_equal(found.confidence, written.confidence)
    corners = [frame.iloc[usable].get_coordinates() for frame in (found, written)]
    assert np.allclose(*corners, rtol=0, atol=1e-9)
    assert found.geometry.isna()[0]
    assert result.registered().crs == "EPSG:32734"


def test_the_index_and_all_columns_stay(orchard: Path) -> None:
    reference, source = frames(orchard)
    reference.index = [f"r{i}" for i in range(len(reference))]
    source = source.assign(variety="Fuji").rename_geometry("crown")
    source.index = [f"s{i}" for i in range(len(source))]
    before = source.copy()
    found = register(reference, source)
    moved, matches = found.registered(), found.matches()
    assert_geodataframe_equal(source, before)
    assert list(moved.index) == list(source.index)
    assert list(moved.columns) == list(source.columns)
    assert moved.geometry.name == "crown"
    middle = reference.to_crs(moved.crs).geometry.centroid
    pairs = moved.loc[matches.source].centroid.distance(middle.loc[matches.reference], align=False)
    assert np.allclose(pairs, matches.residual_m, atol=1e-5)
    assert np.allclose(matches.length, matches.residual_m, atol=1e-5)


def test_matches_are_the_file_of_the_command(orchard: Path, result: Result) -> None:
    written = geopandas.read_file(orchard / "out" / "tree_matches.geojson")
    found = result.matches("EPSG:4326")
    columns = ["reference", "source", "residual_m"]
    assert np.array_equal(found[columns], written[columns])
    assert np.allclose(found.get_coordinates(), written.get_coordinates(), rtol=0, atol=2e-9)
    assert result.matches().crs == "EPSG:32734"


def test_anything_of_the_source_follows(orchard: Path, result: Result) -> None:
    _, source = frames(orchard)
    source = source.iloc[len(BROKEN) :]
    moved = result.apply(source)
    assert moved.crs == source.crs
    full = source.to_crs("EPSG:32734").get_coordinates().to_numpy()
    assert np.allclose(result.apply(full), moved.to_crs("EPSG:32734").get_coordinates(), atol=1e-6)
    expected = result.registered().get_coordinates().loc[len(BROKEN) :]
    assert np.allclose(result.apply(full), expected, atol=1e-6)


def test_heights_of_positions_stay(result: Result) -> None:
    points = geopandas.GeoDataFrame(geometry=geopandas.points_from_xy([343000.0], [6306000.0], [12.5]), crs=32734)
    (point,) = result.apply(points).geometry
    assert point.z == 12.5
    assert point.x != 343000.0


def test_arrays_stay_in_their_frame() -> None:
    made = simulate(CLEAR, 5)
    assert made.truth is not None
    far = np.array([343_000.0, 6_306_000.0])
    sets = [FeatureSet.of(f.xy + far, f.confidence, f.area) for f in (made.reference, made.source)]
    for reference, source in (sets, [s.xy for s in sets]):
        found = register(reference, source)
        assert found.accepted
        assert found.registered().crs is None
        moved = found.apply(made.source.xy + far)
        assert np.allclose(found.registered().get_coordinates(), moved)
        assert np.sqrt(np.mean((moved - far - made.truth(made.source.xy)) ** 2)) < 0.1
        lines = found.matches()
        assert np.allclose(lines.length, lines.residual_m, atol=1e-5)
        with pytest.raises(UsageError, match="have no CRS"):
            found.registered("EPSG:4326")
        with pytest.raises(UsageError, match="have no CRS"):
            found.save("nowhere")


XY = simulate(CLEAR, 5).reference.xy[:200]
WRONG: list[tuple[Any, str]] = [
    (XY.T, r"trees of the reference have the shape \(2, "),
    (XY[:, 0], r"have the shape \(\d+,\)"),
    (np.where(np.arange(len(XY))[:, None] == 7, np.nan, XY), "not finite at 7"),
    (np.array([["a", "b"]]), "are not numbers"),
    (XY[:0], "has 0 trees"),
    (XY / 111_000, "not metres"),
    (FeatureSet.of(XY, area=np.zeros(len(XY))), "area that is not positive"),
    (FeatureSet.of(XY, confidence=np.full(len(XY), 2)), "confidence beyond 0 to 1"),
    (XY.tolist(), "give each survey as"),
    (geopandas.GeoDataFrame(geometry=geopandas.points_from_xy(*XY.T), crs=32734), "give each survey as"),
]


@pytest.mark.parametrize(("given", "words"), WRONG)
def test_what_is_no_trees_is_refused_in_a_sentence(given: Any, words: str) -> None:
    with pytest.raises(TreeregError, match=words):
        register(given, XY)


def boxes(**columns: Any) -> Any:
    import shapely

    shapes = shapely.box(*(XY - 1 + [343000, 6306000]).T, *(XY + 1 + [343000, 6306000]).T)
    return geopandas.GeoDataFrame(columns, geometry=shapes, crs="EPSG:32734")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (boxes().iloc[:0], "reference holds no features"),
        (boxes().iloc[:2], "reference has 2 usable trees among 2 features"),
        (boxes().set_crs(None, allow_override=True), "reference has no CRS, and its coordinates are not longitude"),
        (boxes(confidence=np.r_[np.nan, np.ones(len(XY) - 1)]), "reference: 1 of 200 features have no 'confidence'"),
        (boxes(confidence=["high"] * len(XY)), "reference: 200 of 200 features have a 'confidence' that is not"),
        (boxes(confidence=[1, "high"] * (len(XY) // 2)), "reference has a column of mixed types"),
        (boxes().set_geometry(boxes().centroid), "reference: feature 0 .* is a Point"),
        (boxes().to_crs("EPSG:4326").set_crs("EPSG:32734", allow_override=True), "its coordinates are degrees"),
        (geopandas.GeoDataFrame({"a": [1]}), "without a geometry column"),
    ],
)
def test_geodataframes_that_cannot_be_used(given: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        register(given, boxes())


def test_what_cannot_be_moved(result: Result) -> None:
    with pytest.raises(InputError, match=r"the points have the shape \(3,\)"):
        result.apply([1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="has no CRS"):
        result.apply(geopandas.GeoDataFrame(geometry=geopandas.points_from_xy([0], [0])))
    measured = geopandas.GeoDataFrame(geometry=geopandas.GeoSeries.from_wkt(["POINT ZM (19.3 -33.4 5 7)"]), crs=4326)
    with pytest.raises(InputError, match=r"has measures \(M\)"):
        result.apply(measured)
    with pytest.raises(InputError, match="the argument crs names an unknown CRS"):
        result.registered("EPSG:1")


def test_a_result_that_is_not_accepted_is_used_only_by_force(result: Result) -> None:
    ambiguous = replace(result, judgement=replace(result.judgement, verdict=Verdict.AMBIGUOUS))
    for use in (ambiguous.registered, ambiguous.matches):
        with pytest.raises(UsageError, match="ambiguous and not to be used"):
            use()
    assert len(ambiguous.matches(force=True)) == len(result.matches())
    with pytest.raises(UsageError, match="ambiguous"):
        ambiguous.apply([[0.0, 0.0]])


@pytest.fixture(scope="module")
def failed() -> Result:
    found = register(XY, simulate(CLEAR.model_copy(update={"same_orchard": False}), 4).source.xy)
    assert found.transform is None
    return found


def test_without_a_placement_force_does_not_help(failed: Result) -> None:
    with pytest.raises(UsageError, match="there is no placement"):
        failed.apply(XY, force=True)


def test_save_writes_what_the_command_writes(orchard: Path, result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "folders")
    register(*frames(orchard)).save(str(tmp_path / "frames"))
    for name in ("detections_registered.geojson", "tree_matches.geojson"):
        assert (tmp_path / "folders" / name).read_bytes() == (orchard / "out" / name).read_bytes()
        saved, written = (geopandas.read_file(folder / name) for folder in (tmp_path / "frames", orchard / "out"))
        assert saved.geometry.geom_equals_exact(written.geometry, 2e-9)[len(BROKEN) :].all()
    with pytest.raises(UsageError, match="is in use"):
        result.save(tmp_path / "folders")
    result.save(tmp_path / "folders", overwrite=True)
    with pytest.raises(UsageError, match="is or contains the input folder"):
        result.save(orchard, overwrite=True)


def test_save_moves_rasters_too(tmp_path: Path) -> None:
    scene = CLEAR.model_copy(update={"trees": 60})
    write_simulation(simulate(scene, 1), tmp_path, rasters=True)
    register(tmp_path / "reference", tmp_path / "source", max_failure=1).save(tmp_path / "out", force=True)
    assert {"visible_registered.tif", "dem_registered.tif"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_representations(result: Result, failed: Result) -> None:
    assert repr(result).startswith("<Result accepted: ")
    assert "failure probability 1>" in repr(failed)
    for one in (result, failed):
        html = one._repr_html_()
        assert one.judgement.verdict.value in html
        assert one.judgement.reason.split(":")[0] in html
        assert len(html) < 60_000
        assert "<script" not in html
        assert "http" not in html


def test_markup_in_words_is_inert(result: Result) -> None:
    bad = "<img src=x onerror=alert(1)>"
    said = replace(result.judgement, reason=bad)
    html = replace(result, judgement=said, warnings=(bad,))._repr_html_()
    assert "<img" not in html
    assert html.count("&lt;img src=x onerror=alert(1)&gt;") == 2


@pytest.mark.parametrize("show", ["after", "before", "residuals"])
def test_plots_draw_into_the_axes_that_are_given(result: Result, failed: Result, show: str) -> None:
    from matplotlib.figure import Figure

    for one in (result, failed):
        ax = Figure(figsize=(4, 4)).subplots()
        assert one.plot(show, ax=ax, width_m=40.0) is ax
        assert np.ptp(ax.get_xlim()) == pytest.approx(40)
        assert ax.get_aspect() == 1
        assert ax.get_title(loc="left").startswith("before" if show == "before" else one.judgement.verdict.value)
        ax.figure.canvas.draw()


def test_a_plot_shows_every_tree_once_where_it_belongs(result: Result) -> None:
    ax = result.plot()
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    matched = len(result.judgement.matches.pairs)
    assert f"reference: {matched:,} matched" in words
    drawn = [c for c in ax.collections if c.get_label().startswith("source")]
    moved = result.registered()
    corners = np.concatenate([path.vertices for c in drawn for path in c.get_paths()])
    assert sum(len(c.get_paths()) for c in drawn) == moved.geometry.notna().sum() - 1
    known = moved.iloc[len(BROKEN) :].total_bounds
    assert np.allclose([*corners.min(axis=0), *corners.max(axis=0)], known, atol=0.01)
    matplotlib.pyplot.close(ax.figure)


def test_residuals_are_enlarged_by_what_the_bar_says(result: Result) -> None:
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

    ax = result.plot("residuals", ax=Figure().subplots())
    (arrows,) = [c for c in ax.collections if isinstance(c, Quiver)]
    (bar,) = [a for a in ax.artists if hasattr(a, "txt_label")]
    factor = float(bar.txt_label.get_text().split()[-4])
    assert np.allclose(np.hypot(arrows.U, arrows.V), factor * result.judgement.matches.residual, atol=1e-4)


def test_wrong_words_to_plot_and_no_matplotlib(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="give one of 'after', 'before', 'residuals'"):
        result.plot("map")
    with pytest.raises(UsageError, match="more than 0"):
        result.plot(width_m=0)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install treereg\[plot\]"):
        result.plot()


def test_the_package_says_what_it_has() -> None:
    assert all(hasattr(treereg_core, name) for name in treereg_core.__all__)


def test_the_code_of_the_page_works(
    orchard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "REFERENCE").symlink_to(orchard / "reference")
    (tmp_path / "SOURCE").symlink_to(orchard / "source")
    frames(orchard)[1].iloc[len(BROKEN) :].to_file("pipes.gpkg")
    page = Path(__file__).parents[2] / "docs" / "python.md"
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        exec(block, names)
    assert names["result"].accepted
    assert len(names["grown"]) == len(names["pairs"])
    assert 0.8 < np.median(names["grown"]) < 1.25
    assert (tmp_path / "registered" / "registration.json").exists()
    matplotlib.pyplot.close("all")
