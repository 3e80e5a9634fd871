"""The ant colony, in compiled code: ants make rows, pheromones remember the good ones, the best rows are taken out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from treereg_aco.compiled import compiled
from treereg_aco.corridor import best_chain
from treereg_aco.ground import SHORTEST, STEPS, Graph, Ground, step
from treereg_aco.habits import Habits
from treereg_aco.model import RowModel
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

# Pheromone that every step keeps, so that none is lost for ever.
LEAST_PHEROMONE = 1e-3
# By how much trees must be likelier to be a row than to be strangers, natural logarithm.
LEAST_QUALITY = 4.5
# Ants that set out from a tree in vain before it is left alone.
TRIES = 3
# Times that a row is sought anew in its own corridor, at most.
ROUNDS = 4


class Colony(NamedTuple):
    """Where the ants are, how they behave and what they have left.

    - `free` (n,): the trees that no row has taken yet.
    - `met` (n,): the number of the last ant that came by.
    - `pheromone` (n, 2, STEPS): of the graph's steps; `iteration` (n,): when those of a tree last evaporated. Only
      the ratio of pheromones of one tree ever counts, so that they need to evaporate only when some are added.
    """

    ground: Ground
    graph: Graph
    model: RowModel
    habits: Habits
    free: BoolArray
    met: IntArray
    pheromone: FloatArray
    iteration: IntArray


@compiled
def search(
    ground: Ground, graph: Graph, model: RowModel, habits: Habits, rng: np.random.Generator
) -> tuple[list[IntArray], BoolArray]:
    """Rows, each as positions of its trees in order, and which trees are left over (n,).

    In every round ants start from trees that are left and no ant has started from in vain; the best rows of
    the round are bettered in their corridors and taken out.
    """
    n = len(ground.xy)
    free, met, iteration = np.ones(n, np.bool_), np.zeros(n, np.int64), np.zeros(n, np.int64)
    colony = Colony(ground, graph, model, habits, free, met, np.ones((n, 2, STEPS)), iteration)
    rows = [np.empty(0, np.int64)]
    untried = np.arange(n)
    in_vain = np.zeros(n, np.int64)
    number = 0
    while len(untried) > 0:
        best = [np.empty(0, np.int64) for _ in range(habits.elites)]
        quality = np.full(habits.elites, -np.inf)
        for ant in range(habits.iterations * habits.ants):
            start = untried[rng.integers(0, len(untried))]
            whole, heuristic = construct(start, colony, ant + number, rng)
            first, after, worth = likeliest_part(whole, ground, model)
            row = whole[first:after]
            if worth < LEAST_QUALITY or not (row == start).any():
                in_vain[start] += 1
                continue
            deposit(row, heuristic[first : after - 1], colony, (ant + number) // habits.ants)
            keep_if_better(row, worth, best, quality)
        number += habits.iterations * habits.ants
        for k in np.argsort(-quality):
            if not free[best[k]].all():
                continue
            row = bettered(best[k], ground, model, free)
            if len(row) > 0:
                free[row] = False
                rows.append(row)
                put_aside_twins(row, colony)
            else:
                in_vain[best[k]] = TRIES
        untried = untried[free[untried] & (in_vain[untried] < TRIES)]
    left = np.ones(n, np.bool_)
    for row in rows:
        left[row] = False
    return rows[1:], left


@compiled
def put_aside_twins(row: IntArray, colony: Colony) -> None:
    """Keep from being a row what stands at the planting positions of a row that was taken out: second detections."""
    ground = colony.ground
    for tree in row:
        for other in ground.near[tree]:
            ahead, aside, _ = step(ground, tree, other)
            if abs(ahead) < SHORTEST * ground.spacing[tree] and abs(aside) < colony.model.half_width:
                colony.free[other] = False


@compiled
def construct(start: int, colony: Colony, ant: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """The row (k,) of an ant, which goes one way from its start, turns and goes the other; heuristics (k - 1,)."""
    colony.met[start] = ant + 1
    ahead, ahead_heuristic = extend(start, 1.0, colony, ant, rng)
    behind, behind_heuristic = extend(start, -1.0, colony, ant, rng)
    row = np.concatenate((behind[:0:-1], ahead))
    return row, np.concatenate((behind_heuristic[:0:-1], ahead_heuristic[1:]))


@compiled
def extend(start: int, sense: float, colony: Colony, ant: int, rng: np.random.Generator) -> tuple[IntArray, FloatArray]:
    """The trees on an ant's way from its start until there is no further step, and the heuristic of reaching each."""
    ground, graph, habits = colony.ground, colony.graph, colony.habits
    trees, heuristics = [start], [0.0]
    here = start
    turn = np.cos(np.radians(180 - habits.angle_limit))
    x, y = sense * ground.along[start, 0], sense * ground.along[start, 1]
    place = np.empty(habits.neighbours, np.int64)
    straight, heuristic = np.empty((2, habits.neighbours))
    while True:
        side = 0 if x * ground.along[here, 0] + y * ground.along[here, 1] > 0 else 1
        count = 0
        total = whole = 0.0
        for k in range(STEPS):
            other = graph.to[here, side, k]
            if other < 0 or count == habits.neighbours:
                break
            if not colony.free[other] or colony.met[other] == ant + 1:
                continue
            dx, dy = ground.xy[other, 0] - ground.xy[here, 0], ground.xy[other, 1] - ground.xy[here, 1]
            cosine = (dx * x + dy * y) / max(np.sqrt(dx * dx + dy * dy), 1e-12)
            if cosine >= turn:
                place[count], straight[count] = k, cosine
                total += graph.distance[here, side, k]
                count += 1
        if count == 0:
            return np.array(trees), np.array(heuristics)
        chosen = 0
        best = -1.0
        for k in range(count):
            near = 1 - graph.distance[here, side, place[k]] / total if count > 1 else 1.0
            heuristic[k] = habits.distance_weight * near
            if habits.angle_weight > 0:
                angle = 1 - np.arccos(min(max(straight[k], -1.0), 1.0)) / np.pi
                heuristic[k] += habits.angle_weight * angle
            # outside the Pareto set: a step as straight is nearer, and the nearest come first
            if straight[k] <= best:
                continue
            best = straight[k]
            scent = power(colony.pheromone[here, side, place[k]], habits.pheromone_power)
            chance = scent * power(max(heuristic[k], 1e-9), habits.heuristic_power)
            whole += chance
            # each takes the place of those before it with its share of the chances so far
            if rng.random() * whole < chance:
                chosen = k
        other = graph.to[here, side, place[chosen]]
        dx, dy = ground.xy[other, 0] - ground.xy[here, 0], ground.xy[other, 1] - ground.xy[here, 1]
        length = max(np.hypot(dx, dy), 1e-12)
        x, y = dx / length, dy / length
        colony.met[other] = ant + 1
        trees.append(other)
        heuristics.append(heuristic[chosen])
        here = other


