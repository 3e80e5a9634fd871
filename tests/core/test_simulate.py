"""The simulator keeps its word: measured shares, noise and truth are those of the scene."""

import json

import numpy as np
import pyproj
import pytest
import shapely
from pydantic import ValidationError
from scipy.spatial import cKDTree

from treereg_core.errors import UsageError
from treereg_core.simulate import FAMILIES, Scene, family_scene, simulate, simulate_family, write_simulation
from treereg_core.transform import Model, Rigid

CLEAN = {"jitter": 0.0, "missed": 0.0, "false": 0.0, "split": 0.0, "merged": 0.0, "dead": 0.0}
LARGE = {"trees": 20_000}


def arrays(simulation):
    return [
        *(getattr(survey, name) for survey in (simulation.reference, simulation.source) for name in ("xy", "area")),
        simulation.reference.confidence,
        simulation.source.confidence,
        simulation.trees.xy,
        simulation.reference_trees,
        simulation.source_trees,
    ]


def single(trees):
    return (trees[:, 0] >= 0) & (trees[:, 1] < 0)


def paired(simulation, name):
    pairs = simulation.true_pairs()
    return getattr(simulation.reference, name)[pairs[:, 0]], getattr(simulation.source, name)[pairs[:, 1]]


def correlation(a, b):
    return float(np.corrcoef(a, b)[0, 1])


def test_same_seed_same_surveys():
    once, again, other = (arrays(simulate(Scene(distortion=0.5, holes=2), seed)) for seed in (3, 3, 4))
    assert all(np.array_equal(a, b) for a, b in zip(once, again, strict=True))
    assert not np.array_equal(once[0][:50], other[0][:50])


def test_noise_leaves_the_orchard_as_it_is():
    plain, noisy = simulate(Scene(), 5), simulate(Scene(missed=0.3, jitter=0.5, overlap=0.5, rotation="any"), 5)
    assert np.array_equal(plain.trees.xy, noisy.trees.xy)
    assert np.array_equal(plain.trees.area, noisy.trees.area)


def test_features_come_in_random_order():
    simulation = simulate(Scene(**CLEAN), 0)
    n = len(simulation.trees)
    assert abs(correlation(simulation.reference_trees[:, 0], np.arange(n))) < 0.1
    assert abs(correlation(simulation.source_trees[:, 0], np.arange(n))) < 0.1
    assert abs(correlation(*simulation.true_pairs().T)) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_truth_takes_source_onto_reference(seed):
    simulation = simulate(Scene(**CLEAN, rotation="any", shift_sd=30), seed)
    reference, source = paired(simulation, "xy")
    assert len(reference) == len(simulation.trees)
    np.testing.assert_allclose(simulation.truth(source), reference, atol=1e-9)
    np.testing.assert_allclose(simulation.trees.xy[simulation.reference_trees[:, 0]], simulation.reference.xy)
    assert simulation.error(simulation.true_fit()) < 1e-9
    assert simulation.error(Rigid.turn(0, shift=(0.3, 0.4)) @ simulation.truth) == pytest.approx(0.5)


def test_given_rotation_and_shift():
    simulation = simulate(Scene(rotation=30, shift=(5, -2)), 0)
    misplaced = simulation.truth.inverse()
    assert misplaced.rotation_deg == pytest.approx(30)
    np.testing.assert_allclose(misplaced.shift, (5, -2))


def test_drawn_rotations_and_shifts():
    truths = [simulate(Scene(trees=20, rotation_sd=3, shift_sd=15), seed).truth.inverse() for seed in range(200)]
    assert np.std([t.rotation_deg for t in truths]) == pytest.approx(3, rel=0.2)
    assert np.std([t.shift for t in truths]) == pytest.approx(15, rel=0.15)
    turned = [simulate(Scene(trees=20, rotation="any"), seed).truth.rotation_deg for seed in range(200)]
    assert np.abs(np.mean(np.exp(1j * np.radians(turned)))) < 0.2


def test_fit_on_true_pairs_is_as_good_as_theory_says():
    scene = Scene(trees=400)
    errors = [simulate(scene, seed) for seed in range(100)]
    pairs = np.mean([len(s.true_pairs()) for s in errors])
    rms = np.sqrt(np.mean([s.error(s.true_fit()) ** 2 for s in errors]))
    assert rms == pytest.approx(scene.jitter * np.sqrt(2) * np.sqrt(3 / pairs), rel=0.15)


