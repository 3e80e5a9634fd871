"""Rows by ant colony optimisation, beyond what the laws say of every row detector."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from treereg_aco import Aco
from treereg_aco.colony import Colony, construct, deposit
from treereg_aco.compiled import digest
from treereg_aco.frames import Frames
from treereg_aco.ground import STEPS, Ground, graph_of
from treereg_aco.habits import Habits
from treereg_aco.model import RowModel
from treereg_aco.paths import ended_at_paths

from benchmarks.edges import compare
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context
from treereg_core.pair import Rows
from treereg_core.simulate import Scene, Simulation, simulate, simulate_family
from treereg_core.testing import scenes
from treereg_core.transform import FloatArray, Rigid, Similarity

CONTEXT = Context()


def detect(simulation: Simulation, aco: Aco | None = None) -> Rows:
    return (aco or Aco()).detect(simulation.reference, CONTEXT)


def iou(simulation: Simulation, aco: Aco | None = None) -> float:
    return compare(detect(simulation, aco), simulation, simulation.reference).iou


def sets(rows: Rows) -> set[frozenset[int]]:
    return {frozenset(row.tolist()) for row in rows.trees}


def lattice(trees: int, rows: int, spacing: float = 3.0, row_spacing: float = 5.5) -> FloatArray:
    x, y = np.meshgrid(np.arange(trees) * spacing, np.arange(rows) * row_spacing)
    return np.column_stack([x.ravel(), y.ravel()])


def shaken(xy: FloatArray, by: float = 0.2, seed: int = 0) -> FeatureSet:
    return FeatureSet.of(xy + by * np.random.default_rng(seed).standard_normal(xy.shape))


@pytest.mark.parametrize(
    ("family", "least"),
    [
        ("rotation_any", 0.98),
        ("curved", 0.97),
        ("noisy", 0.93),
        ("dense", 0.95),
        ("paths", 0.97),
        ("contour", 0.95),
        ("headlands", 0.95),
        ("double_hedgerow", 0.93),
        ("small_150", 0.95),
    ],
)
def test_steps_are_the_true_ones(family: str, least: float) -> None:
    found = [iou(simulate_family(family, seed)) for seed in (900, 901, 902)]
    assert np.mean(found) >= least, found


def test_a_third_missed_and_a_third_false_still_gives_rows() -> None:
    edges = [
        compare(detect(simulation), simulation, simulation.reference)
        for simulation in (simulate_family("heavy_noise", seed) for seed in (900, 901, 902))
    ]
    assert np.mean([e.precision for e in edges]) >= 0.95
    assert np.mean([e.recall for e in edges]) >= 0.8


def test_rows_end_at_paths_and_go_on_over_gaps() -> None:
    scene = Scene(trees=900, outline="rectangle", gaps=0.06, paths=2, rotation=0)
    simulation = simulate(scene, 3)
    row = dict(zip(range(len(simulation.trees)), simulation.trees.row.tolist(), strict=True))
    shown = simulation.reference_trees[:, 0]
    crossing = bridging = 0
    for a, b in steps(detect(simulation)):
        if shown[a] >= 0 and shown[b] >= 0:
            crossing += row[shown[a]] != row[shown[b]]
            bridging += simulation.trees.column[shown[a]] == simulation.trees.column[shown[b]] - 2
    assert crossing <= 2
    assert bridging >= 10


def steps(rows: Rows) -> Iterable[tuple[int, int]]:
    for row in rows.trees:
        yield from pairwise(row.tolist())


def test_a_hole_does_not_end_rows() -> None:
    xy = lattice(40, 20)
    hole = np.hypot(*(xy - xy.mean(axis=0)).T) < 9
    rows = Aco().detect(shaken(xy[~hole]), CONTEXT)
    assert len(rows) == 20


def test_false_detections_between_trees_are_left_out() -> None:
    simulation = simulate_family("noisy", 904)
    rows = np.concatenate(detect(simulation).trees)
    false = simulation.reference_trees[:, 0] < 0
    assert false[rows].mean() < 0.25 * false.mean()


def test_rows_across_the_others_are_rows_of_their_own() -> None:
    simulation = simulate(Scene(trees=700, outline="rectangle", headlands=1, rotation=0), 5)
    main = simulation.trees.row < simulation.trees.row.max() - 1
    shown = simulation.reference_trees[:, 0]
    of_headland = (shown >= 0) & ~main[shown]
    longest = [row for row in detect(simulation).trees if of_headland[row].mean() > 0.9]
    assert sum(len(row) for row in longest) >= 0.85 * np.count_nonzero(of_headland)
    assert len(longest) <= 4


def test_blocks_that_run_different_ways_keep_their_own_rows() -> None:
    east = lattice(30, 20)
    north = east @ np.array([[0, 1], [-1, 0]]) + [-12, 0]
    rows = Aco().detect(shaken(np.vstack([east, north])), CONTEXT)
    mixed = [row for row in rows.trees if 0 < np.count_nonzero(row < len(east)) < len(row)]
    assert not mixed
    assert len(rows) <= 44


def test_trees_in_triangles_have_rows_one_way() -> None:
    x, y = np.meshgrid(np.arange(14) * 9.0, np.arange(12) * 9.0 * np.sqrt(3) / 2)
    xy = np.column_stack([(x + 4.5 * (np.arange(12) % 2)[:, None]).ravel(), y.ravel()])
    rows = Aco().detect(shaken(xy, 0.5), CONTEXT)
    assert sum(len(row) for row in rows.trees) >= 0.95 * len(xy)
    directions = [np.degrees(np.arctan2(*(xy[row[-1]] - xy[row[0]])[::-1])) % 180 for row in rows.trees if len(row) > 4]
    assert np.ptp((np.array(directions) - directions[0] + 90) % 180) < 15


def test_both_surveys_of_a_square_planting_have_the_same_rows() -> None:
    for seed in range(4):
        simulation = simulate_family("square_any", seed)
        headings = []
        for features in (simulation.reference, simulation.source):
            rows = [row for row in Aco().detect(features, CONTEXT).trees if len(row) > 10]
            ends = np.array([features.xy[row[-1]] - features.xy[row[0]] for row in rows])
            doubled = ((ends[:, 0] + 1j * ends[:, 1]) ** 2 / (ends**2).sum(axis=1)).mean()
            headings.append(np.degrees(np.angle(doubled)) / 2)
        truth = simulation.truth
        assert truth is not None
        assert abs((headings[1] + truth.rotation_deg - headings[0] + 90) % 180 - 90) < 10


@given(
    turn=st.floats(-180, 180),
    shift=st.tuples(st.floats(-6e6, 6e6), st.floats(-6e6, 6e6)),
    scale=st.sampled_from([0.01, 1.0, 300.0]),
    seed=st.integers(0, 9),
)
@settings(max_examples=12, deadline=None)
def test_turning_shifting_scaling_and_shuffling_change_no_row(
    turn: float, shift: tuple[float, float], scale: float, seed: int
) -> None:
    features = scenes.scene("noisy").reference
    moved = Rigid.turn(turn, shift=shift)(Similarity(scale * np.eye(2), (0, 0))(features.xy))
    order = np.random.default_rng(seed).permutation(len(features))
    elsewhere = features.replace(xy=moved, area=features.area * scale**2).take(order)
    there, here = sets(Aco().detect(elsewhere, CONTEXT)), sets(Aco().detect(features, CONTEXT))
    # coordinates six thousand kilometres away have lost some digits
    assert len(there ^ here) <= (0 if scale == 1 else 4)


def test_another_seed_gives_as_good_rows() -> None:
    simulation = simulate_family("noisy", 905)
    found = [Aco().detect(simulation.reference, Context(seed=seed)) for seed in (0, 1, 2)]
    figures = [compare(rows, simulation, simulation.reference).iou for rows in found]
    assert min(figures) > max(figures) - 0.02


@pytest.mark.parametrize(
    "aco",
    [
        Aco(ants=1, iterations=1, elites=1),
        Aco(neighbours=1),
        Aco(neighbours=8, reach=4.5),
        Aco(pheromone_power=0, heuristic_power=5),
        Aco(pheromone_power=2, evaporation=0.9, deposit_window=1),
        Aco(distance_weight=0, angle_weight=1),
        Aco(angle_limit=145),
        Aco(stitching_reach=0),
    ],
    ids=repr,
)
def test_no_setting_breaks_it(aco: Aco) -> None:
    assert iou(simulate_family("rotation_any", 906), aco) > 0.9


@pytest.mark.parametrize(("angle_limit", "trees"), [(145.0, 1), (100.0, 9)])
def test_an_ant_goes_no_sharper_turn_than_allowed(angle_limit: float, trees: int) -> None:
    zigzag = np.column_stack([np.arange(9) * 3.0, 1.2 * (-1.0) ** np.arange(9)])  # angles of 103 degrees
    n = len(zigzag)
    near = np.argsort(np.hypot(*(zigzag[:, None] - zigzag[None]).T), axis=1)[:, 1:]
    ground = Ground(zigzag, np.tile([1.0, 0.0], (n, 1)), np.full(n, 3.0), near, np.zeros(n))
    graph = graph_of(ground, 1.5, 5.0, 1.0)
    habits = Habits(**Aco(angle_limit=angle_limit).model_dump())
    model = RowModel(along=0.3, across=1.0, taken=0.9, strangers=1e-3, half_width=3.0)
    left = np.ones((n, 2, STEPS))
    colony = Colony(ground, graph, model, habits, np.ones(n, bool), np.zeros(n, int), left, np.zeros(n, int))
    row, heuristic = construct(0, colony, 0, np.random.default_rng(0))
    assert len(row) == trees
    assert len(heuristic) == trees - 1


def test_pheromones_grow_on_good_rows_and_evaporate() -> None:
    line = np.column_stack([np.arange(6) * 3.0, np.zeros(6)])
    near = np.argsort(np.abs(np.subtract.outer(np.arange(6), np.arange(6))), axis=1)[:, 1:]
    ground = Ground(line, np.tile([1.0, 0.0], (6, 1)), np.full(6, 3.0), near, np.zeros(6))
    graph = graph_of(ground, 3.4, 5.0, 1.0)
    habits = Habits(**Aco(angle_limit=90, evaporation=0.5, deposit_window=3).model_dump())
    model = RowModel(along=0.3, across=1.0, taken=0.9, strangers=1e-3, half_width=3.0)
    pheromone = np.ones((6, 2, STEPS))
    colony = Colony(ground, graph, model, habits, np.ones(6, bool), np.zeros(6, int), pheromone, np.zeros(6, int))
    deposit(np.arange(6), np.array([0.2, 0.4, 0.6, 0.8, 1.0]), colony, 0)
    to_next = [float(pheromone[k, 0, list(graph.to[k, 0]).index(k + 1)]) for k in range(5)]
    # windows of three with weights 1, 2, 1, cut at the ends
    assert to_next == pytest.approx([1 + 0.8 / 3, 1.4, 1.6, 1.8, 1 + 2.8 / 3])
    skipping = float(pheromone[0, 0, list(graph.to[0, 0]).index(2)])
    assert skipping == 1
    deposit(np.array([1, 2]), np.array([0.5]), colony, 2)
    assert pheromone[1, 0, list(graph.to[1, 0]).index(2)] == pytest.approx(1.4 * 0.5**2 + 0.5)
    assert pheromone[1, 0, list(graph.to[1, 0]).index(3)] == pytest.approx(0.5**2)


def test_a_single_row_and_two_rows_are_found() -> None:
    for trees in (8, 12, 30):
        assert sets(Aco().detect(shaken(lattice(trees, 1)), CONTEXT)) == {frozenset(range(trees))}
    two = Aco().detect(shaken(lattice(15, 2)), CONTEXT)
    assert sets(two) == {frozenset(range(15)), frozenset(range(15, 30))}


def forest(kind: str, trees: int, seed: int) -> FloatArray:
    """Trees anywhere, or anywhere but close to each other."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 4 * np.sqrt(trees), (30 * trees, 2))
    if kind == "anywhere":
        return points[:trees]
    kept: list[FloatArray] = []
    for point in points:
        if not kept or np.hypot(*(np.array(kept) - point).T).min() > 2.9:
            kept.append(point)
    return np.array(kept[:trees])


