"""Rows in the order and sense in which people count them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from treereg_core.features import FeatureSet
from treereg_core.numbering import common_direction, numbered
from treereg_core.pair import Rows
from treereg_core.simulate import FAMILIES, Scene, Simulation, simulate, simulate_family
from treereg_core.testing.scenes import true_rows
from treereg_core.testing.strategies import feature_sets, rows_of
from treereg_core.transform import FloatArray, Rigid

Plan = list[list[int]]
"""Rows as lists of tree ids."""


def field(rows: list[FloatArray]) -> tuple[FeatureSet, Plan]:
    """Trees of rows that are given in their right order, and the rows."""
    ends = np.cumsum([0, *map(len, rows)])
    return FeatureSet.of(np.concatenate(rows)), [list(range(a, b)) for a, b in pairwise(ends.tolist())]


def block(rows: int, trees: int, row_spacing: float = 5.0, spacing: float = 3.0) -> list[FloatArray]:
    """Rows that run east, the northernmost first."""
    x = spacing * np.arange(trees)
    return [np.column_stack([x, np.full(trees, -row_spacing * row)]) for row in range(rows)]


def bent(rows: list[FloatArray], bow_m: float, length_m: float) -> list[FloatArray]:
    """The same rows, moved north in the middle of the field by so many metres."""
    return [row + np.column_stack([0 * row[:, 0], bow_m * (1 - (2 * row[:, 0] / length_m - 1) ** 2)]) for row in rows]


def turned(features: FeatureSet, angle_deg: float) -> FeatureSet:
    return features.replace(xy=Rigid.turn(angle_deg, about=features.xy.mean(axis=0))(features.xy))


def shuffled(plan: Plan, seed: int) -> Rows:
    """The rows in another order, some of them the other way round."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(plan))
    return Rows(tuple(np.array(plan[row][:: rng.choice([-1, 1])], dtype=np.int64) for row in order))


def counted(plan: Plan, features: FeatureSet, seed: int = 1) -> Plan:
    """The rows as they are counted, whatever order and sense they came in."""
    return [row.tolist() for row in numbered(shuffled(plan, seed), features).trees]


def planted(simulation: Simulation) -> tuple[Plan, list[Plan]]:
    """The true rows of the reference, and the two orders of them in which neighbours follow each other."""
    plan = [row.tolist() for row in true_rows(simulation).reference.trees]
    both = [[sorted(row) for row in order] for order in (plan, plan[::-1])]
    return plan, both


@pytest.mark.parametrize(
    ("heading_deg", "first_row", "first_tree"),
    [
        (0, "north", "west"),
        (40, "north", "west"),
        (-40, "north", "west"),
        (50, "west", "north"),
        (90, "west", "north"),
        (130, "west", "north"),
        (140, "north", "west"),
        (180, "north", "west"),
        (270, "west", "north"),
    ],
)
@pytest.mark.parametrize("shape", [(4, 30), (30, 4)])
def test_row_one_and_tree_one_are_at_the_north_western_corner(
    heading_deg: float, first_row: str, first_tree: str, shape: tuple[int, int]
) -> None:
    features, plan = field(block(*shape))
    features = turned(features, heading_deg)
    rows = counted(plan, features)
    step = {"north": (0, 1), "west": (-1, 0)}
    rows_apart = features.xy[rows[0]].mean(axis=0) - features.xy[rows[-1]].mean(axis=0)
    trees_apart = features.xy[rows[0][0]] - features.xy[rows[0][-1]]
    assert rows_apart @ step[first_row] > 0
    assert trees_apart @ step[first_tree] > 0
    assert all((features.xy[row[0]] - features.xy[row[-1]]) @ trees_apart > 0 for row in rows)
    assert {tuple(sorted(row)) for row in rows} == {tuple(sorted(row)) for row in plan}
    middles = [features.xy[row].mean(axis=0) @ rows_apart for row in rows]
    assert middles == sorted(middles, reverse=True)


@pytest.mark.parametrize("heading_deg", [45, 135, 225, 315])
def test_rows_that_head_exactly_diagonally_are_counted_from_the_north(heading_deg: float) -> None:
    features, plan = field(block(6, 9))
    features = turned(features, heading_deg)
    for east, north in ((0, 0), (300_000.3, 6_300_000.7), (-77.77, 33.3)):
        there = features.replace(xy=features.xy + np.array([east, north]))
        rows = counted(plan, there)
        assert rows == counted(plan, features)
        assert there.xy[rows[0][0]][1] == pytest.approx(there.xy[:, 1].max(), abs=45)
        assert there.xy[rows[0][0]][1] > there.xy[rows[0][-1]][1]