def test_number_of_trees_and_gaps():
    for outline in ("rectangle", "irregular"):
        full = [len(simulate(Scene(trees=1000, outline=outline, gaps=0), seed).trees) for seed in range(10)]
        assert np.allclose(full, 1000, atol=40)
    left = len(simulate(Scene(**LARGE, gaps=0.2), 0).trees) / len(simulate(Scene(**LARGE, gaps=0), 0).trees)
    assert left == pytest.approx(0.8, abs=0.02)
    assert len(simulate(Scene(gaps=0, holes=10), 0).trees) < 0.97 * len(simulate(Scene(gaps=0), 0).trees)


def test_rows_and_spacings():
    trees = simulate(Scene(planting_jitter=0, gaps=0, outline="rectangle", row_spacing=6, spacing=2), 0).trees
    neighbours = (np.diff(trees.row) == 0) & (np.diff(trees.column) == 1)
    assert neighbours.sum() == len(trees) - (trees.row.max() + 1)
    np.testing.assert_allclose(np.linalg.norm(np.diff(trees.xy, axis=0)[neighbours], axis=1), 2)
    along = trees.xy[1] - trees.xy[0]
    across = trees.xy @ np.array([-along[1], along[0]]) / 2
    np.testing.assert_allclose(across - across[0], 6 * trees.row, atol=1e-6)


def test_rows_bow_by_curve():
    trees = simulate(Scene(planting_jitter=0, gaps=0, outline="rectangle", curve=12), 1).trees
    row = trees.xy[trees.row == 0]
    chord = (row[-1] - row[0]) / np.linalg.norm(row[-1] - row[0])
    off_chord = np.abs((row - row[0]) @ np.array([-chord[1], chord[0]]))
    assert off_chord.max() == pytest.approx(12, rel=0.02)


def test_shares_of_a_survey():
    scene = Scene(**LARGE, missed=0.2, false=0.3, split=0.05, merged=0.0, dead=0.1)
    simulation = simulate(scene, 0)
    n = len(simulation.trees)
    for trees, standing in ((simulation.reference_trees, 1.0), (simulation.source_trees, 0.9)):
        features_of = np.bincount(trees[single(trees), 0], minlength=n)
        assert np.mean(features_of > 0) == pytest.approx(0.8 * standing, abs=0.015)
        assert np.sum(features_of == 2) / np.sum(features_of > 0) == pytest.approx(0.05, abs=0.01)
        assert np.sum(trees[:, 0] < 0) == pytest.approx(0.3 * n * standing, rel=0.02)


def test_detection_noise():
    simulation = simulate(Scene(**LARGE, jitter=0.35, split=0, merged=0), 0)
    for survey, trees, frame in (
        (simulation.reference, simulation.reference_trees, Rigid.identity()),
        (simulation.source, simulation.source_trees, simulation.truth),
    ):
        alone = single(trees)
        off = frame(survey.xy[alone]) - simulation.trees.xy[trees[alone, 0]]
        np.testing.assert_allclose(off.std(axis=0), 0.35, rtol=0.03)


def test_planting_jitter_is_shared():
    scenes = [Scene(**LARGE, **CLEAN, planting_jitter=jitter, rotation=0, shift=(0, 0)) for jitter in (0, 0.3)]
    straight, planted = (simulate(scene, 0) for scene in scenes)
    assert (planted.trees.xy - straight.trees.xy).std() == pytest.approx(0.3, rel=0.03)
    np.testing.assert_allclose(*paired(planted, "xy"), atol=1e-9)


@pytest.mark.parametrize("persistence", [0.0, 0.6, 1.0])
def test_areas_persist_and_grow(persistence):
    scene = Scene(**LARGE, area_persistence=persistence, vigour=0, growth=1.3, split=0, merged=0)
    before, after = np.log(paired(simulate(scene, 0), "area"))
    assert correlation(before, after) == pytest.approx(persistence, abs=0.03)
    assert before.std() == pytest.approx(scene.area_variation, rel=0.03)
    assert np.median(after - before) == pytest.approx(2 * np.log(1.3), abs=0.02)
    assert np.exp(np.median(before)) == pytest.approx(0.35 * 5.5 * 3, rel=0.03)