@pytest.mark.parametrize("trees", [20, 300, 1500])
@pytest.mark.parametrize("kind", ["anywhere", "apart"])
def test_a_forest_is_refused(kind: str, trees: int) -> None:
    with pytest.raises(NoRegistration, match="rows"):
        Aco().detect(FeatureSet.of(forest(kind, trees, 7)), CONTEXT)


@pytest.mark.parametrize(
    "xy",
    [
        np.zeros((0, 2)),
        np.zeros((1, 2)),
        np.array([[0.0, 0], [3, 0], [7, 1]]),
        np.full((50, 2), 7.0),
        np.repeat([[0.0, 0], [5, 5]], 20, axis=0),
        np.repeat(lattice(20, 10), 2, axis=0),
    ],
    ids=["none", "one", "three", "one spot", "two spots", "every tree twice"],
)
def test_what_shows_no_rows_is_refused(xy: FloatArray) -> None:
    with pytest.raises(NoRegistration, match="rows"):
        Aco().detect(FeatureSet.of(xy), CONTEXT)


def test_a_few_trees_seen_twice_at_one_place_do_no_harm() -> None:
    xy = lattice(30, 15)
    rows = Aco().detect(shaken(np.vstack([xy, xy[::9]]), 0.0), CONTEXT)
    assert len(rows) == 15


