"""What scenes make of rows: paths, contour rows, headlands, double rows; and that older surveys stay as they were."""

import hashlib
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from pydantic import ValidationError
from scipy.spatial import cKDTree

from treereg_core.cli import main
from treereg_core.errors import UsageError
from treereg_core.simulate import Scene, family_scene, simulate, simulate_family
from treereg_core.simulate.orchard import plant

EXACT = {"planting_jitter": 0.0, "gaps": 0.0}
BLOCK = {**EXACT, "outline": "rectangle"}
TOGETHER = {
    "paths": 3,
    "contour": 2.5,
    "headlands": 2,
    "curve": 8.0,
    "hedgerow": 2.0,
    "row_spacing": 7.0,
    "spacing": 2.2,
    "trees": 3000,
}
SEEDS = pytest.mark.parametrize("seed", range(6))
OUTLINES = pytest.mark.parametrize("outline", ["rectangle", "irregular"])


def digest(simulation):
    """A fingerprint of both surveys and their truth, to a thousandth of a millimetre."""
    surveys = (simulation.reference, simulation.source)
    rounded = [getattr(survey, name) for survey in surveys for name in ("xy", "area", "confidence")]
    rounded += [simulation.trees.xy, simulation.trees.area, simulation.outline]
    whole = [simulation.trees.row, simulation.trees.column, simulation.reference_trees, simulation.source_trees]
    arrays = [np.round(array * 1e6) for array in rounded] + whole
    return hashlib.sha256(b"".join(array.astype(np.int64).tobytes() for array in arrays)).hexdigest()[:16]


@pytest.mark.parametrize(
    ("family", "known"),
    {
        "shift_3": "aa8a98e5be9c3d3a",
        "curved": "4fe87a65d13b8e15",
        "bare_rectangle": "c7f523a3b9dfdf0b",
        "dense_8000": "94ed2dfa4521dbda",
        "overlap_25": "1104e352684d0131",
        "small_60": "b7d890cd1f3cb8b2",
        "different": "7fdf4a21d8b7c0d4",
        "periodic_crops": "7dff9dafd19aa674",
    }.items(),
)
def test_scenes_without_paths_and_the_like_are_as_they_were_before_there_were_any(family, known):
    assert digest(simulate_family(family, 7)) == known


def rows_of(trees):
    """The trees of each row in order, (k, 2) metres each."""
    return [trees.xy[trees.row == row] for row in range(trees.row.max() + 1)]


def neighbours(trees):
    """Whether each tree and the next one in the order of the truth are neighbours in a row."""
    return (np.diff(trees.row) == 0) & (np.diff(trees.column) == 1)


def steps(trees):
    """Distances of neighbours, metres."""
    return np.linalg.norm(np.diff(trees.xy, axis=0), axis=1)[neighbours(trees)]


def unit(vector):
    return vector / np.linalg.norm(vector)


def across(along):
    return np.array([-along[1], along[0]])


@SEEDS
def test_a_path_parts_rows_in_two(seed):
    plain, cut = (simulate(Scene(**BLOCK, **paths), seed).trees for paths in ({}, {"paths": 2, "path_width": 6}))
    before, after = rows_of(plain), rows_of(cut)
    assert len(cut) == len(plain)
    assert len(after) == 3 * len(before)
    np.testing.assert_allclose(steps(cut), 3)
    along = unit(before[0][1] - before[0][0])
    for row, pieces in enumerate(zip(after[0::3], after[1::3], after[2::3], strict=True)):
        assert sum(map(len, pieces)) == len(before[row])
        for one, other in pairwise(pieces):
            apart = other[0] - one[-1]
            assert 3 + 6 <= apart @ along < 3 + 6 * 1.02
            assert abs(apart @ across(along)) < 1e-6


@pytest.mark.parametrize("scene", [{}, {"contour": 3.0}, {"hedgerow": 1.6}], ids=str)
@OUTLINES
@SEEDS
def test_paths_are_clear_of_trees(seed, outline, scene):
    """Trees of one place in the field, but on two sides of a path, are at least the path's width apart."""
    trees = simulate(Scene(**EXACT, outline=outline, paths=3, path_width=8.0, row_spacing=4.0, **scene), seed).trees
    hedges = 2 if "hedgerow" in scene else 1
    assert len(np.unique(trees.row)) > 60 * hedges
    ends = np.flatnonzero((np.diff(trees.column) == 1) & (np.diff(trees.row) == 1))
    assert len(ends) > 40 * hedges
    apart = np.linalg.norm(trees.xy[ends] - trees.xy[ends + 1], axis=1)
    assert apart.min() > 8.0 + 2.9
    for end in ends[::5]:
        middle = trees.xy[end : end + 2].mean(axis=0)
        assert np.linalg.norm(trees.xy - middle, axis=1).min() > 4.0