def test_vigour_is_smooth():
    trees = simulate(Scene(**LARGE, vigour=0.3, area_persistence=0, gaps=0), 0).trees
    assert np.log(trees.area).std() == pytest.approx(0.3, rel=0.05)
    neighbours = np.diff(trees.row) == 0
    assert np.abs(np.diff(np.log(trees.area)))[neighbours].max() < 0.1


def test_confidences():
    simulation = simulate(Scene(**LARGE, false=0.3, confidence=0.7, confidence_information=0.6), 0)
    before, after = (np.log(c / (1 - c)) for c in paired(simulation, "confidence"))
    assert correlation(before, after) == pytest.approx(0.6, abs=0.03)
    false = simulation.reference_trees[:, 0] < 0
    assert np.median(simulation.reference.confidence[~false]) == pytest.approx(0.7, abs=0.02)
    assert np.median(simulation.reference.confidence[false]) < 0.4
    blind = simulate(Scene(**LARGE, false=0.3, confidence_information=0), 0)
    false = blind.reference_trees[:, 0] < 0
    assert blind.reference.confidence[false].mean() == pytest.approx(
        blind.reference.confidence[~false].mean(), abs=0.02
    )


def test_false_detections_lie_in_and_just_around_the_orchard():
    simulation = simulate(Scene(false=1.0, gaps=0, overlap=0.5), 0)
    false = simulation.reference.xy[simulation.reference_trees[:, 0] < 0]
    distance, _ = cKDTree(simulation.trees.xy).query(false)
    assert distance.max() < 5.5 + 1
    assert (distance > 4).sum() > 0
    seen = cKDTree(simulation.reference.xy[simulation.reference_trees[:, 0] >= 0])
    assert seen.query(false)[0].max() < 5.5 + 3


def test_split_and_merged_canopies():
    scene = Scene(**LARGE, jitter=0, area_persistence=1, split=0.1, merged=0.1, missed=0, gaps=0)
    simulation = simulate(scene, 0)
    survey, trees, true = simulation.reference, simulation.reference_trees, simulation.trees
    merged = trees[:, 1] >= 0
    first, second = trees[merged].T
    assert np.array_equal(true.row[first], true.row[second])
    assert np.array_equal(true.column[first] + 1, true.column[second])
    assert len(np.unique(trees[merged])) == 2 * merged.sum()
    assert merged.sum() / len(true) == pytest.approx(0.1, abs=0.02)
    weighted = true.xy[first] * true.area[first, None] + true.xy[second] * true.area[second, None]
    area = true.area[first] + true.area[second]
    np.testing.assert_allclose(survey.xy[merged], weighted / area[:, None])
    np.testing.assert_allclose(survey.area[merged], area)

    order = np.argsort(np.where(single(trees), trees[:, 0], -1))
    twice = np.flatnonzero((np.diff(trees[order, 0]) == 0) & single(trees[order])[1:])
    one, other = order[twice], order[twice + 1]
    tree = trees[one, 0]
    np.testing.assert_allclose(survey.area[one] + survey.area[other], true.area[tree])
    centre = survey.xy[one] * survey.area[one, None] + survey.xy[other] * survey.area[other, None]
    np.testing.assert_allclose(centre / true.area[tree, None], true.xy[tree])
    used = trees[simulation.true_pairs()[:, 0], 0]
    assert not np.isin(used, tree).any()
    assert not np.isin(used, trees[merged]).any()


@pytest.mark.parametrize("outline", ["rectangle", "irregular"])
@pytest.mark.parametrize("overlap", [0.25, 0.5, 0.8])
@pytest.mark.parametrize("crop", ["strips", "windows", "ends", "part"])
def test_overlap(crop, overlap, outline):
    def shared_by_reference(seed):
        simulation = simulate(Scene(**CLEAN, trees=4000, crop=crop, overlap=overlap, outline=outline), seed)
        seen, also = simulation.reference_trees[:, 0], simulation.source_trees[:, 0]
        if crop == "part":
            assert len(seen) == len(simulation.trees)
        else:
            assert len(also) == pytest.approx(len(seen), rel=0.2)
        return np.isin(seen, also).mean()

    assert np.mean([shared_by_reference(seed) for seed in range(8)]) == pytest.approx(overlap, abs=0.05)