def test_second_detections_make_no_second_row() -> None:
    rng = np.random.default_rng(1)
    xy = lattice(20, 12)
    seen_twice = rng.random(len(xy)) < 0.2
    rows = Aco().detect(shaken(np.vstack([xy, xy[seen_twice]])), CONTEXT)
    assert len(rows) <= 14


@pytest.mark.parametrize("side", [8, 10, 12])
def test_small_square_orchards_with_many_trees_missing_have_rows(side: int) -> None:
    rng = np.random.default_rng(side)
    refused = 0
    for seed in range(6):
        try:
            rows = Aco().detect(shaken(lattice(side, side, 5, 5)[rng.random(side**2) >= 0.3], 0.35, seed), CONTEXT)
            assert sum(len(row) for row in rows.trees) > 0.5 * 0.7 * side**2
        except NoRegistration:
            refused += 1
    assert refused <= 1


def test_a_block_with_wider_steps_is_not_cut_up() -> None:
    close, wide = lattice(60, 30), lattice(30, 30, 4.5) + np.array([190.0, 0.0])
    rows = Aco().detect(shaken(np.vstack([close, wide]), 0.15), CONTEXT)
    assert len(rows) <= 66


def test_the_search_for_paths_ends_where_rows_meet_in_a_ring() -> None:
    begin = np.array([[3.15, 23.69], [2.8, 10.66], [19.92, 12.71], [11.71, 7.01]])
    heading = np.array([[0.598, 0.802], [-0.887, -0.461], [-0.917, 0.398], [-0.451, 0.893]])
    steps_of = (
        [4.96, 2, 4.96, 4.96, 4.96, 2, 4.96],
        [8, 2],
        [2, 3.67, 2, 2, 3.67, 2, 3.67, 3.67, 2, 2, 3.67, 3.67],
        [2, 2, 5.35, 2, 2, 5.35, 5.35, 2],
    )
    places = [
        b + np.concatenate([[0], np.cumsum(s)])[:, None] * h for b, h, s in zip(begin, heading, steps_of, strict=True)
    ]
    xy = np.vstack(places)
    along = np.vstack([np.tile(h, (len(p), 1)) for h, p in zip(heading * [[1], [-1], [-1], [-1]], places, strict=True)])
    rows = np.split(np.arange(len(xy)), np.cumsum([len(p) for p in places])[:-1])
    frames = Frames(along, np.full(len(xy), 2.0), np.full(len(xy), 4.0), np.zeros((len(xy), 1), int), 4.0)
    assert sum(len(row) for row in ended_at_paths(rows, xy, frames)) <= len(xy)


def test_numba_is_imported_only_when_rows_are_looked_for() -> None:
    code = "import sys, treereg_aco; treereg_aco.Aco(); sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_rings_are_rows() -> None:
    rings = []
    for radius in np.arange(5, 20) * 6.0:
        angle = np.arange(0, 2 * np.pi - 2 / radius, 3 / radius)
        rings.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    rows = Aco().detect(shaken(np.vstack(rings)), CONTEXT)
    radius = [np.hypot(*np.vstack(rings)[row].T) for row in rows.trees]
    assert max(np.ptp(r) for r in radius) < 1
    assert sum(len(row) for row in rows.trees) > 0.98 * len(np.vstack(rings))


def test_compiled_code_is_never_older_than_any_source(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "b.py").write_text("2")
    before = digest(tmp_path)
    assert digest(tmp_path) == before
    (tmp_path / "b.py").write_text("3")
    assert digest(tmp_path) != before