@pytest.mark.parametrize("name", [name for name in FAMILIES if name not in ("paths", "headlands")])
def test_the_order_is_the_planted_one(name: str) -> None:
    for seed in range(100, 102):
        simulation = simulate_family(name, seed)
        plan, both = planted(simulation)
        assert [sorted(row) for row in counted(plan, simulation.reference)] in both


@pytest.mark.parametrize(
    "scene",
    [
        Scene(trees=600, curve=20, gaps=0.3, holes=3),
        Scene(trees=2000, curve=20, outline="rectangle"),
        Scene(trees=1500, contour=4),
        Scene(trees=1500, contour=3, curve=15, overlap=0.5),
        Scene(trees=1500, hedgerow=2, row_spacing=7, spacing=2.2, curve=15),
        Scene(trees=60, curve=5, gaps=0.2),
    ],
    ids=["bow and holes", "bow", "contour", "contour and bow, cropped", "hedgerow", "small"],
)
def test_the_order_is_the_planted_one_however_rows_bend(scene: Scene) -> None:
    for seed in range(200, 203):
        simulation = simulate(scene, seed)
        plan, both = planted(simulation)
        assert [sorted(row) for row in counted(plan, simulation.reference)] in both


def test_a_short_row_at_the_edge_of_a_bowed_field_keeps_its_place() -> None:
    rows = block(8, 51)
    rows[3] = rows[3][40:]
    features, plan = field(bent(rows, 20.0, 150.0))
    middles = [features.xy[row, 1].mean() for row in plan]
    assert middles != sorted(middles, reverse=True), "the mean across would do"
    assert counted(plan, features) == plan


def test_rows_that_do_not_face_each_other_are_laid_along_the_common_bend() -> None:
    rows = block(6, 51)
    rows[0] = rows[0][:10]
    rows[1] = rows[1][20:30]
    features, plan = field(bent(rows, 20.0, 150.0))
    assert counted(plan, features) == plan


def test_rows_that_bend_one_way_and_the_other() -> None:
    rows = block(10, 51)
    for row, trees in enumerate(rows):
        trees[:, 1] += 4 * (row / 9 - 0.5) * np.sin(trees[:, 0] / 25)
    features, plan = field([row[::1] if k % 3 else row[30:] for k, row in enumerate(rows)])
    assert counted(plan, features) == plan


@pytest.mark.parametrize("bow_m", [0.0, 20.0])
def test_pieces_of_a_line_follow_each_other_along_it(bow_m: float) -> None:
    pieces = [part for row in block(7, 51) for part in (row[:16], row[18:35], row[38:])]
    features, plan = field(bent(pieces, bow_m, 150.0))
    assert counted(plan, features) == plan
    assert counted(plan, turned(features, -15)) == plan
    south = [plan[3 * line + piece][::-1] for line in range(6, -1, -1) for piece in (2, 1, 0)]
    assert counted(plan, turned(features, 180)) == south


@pytest.mark.parametrize("seed", range(300, 306))
def test_pieces_on_both_sides_of_a_path_in_a_simulated_orchard(seed: int) -> None:
    simulation = simulate_family("paths", seed)
    plan = [row.tolist() for row in true_rows(simulation).reference.trees]
    column = simulation.trees.column[simulation.reference_trees[:, 0]]
    lines: list[Plan] = []
    for row in plan:
        if lines and min(column[row]) > max(column[lines[-1][-1]]):
            lines[-1].append(row)
        else:
            lines.append([row])
    assert max(map(len, lines)) > 2
    expected = [
        [sorted(row) for line in lines[::across] for row in line[::along]] for across in (1, -1) for along in (1, -1)
    ]
    assert [sorted(row) for row in counted(plan, simulation.reference)] in expected


def test_blocks_far_apart_are_counted_line_by_line() -> None:
    pieces = [part for row in block(5, 60) for part in (row[:20], row[40:])]
    features, plan = field(pieces)
    assert counted(plan, features) == plan


