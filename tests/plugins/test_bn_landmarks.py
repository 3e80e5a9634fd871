"""Landmarks: are the chosen trees in both surveys, are the probabilities true, do they span the orchard?

`benchmarks.landmarks` prints the same figures on more seeds.
"""

from __future__ import annotations

import copy
import json
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from treereg_bn_landmarks import Landmarks, network
from treereg_bn_landmarks.landmarks import probabilities
from treereg_bn_landmarks.memory import Memory
from treereg_bn_landmarks.structure import EVIDENCE, PARENTS, STATES, shape

from benchmarks.landmarks import calibration_error, chosen, confidence_filter, found, true_landmarks
from treereg_core.cli import main
from treereg_core.errors import InputError, NoRegistration
from treereg_core.evidence import Evidence
from treereg_core.features import BoolArray, FeatureSet
from treereg_core.learning import Outcome
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair
from treereg_core.simulate import Scene, Simulation, family_scene, simulate, simulate_family, write_simulation
from treereg_core.testing import scenes
from treereg_core.transform import FloatArray, Rigid

CONTEXT = Context()
SEEDS = range(7000, 7004)


@pytest.fixture(scope="module")
def noisy() -> list[Simulation]:
    return [simulate_family("noisy", seed) for seed in SEEDS]


def outcome(simulation: Simulation, home: Rigid | None = None) -> Outcome:
    """What the filter is told when a simulation was registered right."""
    assert simulation.truth is not None
    pair = Pair(simulation.reference, simulation.source, simulation.truth)
    return Outcome(pair, simulation.true_pairs(), home)


def test_the_chosen_are_in_both_surveys_and_the_probabilities_are_true(noisy: list[Simulation]) -> None:
    every = [found(simulation, 0.2) for simulation in noisy]
    truth, kept, plain = (np.concatenate([getattr(f, name) for f in every]) for name in ("truth", "chosen", "plain"))
    assert 0.6 < truth.mean() < 0.75
    assert truth[kept].mean() >= 0.97
    assert truth[kept].mean() > truth[plain].mean() + 0.1
    assert calibration_error(np.concatenate([f.probability for f in every]), truth) < 0.05


@pytest.mark.parametrize("family", ["shift_3", "overlap_60", "curved"])
def test_probabilities_are_true_of_other_orchards_too(family: str) -> None:
    every = [found(simulate_family(family, seed), 0.2) for seed in SEEDS[:2]]
    truth, probability = (np.concatenate([getattr(f, name) for f in every]) for name in ("truth", "probability"))
    assert calibration_error(probability, truth) < 0.05
    assert truth[np.concatenate([f.chosen for f in every])].mean() > 0.99


def test_a_share_of_each_survey_goes_on_with_partners_and_weights(noisy: list[Simulation]) -> None:
    pair = scenes.near(noisy[0])
    halved = pair.reference.replace(weight=np.full(len(pair.reference), 0.5))
    kept = Landmarks(share=0.3).select(pair.narrow(halved, pair.source), CONTEXT)
    for before, after in ((pair.reference, kept.reference), (pair.source, kept.source)):
        assert len(after) == np.ceil(0.3 * len(before))
    reference, source = probabilities(pair, CONTEXT)
    assert kept.reference.weight == pytest.approx(0.5 * reference[pair.reference.positions(kept.reference.ids)])
    assert kept.source.weight == pytest.approx(source[pair.source.positions(kept.source.ids)])
    both = noisy[0].true_pairs()
    together = np.isin(both[:, 0], kept.reference.ids) & np.isin(both[:, 1], kept.source.ids)
    assert together.sum() > 0.9 * len(kept.reference)
    everything = Landmarks(share=1.0).select(pair, CONTEXT)
    assert len(everything.reference) == len(pair.reference)


def test_the_probability_under_a_placement_is_no_evidence_for_it() -> None:
    pair = scenes.near(scenes.ordinary())
    kept = Landmarks().select(pair, CONTEXT)
    assert Evidence(kept.reference, kept.source).names == Evidence(pair.reference, pair.source).names


@pytest.fixture(scope="module")
def orchard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("orchard")
    scene = Scene(trees=400, missed=0.1, false=0.15, jitter=0.15, area_persistence=0.9, shift_sd=8.0, rotation_sd=3.0)
    write_simulation(simulate(scene, 4), folder)
    return folder