@compiled
def power(base: float, exponent: float) -> float:
    """A positive number to a power; square roots, the usual case, take a fraction of the time of others."""
    return float(np.sqrt(base)) if exponent == 0.5 else base**exponent


@compiled
def likeliest_part(row: IntArray, ground: Ground, model: RowModel) -> tuple[int, int, float]:
    """The part of an ant's way that is likeliest to be a row: where it begins, where it has ended, and its quality.

    Quality is the natural logarithm of how much likelier its trees are to be a row than to be strangers. The paper's
    quality, the sum of the heuristics, grows with every tree that is dragged in; this one does not.
    """
    constant = np.log(model.taken) - np.log(4 * np.pi * model.along * model.across) - np.log(model.strangers)
    first = best_first = best_after = 0
    quality = best = 0.0
    for k in range(1, len(row)):
        ahead, aside, _ = step(ground, row[k - 1], row[k])
        spacing = 0.5 * (ground.spacing[row[k - 1]] + ground.spacing[row[k]])
        positions = max(1.0, np.round(abs(ahead) / spacing))
        off = (abs(ahead) - positions * spacing) / model.along
        quality += constant - 0.25 * (off**2 + (aside / model.across) ** 2)
        quality += (positions - 1) * np.log(1 - model.taken) + ground.evidence[row[k]]
        if quality <= 0:
            quality, first = 0.0, k
        elif quality > best:
            best, best_first, best_after = quality, first, k + 1
    return best_first, best_after, best


@compiled
def deposit(row: IntArray, heuristic: FloatArray, colony: Colony, iteration: int) -> None:
    """Leave pheromone on both sides of each step of a row: the triangle-weighted mean of the heuristics about it."""
    graph, half = colony.graph, (colony.habits.deposit_window + 1) // 2
    for k in range(len(heuristic)):
        total = weights = 0.0
        for m in range(max(0, k - half + 1), min(len(heuristic), k + half)):
            total += (half - abs(m - k)) * heuristic[m]
            weights += half - abs(m - k)
        for here, other in ((row[k], row[k + 1]), (row[k + 1], row[k])):
            left = (1 - colony.habits.evaporation) ** (iteration - colony.iteration[here])
            colony.iteration[here] = iteration
            for side in range(2):
                for place in range(STEPS):
                    pheromone = max(colony.pheromone[here, side, place] * left, LEAST_PHEROMONE)
                    added = total / weights if graph.to[here, side, place] == other else 0.0
                    colony.pheromone[here, side, place] = pheromone + added


@compiled
def keep_if_better(row: IntArray, worth: float, best: list[IntArray], quality: FloatArray) -> None:
    """Put a row into the elite set, in which no two share a tree, if it is better than each that it displaces."""
    if worth <= quality.min():
        return
    trees = set(row)
    displaced = np.zeros(len(best), np.bool_)
    for k in range(len(best)):
        for tree in best[k]:
            if tree in trees:
                if quality[k] >= worth:
                    return
                displaced[k] = True
                break
    for k in range(len(best)):
        if displaced[k]:
            best[k], quality[k] = row[:0], -np.inf
    worst = int(np.argmin(quality))
    best[worst], quality[worst] = row, worth


@compiled
def bettered(row: IntArray, ground: Ground, model: RowModel, free: BoolArray) -> IntArray:
    """The best row in the corridor of an elite one, sought until it stays the same; empty when none is good enough."""
    nothing = row[:0]
    worth = -np.inf
    for _ in range(ROUNDS):
        if len(row) < 2:
            return nothing
        better, worth = best_chain(row, ground, model, free)
        if len(better) == len(row) and (better == row).all():
            break
        row = better
    return row if len(row) >= 2 and worth >= LEAST_QUALITY else nothing