def test_rows_across_the_others_come_last() -> None:
    main = [row + np.array([5.0, 0.0]) for row in block(9, 30)]
    windbreaks = [np.column_stack([np.full(15, x), 2.0 - 3.0 * np.arange(15)]) for x in (0.0, 97.0)]
    features, plan = field([*main, *windbreaks])
    assert counted(plan, features) == plan
    assert counted(plan, turned(features, 17)) == plan


def test_a_pair_of_trees_askew_is_no_row_across_the_others() -> None:
    rows = block(5, 12)
    rows[2] = rows[2][4:6] + np.array([[0.0, 0.0], [-2.9, 1.1]])
    features, plan = field(rows)
    assert [sorted(row) for row in counted(plan, features)] == plan


def spread(heading_deg: float) -> float:
    """How far a heading is from the nearest diagonal, degrees."""
    return abs((heading_deg % 90) - 45)


@given(
    seed=st.integers(0, 10_000),
    heading_deg=st.floats(0, 360),
    turn_deg=st.floats(-20, 20),
    shift=st.tuples(st.floats(-1e6, 1e6), st.floats(-1e7, 1e7)),
    bow_m=st.sampled_from([0.0, 6.0]),
)
def test_numbers_survive_shifts_and_turns(
    seed: int, heading_deg: float, turn_deg: float, shift: tuple[float, float], bow_m: float
) -> None:
    """Also with rows cut short anywhere, rows of two trees among them, and on a lattice without any error."""
    rng = np.random.default_rng(seed)
    whole = block(int(rng.integers(1, 9)), 20)
    cuts = [sorted(rng.choice(np.arange(21), 2, replace=False)) for _ in whole]
    rows = [row[a : max(b, a + 2)] for row, (a, b) in zip(whole, cuts, strict=True) if a < 19]
    assume(rows)
    assume(bow_m == 0 or min(map(len, rows)) > 5)
    features, plan = field(bent(rows, bow_m, 57.0))
    there = turned(features, heading_deg)
    moved = turned(there, turn_deg)
    moved = moved.replace(xy=moved.xy + np.array(shift))
    before = counted(plan, there, seed)
    assume(spread(common_heading(there, plan)) > abs(turn_deg) + 0.1)
    assert counted(plan, moved, seed + 1) == before


def common_heading(features: FeatureSet, plan: Plan) -> float:
    x, y = common_direction([np.array(row) for row in plan], features)
    return float(np.degrees(np.arctan2(y, x)))


@given(st.data())
def test_any_rows_at_all_are_counted_whatever_their_order_and_sense(data: st.DataObject) -> None:
    features = data.draw(feature_sets(most=40))
    rows = data.draw(rows_of(features))
    plan = [row.tolist() for row in rows.trees]
    found = counted(plan, features)
    assert sorted(map(sorted, found)) == sorted(map(sorted, plan))
    assert all(row in plan or row[::-1] in plan for row in found)
    other = features.take(np.array(data.draw(st.permutations(range(len(features)))), dtype=int))
    assert counted(plan, other, data.draw(st.integers(0, 100))) == found


def test_no_rows_one_row_and_empty_rows() -> None:
    features, plan = field(block(1, 5))
    assert numbered(Rows(()), features).trees == ()
    assert counted(plan, features) == plan
    assert [row.tolist() for row in numbered(Rows((np.array([], int), np.arange(5)[::-1])), features).trees] == [
        plan[0],
        [],
    ]
    assert [len(row) for row in numbered(Rows((np.arange(1), np.array([3]))), features).trees] == [1, 1]


def test_all_trees_at_one_spot_are_counted_somehow_and_always_alike() -> None:
    features = FeatureSet.of(np.full((40, 2), 7.0))
    plan = [[a, a + 1] for a in range(0, 40, 2)]
    assert counted(plan, features, 1) == counted(plan, features, 2) == plan


def test_rows_in_a_circle_are_counted_all_the_same() -> None:
    """A false row that stands before the second for a while, leaps over it and the third, and goes on behind them."""
    rows = block(5, 20)
    false = np.column_stack([3.0 * np.arange(20), np.where(np.arange(20) < 10, -2.5, -12.5)])
    features, plan = field([*rows, false])
    found = counted(plan, features)
    assert sorted(found) == plan
    assert [row for row in found if row != plan[5]] == plan[:5]
    assert counted(plan, features, 6) == found


def test_a_tree_that_is_not_there_is_refused() -> None:
    features, _ = field(block(2, 5))
    with pytest.raises(ValueError, match="not in its survey"):
        numbered(Rows((np.array([1, 99]),)), features)