def run(orchard: Path, out: Path, *options: str, source: str = "source") -> tuple[list[Any], list[Any]]:
    """The properties of the registered detections and of the matches that the command writes."""
    main(["run", str(orchard / "reference"), str(orchard / source), "-q", "--out", str(out), *options])
    files = (json.loads((out / f"{name}.geojson").read_text()) for name in ("detections_registered", "tree_matches"))
    detections, matches = ([feature["properties"] for feature in file["features"]] for file in files)
    return detections, matches


@pytest.mark.parametrize("method", ["bn_landmarks+icp", "combined"])
def test_the_registered_files_have_the_probability_of_every_tree(method: str, orchard: Path, tmp_path: Path) -> None:
    detections, matches = run(orchard, tmp_path / "out", "--method", method)
    truth = json.loads((orchard / "truth.json").read_text())
    probability = np.array([properties["landmark_probability"] for properties in detections])
    assert len(probability) == len(truth["source_trees"])
    assert ((probability >= 0) & (probability <= 1)).all()
    shown = {tree for trees in truth["reference_trees"] for tree in trees}
    false = np.array([not trees for trees in truth["source_trees"]])
    both = np.array([bool(shown & set(trees)) for trees in truth["source_trees"]])
    assert probability[both].mean() > 0.85
    assert probability[false].mean() < 0.4
    assert len(matches) > 250
    assert all(0 <= match["reference_landmark_probability"] <= 1 for match in matches)
    assert all(match["source_landmark_probability"] == probability[match["source"]] for match in matches)


def test_without_the_filter_nothing_is_said_of_landmarks(orchard: Path, tmp_path: Path) -> None:
    detections, matches = run(orchard, tmp_path / "out", "--method", "icp")
    assert set().union(*detections) == {"confidence"}
    assert set().union(*matches) == {"reference", "source", "residual_m"}