@SEEDS
def test_canopies_never_merge_across_a_path_or_a_double_row(seed):
    scene = Scene(**TOGETHER, merged=0.3, missed=0.0, jitter=0.0, planting_jitter=0.0)
    simulation = simulate(scene, seed)
    merged = simulation.reference_trees[simulation.reference_trees[:, 1] >= 0]
    assert len(merged) > 300
    one, other = merged.T
    assert np.array_equal(simulation.trees.row[one], simulation.trees.row[other])
    assert np.linalg.norm(simulation.trees.xy[one] - simulation.trees.xy[other], axis=1).max() < 1.5 * scene.spacing


@OUTLINES
@SEEDS
def test_contour_rows_sway_both_ways_and_stay_nearly_parallel(seed, outline):
    scene = Scene(**EXACT, outline=outline, contour=3.0)
    straight, swaying = (simulate(s, seed).trees for s in (scene.model_copy(update={"contour": 0.0}), scene))
    aside = np.linalg.norm(swaying.xy - straight.xy, axis=1)
    assert np.sqrt(np.mean(aside**2)) == pytest.approx(3.0, rel=0.01)
    assert np.all((steps(swaying) >= 2.999) & (steps(swaying) <= 3.3))
    assert steps(swaying).max() > 3.03

    lines = [shapely.LineString(row) for row in rows_of(swaying) if len(row) > 1]
    for line, following in pairwise(lines):
        inner = [p for p in shapely.points(shapely.get_coordinates(line)) if nearest_inside(following, p)]
        distance = shapely.distance(inner, following)
        assert np.all((distance > 0.74 * 5.5) & (distance < 1.26 * 5.5))

    bends = np.concatenate([turns(row) for row in rows_of(swaying) if len(row) > 20])
    assert (bends > 1e-3).mean() > 0.15
    assert (bends < -1e-3).mean() > 0.15


def nearest_inside(line, point):
    """Whether the nearest place of a line is not one of its ends."""
    return 0 < line.project(point) < line.length


def turns(row):
    """How far the direction turns at each inner tree, radians."""
    direction = np.unwrap(np.arctan2(*np.diff(row, axis=0).T[::-1]))
    return np.diff(direction)


@SEEDS
def test_headlands_are_rows_across_beyond_both_ends(seed):
    scene = Scene(**BLOCK, headlands=2)
    rows = rows_of(simulate(scene, seed).trees)
    main_rows, headlands = rows[:-4], rows[-4:]
    along = unit(main_rows[0][1] - main_rows[0][0])
    first, last = main_rows[0][0] @ along, main_rows[0][-1] @ along
    width = np.linalg.norm(main_rows[-1][0] - main_rows[0][0])
    for row, place in zip(headlands, (first - 5.5, first - 11, last + 5.5, last + 11), strict=True):
        np.testing.assert_allclose(row @ along, place, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(np.diff(row, axis=0), axis=1), 3)
        assert width - 3 < np.linalg.norm(row[-1] - row[0]) <= width + 1e-6
    assert len(np.concatenate(main_rows)) == len(simulate(Scene(**BLOCK), seed).trees)


@SEEDS
def test_headlands_leave_the_bow_of_the_rows(seed):
    row = rows_of(simulate(Scene(**BLOCK, headlands=3, curve=12), seed).trees)[0]
    chord = unit(row[-1] - row[0])
    assert np.abs((row - row[0]) @ across(chord)).max() == pytest.approx(12, rel=0.02)


@SEEDS
def test_double_rows_are_staggered(seed):
    scene = Scene(**BLOCK, row_spacing=7, hedgerow=2, spacing=2.2)
    trees = simulate(scene, seed).trees
    rows = rows_of(trees)
    assert len(trees) == pytest.approx(1500, abs=60)
    np.testing.assert_allclose(steps(trees), 2.2)
    along = unit(rows[0][1] - rows[0][0])
    place = np.array([row[0] @ across(along) for row in rows])
    np.testing.assert_allclose(np.diff(place)[0::2], 2, atol=1e-6)
    np.testing.assert_allclose(np.diff(place)[1::2], 5, atol=1e-6)
    for one, other in zip(rows[0::2], rows[1::2], strict=True):
        np.testing.assert_allclose((other - one) @ along, 1.1)
    ground = 7 * 2.2 / 2
    assert np.median(trees.area) == pytest.approx(scene.crown_cover * ground, rel=0.1)