def test_ends_leave_each_survey_its_own_end():
    simulation = simulate(Scene(**CLEAN, crop="ends", overlap=0.5), 0)
    n = len(simulation.trees)
    by_reference = np.isin(np.arange(n), simulation.reference_trees[:, 0])
    by_source = np.isin(np.arange(n), simulation.source_trees[:, 0])
    assert (by_reference | by_source).all()
    assert np.mean(by_reference & by_source) == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_truth_under_distortion_is_the_best_rigid(seed):
    simulation = simulate(Scene(**CLEAN, distortion=1.0, rotation="any"), seed)
    reference, source = paired(simulation, "xy")
    best = simulation.truth

    def rms(transform):
        return np.sqrt(((transform(source) - reference) ** 2).sum(axis=1).mean())

    assert 0.2 < rms(best) < 0.8
    assert simulation.bend == pytest.approx(rms(best), rel=1e-6)
    assert simulation.error(Model.RIGID.fit(source, reference)) < 1e-6
    for nudge in (Rigid.turn(0.01), Rigid.turn(-0.01), Rigid.turn(0, shift=(0.01, 0)), Rigid.turn(0, shift=(0, -0.01))):
        assert rms(nudge @ best) > rms(best)


def test_distortion_has_the_length_asked_for():
    off = []
    for seed in range(20):
        simulation = simulate(Scene(**CLEAN, distortion=0.7, rotation=0, shift=(0, 0)), seed)
        reference, source = paired(simulation, "xy")
        off.append(((reference - source) ** 2).sum(axis=1).mean())
    assert np.sqrt(np.mean(off)) * np.sqrt(np.log(10)) == pytest.approx(0.7, rel=0.02)


def test_another_orchard_has_no_truth():
    simulation = simulate(Scene(same_orchard=False, other_scale=1.2), 0)
    assert simulation.truth is None
    assert simulation.true_pairs().shape == (0, 2)
    with pytest.raises(ValueError, match="no true transform"):
        simulation.error(Rigid.identity())
    of_source = simulation.source_trees[:, 0]
    of_source = of_source[of_source >= 0]
    assert of_source.min() > simulation.reference_trees.max()
    assert simulation.source.spacing == pytest.approx(1.2 * simulation.reference.spacing, rel=0.1)
    assert not np.isin(simulation.trees.row[of_source], simulation.trees.row[: of_source.min()]).any()


@pytest.mark.parametrize("seed", range(3))
def test_a_half_turn_leaves_the_periodic_block_the_same(seed):
    simulation = simulate_family("periodic_turn", seed)
    xy = simulation.reference.xy
    turned = Rigid.turn(180, about=xy.mean(axis=0))(xy)
    distance, partner = cKDTree(xy).query(turned)
    assert distance.max() < 1e-6
    assert np.ptp(simulation.reference.area) < 1e-9
    assert np.ptp(simulation.reference.confidence) < 1e-12
    assert len(np.unique(partner)) == len(xy) == len(simulation.source)
    assert simulation.truth is None


@pytest.mark.parametrize("seed", range(30))
def test_periodic_crops_fit_one_tree_over_as_well(seed):
    simulation = simulate_family("periodic_crops", seed)
    trees = simulation.trees
    along = trees.xy[1] - trees.xy[0]
    across = trees.xy[trees.row == 1][0] - trees.xy[0]
    lattice = cKDTree(trees.xy)
    for step in (along, -along, across, -across):
        distance, _ = lattice.query(simulation.reference.xy + step)
        assert distance.max() < 1e-6
    assert 100 < len(simulation.reference) < 0.9 * len(trees)
    assert simulation.truth is None


@pytest.mark.parametrize("name", FAMILIES)
def test_families(name):
    family = FAMILIES[name]
    assert family.name == name
    assert family_scene(name, 1) == family_scene(name, 1) != family_scene(name, 2)
    simulation = simulate_family(name, 1)
    assert (simulation.truth is None) == (family.group == "absent")
    if simulation.truth is not None:
        assert simulation.error(simulation.true_fit()) < 0.5
        assert len(simulation.true_pairs()) > 20


def test_family_groups():
    sizes = {group: sum(f.group == group for f in FAMILIES.values()) for group in ("ordinary", "hard", "frontier")}
    assert sizes == {"ordinary": 19, "hard": 6, "frontier": 6}


def test_unknown_family():
    with pytest.raises(UsageError, match="did you mean 'shift_15'"):
        family_scene("shift_16", 0)