def test_files_that_were_forced_say_it_and_every_run_the_same(orchard: Path, tmp_path: Path) -> None:
    forced = ("--method", "bn_landmarks+icp", "--max-failure", "0", "--force")
    for threads in ("1", "2"):
        detections, _ = run(orchard, tmp_path / threads, *forced, "--threads", threads)
        assert all("landmark_probability" in properties for properties in detections)
    for name in ("detections_registered.geojson", "tree_matches.geojson"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_an_earlier_runs_probability_is_replaced_and_a_table_says_it_too(orchard: Path, tmp_path: Path) -> None:
    import geopandas

    expected, _ = run(orchard, tmp_path / "out", "--method", "bn_landmarks+icp")
    table = geopandas.read_file(orchard / "source" / "raw-detections.geojson").assign(landmark_probability="old")
    (tmp_path / "table").mkdir()
    table.to_file(tmp_path / "table" / "raw-detections.gpkg")
    found, _ = run(orchard, tmp_path / "again", "--method", "bn_landmarks+icp", source=str(tmp_path / "table"))
    assert [p["landmark_probability"] for p in found] == [p["landmark_probability"] for p in expected]


def test_rows_of_the_chosen_alone_say_nothing_on_the_others(orchard: Path, tmp_path: Path) -> None:
    """Rows that were found among the chosen are no evidence that the other trees stand in none."""
    before, _ = run(orchard, tmp_path / "out", "--method", "bn_landmarks+icp")
    after, _ = run(orchard, tmp_path / "rows", "--method", "bn_landmarks+aco")
    changed = [abs(a["landmark_probability"] - b["landmark_probability"]) for a, b in zip(before, after, strict=True)]
    assert np.mean(changed) < 0.01


def test_with_a_threshold_all_but_unlikely_trees_go_on_and_keep_their_weights(noisy: list[Simulation]) -> None:
    for simulation in noisy:
        pair = scenes.near(simulation)
        truth = true_landmarks(simulation)
        kept = Landmarks(threshold=0.3).select(pair, CONTEXT)
        for before, after, true in zip(
            (pair.reference, pair.source), (kept.reference, kept.source), truth, strict=True
        ):
            assert (after.weight == 1).all()
            passed = np.isin(before.ids, after.ids)
            assert passed[true].mean() > 0.95
            assert passed[~true].mean() < 0.8
        everything = Landmarks(threshold=0.0).select(pair, CONTEXT)
        assert len(everything.source) == len(pair.source)


def test_a_threshold_that_few_reach_gives_way_to_the_share(noisy: list[Simulation]) -> None:
    pair = scenes.near(noisy[0])
    kept = Landmarks(threshold=1.0, share=0.4).select(pair, CONTEXT)
    for before, after in ((pair.reference, kept.reference), (pair.source, kept.source)):
        assert 0.4 * len(before) <= len(after) < 0.5 * len(before)


def test_the_chosen_span_the_orchard(noisy: list[Simulation]) -> None:
    for simulation in noisy:
        pair = scenes.near(simulation)
        kept = Landmarks().select(pair, CONTEXT)
        assert np.linalg.det(np.cov(kept.reference.xy.T)) > 0.7 * np.linalg.det(np.cov(pair.reference.xy.T))


def test_they_span_it_also_when_one_corner_is_surer_of_itself() -> None:
    """Where half of the orchard was photographed better, the other half still has its share."""
    simulation = scenes.ordinary()
    pair = scenes.near(simulation)
    reference = pair.reference
    west = reference.xy[:, 0] < np.median(reference.xy[:, 0])
    better = reference.replace(confidence=np.where(west, 0.9 + reference.confidence / 10, reference.confidence / 2))
    kept = Landmarks().select(pair.narrow(better, pair.source), CONTEXT).reference
    assert np.isin(reference.ids[~west], kept.ids).sum() > 0.25 * len(kept)


def test_rows_and_memory_are_evidence() -> None:
    """A tree that stands in no row, or that no earlier survey had, is less likely to be one."""
    table = network.posterior(network.none())
    usual = {node: len(STATES[node]) // 2 for node in EVIDENCE}
    usual |= {"row": len(STATES["row"]), "earlier": len(STATES["earlier"])}
    usual |= {"partner": STATES["partner"].index("apart_unlike"), "their": STATES["their"].index("good")}

    def landmark(**known: str) -> float:
        at = {**usual, **{node: STATES[node].index(state) for node, state in known.items()}}
        return float(table[tuple(at[node] for node in EVIDENCE)][1])

    assert landmark(row="none") < landmark() < landmark(row="in")
    assert landmark(earlier="never") < landmark() < landmark(earlier="often")
    assert landmark(partner="nothing", their="none") < landmark(partner="close_like", their="good")
    assert landmark(confidence="lowest") < landmark(confidence="highest")


def test_what_stands_there_may_be_unknown() -> None:
    table = network.posterior(network.none())
    seen = np.array([[len(STATES[node]) // 2 for node in EVIDENCE]] * 2)
    for node, states in {"partner": ("nothing", "close_like"), "their": ("none", "good")}.items():
        seen[:, EVIDENCE.index(node)] = [STATES[node].index(state) for state in states]
    (_, nothing), (_, partner) = network.look_up(table, seen)
    unknown = network.look_up(table, network.partners_unknown(seen))[:, 1]
    assert nothing < unknown[0] == unknown[1] < partner


def test_detected_rows_are_looked_at() -> None:
    simulation = scenes.scene("noisy")
    pair = scenes.near(simulation)
    rows = replace(scenes.true_rows(simulation), matches=np.empty((0, 2)))
    truth = np.concatenate(true_landmarks(simulation))

    def brier(pair: Pair) -> float:
        return float(((np.concatenate(probabilities(pair, CONTEXT)) - truth) ** 2).mean())

    assert brier(replace(pair, rows=rows)) < brier(pair)
    nothing = MatchedRows(type(rows.reference)(()), type(rows.source)(()), rows.matches)
    assert brier(replace(pair, rows=nothing)) == brier(pair)


def test_a_poor_start_gives_few_landmarks_and_no_nonsense() -> None:
    simulation = scenes.ordinary()
    good = scenes.near(simulation)
    away = good.at(Rigid.turn(30, about=good.reference.xy.mean(axis=0)) @ good.reference_from_source)
    p = np.concatenate(probabilities(away, CONTEXT))
    assert ((p >= 0) & (p <= 1)).all()
    assert p.mean() < np.concatenate(probabilities(good, CONTEXT)).mean() - 0.15
    nowhere = good.at(Rigid(np.eye(2), (5000, 0)) @ good.reference_from_source)
    assert np.concatenate(probabilities(nowhere, CONTEXT)).max() < 0.5
    assert len(Landmarks().select(nowhere, CONTEXT).reference) > 0


@pytest.mark.parametrize("name", list(scenes.degenerate()))
def test_too_few_trees_are_refused_in_words(name: str) -> None:
    with pytest.raises(NoRegistration, match="survey"):
        Landmarks().select(scenes.degenerate()[name], CONTEXT)


def test_equal_confidences_and_crowns_tell_nothing_and_break_nothing() -> None:
    simulation = scenes.ordinary()
    pair = scenes.near(simulation)
    same = [FeatureSet.of(f.xy) for f in (pair.reference, pair.source)]
    kept = Landmarks().select(Pair(same[0], same[1], pair.reference_from_source), CONTEXT)
    assert true_landmarks(simulation)[0][kept.reference.ids].mean() > 0.95
    weightless = pair.reference.replace(weight=np.zeros(len(pair.reference)))
    assert (Landmarks().select(pair.narrow(weightless, pair.source), CONTEXT).reference.weight == 0).all()


def test_the_state_is_json_and_what_it_says_is_used(noisy: list[Simulation]) -> None:
    method = Landmarks()
    simulation = noisy[0]
    assert simulation.truth is not None
    home = Rigid.turn(20, shift=(300.0, -80.0))
    state: Any = {}
    for _ in range(3):
        before = copy.deepcopy(state)
        after = method.learn(outcome(simulation, home), state)
        assert state == before
        state = json.loads(json.dumps(after))
        assert state == after
    pair = scenes.near(simulation)
    plain = probabilities(pair, CONTEXT)[1]
    known = probabilities(pair, Context(memory={"bn_landmarks": state}, home_from_reference=home))[1]
    counts_alone = probabilities(pair, Context(memory={"bn_landmarks": state}))[1]
    assert not np.allclose(counts_alone, plain)
    assert not np.allclose(known, counts_alone)
    # Elsewhere nothing is known of single trees.
    far = Context(memory={"bn_landmarks": state}, home_from_reference=Rigid(np.eye(2), (1e4, 0)) @ home)
    assert probabilities(pair, far)[1] == pytest.approx(probabilities(pair, Context(memory=far.memory))[1])


def test_trees_of_earlier_surveys_tell_the_false_ones(noisy: list[Simulation]) -> None:
    """With the trees that other surveys of the same orchard had, the probabilities are nearer to the truth."""
    simulation = noisy[1]
    trees, rng = simulation.trees.xy, np.random.default_rng(5)
    memory = Memory()
    for _ in range(4):
        shown = trees[rng.random(len(trees)) > 0.2]
        memory = memory.with_trees(shown + rng.normal(0, 0.3, shown.shape), 3.0, lambda xy: np.ones(len(xy), bool))
    assert len(memory.trees) < 1.1 * len(trees)
    pair = scenes.near(simulation)
    truth = np.concatenate(true_landmarks(simulation))
    known = Context(memory={"bn_landmarks": memory.state()}, home_from_reference=Rigid.identity())
    brier = [float(((np.concatenate(probabilities(pair, c)) - truth) ** 2).mean()) for c in (CONTEXT, known)]
    assert brier[1] < 0.98 * brier[0]


def informed(seed: int, confidence_information: float) -> Simulation:
    scene = family_scene("noisy", seed).model_copy(update={"confidence_information": confidence_information})
    return simulate(scene, seed)


def test_a_detector_that_knows_what_it_sees_is_found_out() -> None:
    """Learned counts make the probabilities truer where the orchard's detector is not the usual one."""
    method, state = Landmarks(), {}
    for seed in range(3):
        state = dict(method.learn(outcome(informed(seed, 1.0)), state))
    learned = Context(memory={"bn_landmarks": state})
    brier = dict.fromkeys(("prior", "learned"), 0.0)
    for seed in range(10, 13):
        simulation = informed(seed, 1.0)
        pair, truth = scenes.near(simulation), np.concatenate(true_landmarks(simulation))
        for name, context in (("prior", CONTEXT), ("learned", learned)):
            brier[name] += float(((np.concatenate(probabilities(pair, context)) - truth) ** 2).mean())
    assert brier["learned"] < 0.98 * brier["prior"]


def test_old_surveys_fade(noisy: list[Simulation]) -> None:
    method = Landmarks()

    def sure(state: Any) -> float:
        """How often the lowest confidence belongs to a real tree of usual size."""
        return float(network.together(Memory.of(state).counts)["confidence"][1, 1, 2, 0])

    state: Any = {}
    for seed in range(3):
        state = method.learn(outcome(informed(seed, 1.0)), state)
    assert abs(sure(state) - sure({})) > 0.01
    later, from_start = state, {}
    for _ in range(30):
        later = method.learn(outcome(noisy[0]), later)
        from_start = method.learn(outcome(noisy[0]), from_start)
    assert sure(later) == pytest.approx(sure(from_start), abs=0.001)
    # No survey counts for more than so many trees on each side, and all together for five of them.
    assert sum(map(sum, later["counts"]["size"])) < 2 * 2000 * 5 + 1


def test_trees_that_are_no_longer_seen_are_forgotten() -> None:
    method, simulation = Landmarks(), scenes.ordinary()
    state = method.learn(outcome(simulation, Rigid.identity()), {})
    half = simulation.source.take(simulation.source.xy[:, 0] < np.median(simulation.source.xy[:, 0]))
    assert simulation.truth is not None
    first = len(state["trees"])
    for _ in range(2):
        state = method.learn(outcome(simulation, Rigid.identity()), state)
    assert len(state["trees"]) == first
    assert all(missed == 0 for *_, missed in state["trees"])
    # The other half is not covered: it is neither seen nor missed.
    partial = Outcome(Pair(simulation.reference, half, simulation.truth), np.empty((0, 2)), Rigid.identity())
    after = method.learn(partial, state)
    assert sum(missed > 0 for *_, missed in after["trees"]) < 0.05 * first
    for _ in range(20):
        after = method.learn(partial, after)
    assert len(after["trees"]) == pytest.approx(len(half), rel=0.1)


def everywhere(xy: FloatArray) -> BoolArray:
    return np.ones(len(xy), dtype=bool)


def grid(x: float = 0, y: float = 0) -> FloatArray:
    """Ten rows of twenty trees, 3 m apart, from here on."""
    columns, rows = np.meshgrid(x + 3.0 * np.arange(20), y + 5.0 * np.arange(10))
    return np.column_stack([columns.ravel(), rows.ravel()])


def test_a_tree_that_is_new_was_missed_before() -> None:
    planted, between = grid(), grid(1.5)
    memory = Memory()
    for _ in range(3):
        memory = memory.with_trees(planted, 3.0, everywhere)
    memory = memory.with_trees(np.concatenate([planted, between]), 3.0, everywhere)
    names = STATES["earlier"]
    once, always = memory.earlier(between, Rigid.identity(), 3.0), memory.earlier(planted, Rigid.identity(), 3.0)
    assert {names[k] for k in once} <= {"seldom", "sometimes"}
    assert {names[k] for k in always} == {"often"}
    assert memory.earlier(np.array([(30.75, 22.5)]), Rigid.identity(), 3.0) == names.index("never")
    assert (memory.earlier(grid(y=500), Rigid.identity(), 3.0) == len(names)).all()


def test_a_survey_that_is_unlike_all_others_changes_little() -> None:
    planted = grid()
    memory = Memory()
    for _ in range(3):
        memory = memory.with_trees(planted, 3.0, everywhere)
    few = np.concatenate([planted[::10], grid(1.5)])
    spoilt = memory.with_trees(few, 3.0, everywhere)
    names = STATES["earlier"]
    assert (spoilt.earlier(planted, Rigid.identity(), 3.0) == names.index("often")).all()
    assert spoilt.trees[:, 3].max() < 3
    assert (spoilt.earlier(grid(1.5), Rigid.identity(), 3.0) == names.index("never")).all()
    # Ground that was not known before is learned as ever.
    beyond = memory.with_trees(grid(500), 3.0, lambda xy: xy[:, 0] > 400)
    assert (beyond.trees[len(planted) :, 2] == 1).all()


def test_a_state_of_the_first_version_is_still_understood(noisy: list[Simulation]) -> None:
    state = dict(Landmarks().learn(outcome(noisy[0], Rigid.identity()), {}))
    old = {**state, "version": 1, "counts": {**state["counts"], "earlier": np.zeros((2, 2, 7, 3)).tolist()}}
    assert Memory.of(old).state() == Memory.of(state).state()
    with pytest.raises(InputError, match="counts are not those"):
        Memory.of({**old, "version": 2})


def damages() -> list[tuple[str, Any]]:
    good = Landmarks().learn(outcome(scenes.ordinary(), Rigid.identity()), {})

    def damaged(**changes: Any) -> Any:
        return {**copy.deepcopy(good), **changes}

    counts = good["counts"]
    return [
        ("a list", [1, 2]),
        ("a later version", damaged(version=99)),
        ("no trees", {k: v for k, v in good.items() if k != "trees"}),
        ("something more", damaged(code="print()")),
        ("text for trees", damaged(trees="many")),
        ("trees of three numbers", damaged(trees=[[1.0, 2.0, 3.0]])),
        ("ragged trees", damaged(trees=[[1.0, 2.0, 1.0, 0.0], [1.0]])),
        ("a tree at infinity", damaged(trees=[[float("inf"), 0.0, 1.0, 0.0]])),
        ("a huge number", damaged(trees=[[10**400, 0.0, 1.0, 0.0]])),
        ("a count below 0", damaged(trees=[[0.0, 0.0, -1.0, 0.0]])),
        ("counts missing", damaged(counts={})),
        ("another shape", damaged(counts={**counts, "size": [[1.0]]})),
        ("not a number", damaged(counts={**counts, "size": [[float("nan")] * 4] * 2})),
        ("true for a count", damaged(counts={**counts, "size": [[True] * 4] * 2})),
        ("a count below 0 in a table", damaged(counts={**counts, "size": [[-1.0] * 4] * 2})),
    ]


@pytest.mark.parametrize(("name", "state"), damages(), ids=[name for name, _ in damages()])
def test_a_damaged_state_is_refused_in_one_sentence(name: str, state: Any) -> None:
    simulation = scenes.ordinary()
    with pytest.raises(InputError, match=r"^what the memory holds for bn_landmarks is damaged: .*; remove it"):
        Landmarks().learn(outcome(simulation), state)
    with pytest.raises(InputError):
        Landmarks().select(scenes.near(simulation), Context(memory={"bn_landmarks": state}))


def test_the_network_is_exported_as_it_is_used() -> None:
    method = Landmarks()
    state = method.learn(outcome(scenes.ordinary()), {})
    files = method.export(state)
    assert files.keys() == {"bn_landmarks.xml"}
    root = ElementTree.fromstring(files["bn_landmarks.xml"].encode())
    assert {v.findtext("NAME") for v in root.iter("VARIABLE")} == set(STATES)
    parents = {d.findtext("FOR"): tuple(g.text for g in d.findall("GIVEN")) for d in root.iter("DEFINITION")}
    assert {node: set(of) for node, of in parents.items()} == {node: set(of) for node, of in PARENTS.items()}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`pgmpy\.estimators\.StructureScore` is deprecated", FutureWarning)
        from pgmpy.inference import VariableElimination
        from pgmpy.readwrite import XMLBIFReader
    read = VariableElimination(XMLBIFReader(string=files["bn_landmarks.xml"]).get_model())
    known = {node: STATES[node][len(STATES[node]) // 2] for node in EVIDENCE}
    asked = read.query(["landmark"], evidence=known, show_progress=False)
    table = network.posterior(Memory.of(state).counts)
    at = tuple(STATES[node].index(known[node]) for node in EVIDENCE)
    assert asked.get_value(landmark="yes") == pytest.approx(table[at][1], abs=1e-6)


def test_the_tables_are_probabilities_and_a_landmark_is_a_tree() -> None:
    for node, table in network.together(network.none()).items():
        assert table.shape == shape(node)
        assert table.sum(axis=-1) == pytest.approx(np.ones(table.shape[:-1]))
        assert node == "landmark" or (table > 0).all()
    table = network.posterior(network.none())
    assert (table[..., 1] <= table[..., 0] + 1e-12).all()


def test_pgmpy_is_imported_only_where_a_network_runs() -> None:
    code = (
        "import sys; from treereg_bn_landmarks import Landmarks; from treereg_core.registry import installed\n"
        "installed(); Landmarks(); assert 'pgmpy' not in sys.modules\n"
        "from treereg_core.testing import scenes; from treereg_core.method import Context\n"
        "Landmarks().select(scenes.near(scenes.ordinary()), Context()); assert 'pgmpy' in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_the_confidence_filter_of_the_benchmark_keeps_the_share() -> None:
    pair = scenes.near(scenes.ordinary())
    assert chosen(confidence_filter(0.2), pair).mean() == pytest.approx(0.2, abs=0.01)