def test_another_orchard_has_double_rows_to_its_scale():
    scene = Scene(**BLOCK, hedgerow=1.0, spacing=4, missed=0, dead=0, same_orchard=False, other_scale=0.5)
    simulation = simulate(scene, 0)
    start = simulation.source_trees[simulation.source_trees >= 0].min()
    first, second = (
        cKDTree(xy).query(xy, k=2)[0][:, 1].min() for xy in (simulation.trees.xy[:start], simulation.trees.xy[start:])
    )
    assert second == pytest.approx(first / 2, rel=0.01)


@pytest.mark.parametrize("curve", [0.0, 8.0])
@OUTLINES
@SEEDS
def test_all_of_it_together(seed, outline, curve):
    scene = Scene(**{**TOGETHER, "curve": curve}, outline=outline, holes=3, overlap=0.7, distortion=0.5)
    orchard = plant(scene, np.random.default_rng(seed))
    block = shapely.Polygon(orchard.outline)
    assert block.is_valid
    assert block.exterior.is_ccw
    assert shapely.distance(block, shapely.points(orchard.positions)).max() < 0.1

    trees = simulate(scene, seed).trees
    assert np.array_equal(np.lexsort((trees.column, trees.row)), np.arange(len(trees)))
    assert np.array_equal(np.unique(trees.row), np.arange(trees.row.max() + 1))
    apart = steps(trees)
    assert len(apart) > 0.75 * len(trees)
    assert np.quantile(apart, [0.01, 0.5, 0.99]) == pytest.approx([1.8, 2.25, 2.75], abs=0.25)


def test_a_perfect_lattice_has_none_of_it():
    plain = simulate(Scene(periodic=True), 0)
    asked = simulate(Scene(periodic=True, paths=2, contour=3, headlands=1, hedgerow=2), 0)
    assert digest(plain) == digest(asked)


def test_the_families_have_what_they_are_named_for():
    for seed in range(20):
        paths, contour, headlands, double, dense = (
            family_scene(name, seed) for name in ("paths", "contour", "headlands", "double_hedgerow", "dense")
        )
        assert paths.paths in (2, 3)
        assert 2 <= contour.contour <= 4
        assert headlands.headlands in (1, 2)
        assert headlands.outline == "rectangle"
        assert 1.8 <= double.hedgerow <= 2.3
        assert dense.trees < 1600
        assert dense.row_spacing < 3.9
        assert (dense.split, dense.merged) == (0.04, 0.04)


@pytest.mark.parametrize(
    ("scene", "sentence"),
    [
        ({"hedgerow": 3}, "hedgerow are 3 m apart, more than half the row spacing of 5.5 m"),
        ({"paths": 15}, "Rows of about 52 trees are too short for 15 paths: ask for at most 12, or for more trees"),
        ({"trees": 20, "paths": 2}, "too short for 2 paths: ask for none, or for more trees"),
        ({"paths": 21}, "less than or equal to 20"),
        ({"headlands": -1}, "greater than or equal to 0"),
    ],
)
def test_what_does_not_go_together_is_refused(scene, sentence):
    with pytest.raises(ValidationError, match=sentence):
        Scene(**scene)


def test_a_field_too_small_for_its_contour_is_refused():
    with pytest.raises(UsageError, match=r"contour of 30 m bends rows of .* ask for a smaller contour"):
        simulate(Scene(trees=200, contour=30), 0)


def test_the_command_has_the_options(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ["--paths", "2", "--path-width", "6", "--contour", "1.5", "--headlands", "1", "--hedgerow", "1.5"]
    assert main(["simulate", "there", "--trees", "900", *options, "--seed", "3", "-q", "--no-rasters"]) == 0
    truth = json.loads(Path("there/truth.json").read_text())
    scene = Scene(trees=900, paths=2, path_width=6, contour=1.5, headlands=1, hedgerow=1.5)
    assert [tree["row"] for tree in truth["trees"]] == simulate(scene, 3).trees.row.tolist()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--hedgerow", "3"], "ask for a smaller hedgerow, or for a larger row spacing."),
        (["--paths", "13"], "ask for at most 12, or for more trees."),
        (["--paths", "1.5"], "--paths is 1.5"),
        (["--headlands", "6"], "--headlands is 6, but must be at least 0, at most 5"),
        (["--contour", "80"], "ask for a smaller contour, or for more trees."),
    ],
)
def test_the_command_refuses_in_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "there", *options]) == 2
    stderr = capsys.readouterr().err
    assert sentence in stderr
    assert len(stderr.splitlines()) == 1
    assert not Path("there").exists()