def test_scene_is_strict_and_survives_json():
    scene = Scene(rotation="any", shift=(1, 2), crop="ends")
    assert Scene.model_validate_json(scene.model_dump_json()) == scene
    with pytest.raises(ValidationError):
        Scene(mised=0.1)
    with pytest.raises(ValidationError):
        Scene(jitter=float("nan"))
    assert all(field.description for field in Scene.model_fields.values())


def test_too_few_trees_are_refused():
    with pytest.raises(UsageError, match="fewer than 3 trees"):
        [simulate(Scene(trees=10, gaps=0.9), seed) for seed in range(20)]


CRS = {"EPSG:32734": (343_000.0, 6_306_000.0), "EPSG:32632": (500_000.0, 5_300_000.0)}


@pytest.mark.parametrize("crs", CRS)
def test_files_hold_the_surveys(tmp_path, crs):
    simulation = simulate(Scene(trees=200, curve=5, false=0.2, merged=0.05, rotation=40), 0)
    write_simulation(simulation, tmp_path / "new", crs, CRS[crs])
    folder = tmp_path / "new"
    truth = json.loads((folder / "truth.json").read_text())
    crs_from_degrees = pyproj.Transformer.from_crs("EPSG:4326", truth["crs"], always_xy=True)

    def polygons(path):
        content = json.loads(path.read_text())
        shapes = shapely.from_geojson([json.dumps(feature["geometry"]) for feature in content["features"]])
        full = shapely.transform(shapes, lambda c: np.column_stack(crs_from_degrees.transform(*c.T)))
        return full, content["features"]

    for name, survey in (("reference", simulation.reference), ("source", simulation.source)):
        shapes, features = polygons(folder / name / "raw-detections.geojson")
        assert shapely.is_valid(shapes).all()
        assert shapely.is_ccw(shapely.get_exterior_ring(shapes)).all()
        centroid = shapely.get_coordinates(shapely.centroid(shapes)) - CRS[crs]
        np.testing.assert_allclose(centroid, survey.xy, atol=3e-4)
        np.testing.assert_allclose(shapely.area(shapes), survey.area, rtol=1e-3)
        assert [f["properties"]["confidence"] for f in features] == survey.confidence.tolist()
        corners = np.array(features[0]["geometry"]["coordinates"])
        np.testing.assert_array_equal(corners, corners.round(9))

        outline, _ = polygons(folder / name / "boundary.geojson")
        assert shapely.is_ccw(shapely.get_exterior_ring(outline)).all()
        assert shapely.contains(outline[0], shapely.points([tree["xy"] for tree in truth["trees"]])).all()

    matrix = np.array(truth["transform"]["matrix"])
    full_source = np.column_stack([simulation.source.xy + CRS[crs], np.ones(len(simulation.source))])
    moved = (full_source @ matrix.T)[:, :2]
    np.testing.assert_allclose(moved, simulation.truth(simulation.source.xy) + CRS[crs], atol=1e-6)
    np.testing.assert_allclose(
        (moved - full_source[:, :2]).mean(axis=0), truth["transform"]["translation_m"], atol=1e-6
    )
    assert truth["transform"]["rotation_deg"] == pytest.approx(-40)
    for name, trees in (("reference", simulation.reference_trees), ("source", simulation.source_trees)):
        assert truth[f"{name}_trees"] == [[t for t in pair if t >= 0] for pair in trees.tolist()]
    np.testing.assert_allclose([t["xy"] for t in truth["trees"]], simulation.trees.xy + CRS[crs], atol=1e-4)
    assert [t["row"] for t in truth["trees"]] == simulation.trees.row.tolist()
    names = sorted(path.name for path in folder.rglob("*") if path.is_file())
    assert names == ["boundary.geojson"] * 2 + ["raw-detections.geojson"] * 2 + ["truth.json"]


def test_same_seed_same_files(tmp_path):
    for name in ("a", "b"):
        write_simulation(simulate_family("small_60", 3), tmp_path / name)
    for path in (tmp_path / "a").rglob("*.*json"):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()


def test_absent_truth_is_null_in_the_file(tmp_path):
    write_simulation(simulate(Scene(trees=50, same_orchard=False), 0), tmp_path)
    assert json.loads((tmp_path / "truth.json").read_text())["transform"] is None


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="choose another folder"):
        write_simulation(simulate(Scene(trees=50), 0), tmp_path / "file")
