"""Starts near the truth: how far one may lie from it for its rows to be matched by where they are, and such starts."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchmarks.edges import truths
from treereg_core.evaluation.case import Case, of_simulation
from treereg_core.features import IntArray
from treereg_core.simulate import FAMILIES, Scene, Simulation, simulate_family
from treereg_core.transform import FloatArray, Rigid, Transform

ACROSS = 0.4
"""How far across the rows, in distances between rows, a row's end may lie from its true place."""
ALONG = 2.0
"""How far along them, in distances between trees of a row."""
INWARD = 4
"""The direction of a row at its end is that from the last tree to the one so many trees further in."""
TRIES = 100_000

NEAR = "near"
PREFIX = f"{NEAR} "
"""Names of cases whose source was laid anew begin with it."""
GROUPS = {prefix + name: prefix + family.group for prefix in ("", PREFIX) for name, family in FAMILIES.items()}
"""The group of each name of a case."""


@dataclass(frozen=True, eq=False)
class RowEnds:
    """Both ends of each row that the source shows two trees of.

    `source` (k, 2) where it shows them; `truth` (k, 2) where that is in the reference's frame; `along` (k, 2) the unit
    vectors of the rows there. Metres.
    """

    source: FloatArray
    truth: FloatArray
    along: FloatArray


def row_ends(simulation: Simulation) -> RowEnds:
    """The row ends of the source's detections of true trees; in a square lattice those of columns too.

    `ValueError` where there is no truth.
    """
    if simulation.truth is None:
        raise ValueError("this simulation has no true transform")
    feature, tree, inward = np.concatenate([ends(truth) for truth in truths(simulation)]).T
    xy = simulation.source.xy[feature]
    along = simulation.trees.xy[inward] - simulation.trees.xy[tree]
    return RowEnds(xy, simulation.truth(xy), along / np.hypot(*along.T)[:, None])


def ends(simulation: Simulation) -> IntArray:
    """For both ends of each row the feature, its tree, and a tree further in, (k, 3)."""
    trees, shown = simulation.trees, simulation.source_trees[:, 0]
    feature = np.flatnonzero(shown >= 0)
    feature = feature[np.lexsort((trees.column[shown[feature]], trees.row[shown[feature]]))]
    tree = shown[feature]
    bounds = [0, *(np.flatnonzero(np.diff(trees.row[tree])) + 1).tolist(), len(tree)]
    found = []
    for first, after in pairwise(bounds):
        if trees.column[tree[first]] < trees.column[tree[after - 1]]:
            found.append((feature[first], tree[first], tree[min(first + INWARD, after - 1)]))
            found.append((feature[after - 1], tree[after - 1], tree[max(after - 1 - INWARD, first)]))
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def is_near(at: RowEnds, scene: Scene, reference_from_source: Transform) -> bool:
    """Whether a start puts every row end within 0.4 of a row spacing across and two in-row spacings along the row."""
    off = reference_from_source(at.source) - at.truth
    along = np.abs((off * at.along).sum(axis=1))
    across = np.abs(off[:, 0] * at.along[:, 1] - off[:, 1] * at.along[:, 0])
    return bool((across <= ACROSS * next_row(scene)).all() and (along <= ALONG * scene.spacing).all())


def next_row(scene: Scene) -> float:
    """The distance from a row to the next, metres; in double rows the lesser of the two."""
    return min(scene.hedgerow, scene.row_spacing - scene.hedgerow) if scene.hedgerow else scene.row_spacing


def brought_near(simulation: Simulation, rng: np.random.Generator) -> Simulation:
    """The same surveys, the source laid anew so that the identity is a near start, drawn evenly from all such.

    `ValueError` where there is no truth.
    """
    at, scene = row_ends(simulation), simulation.scene
    assert simulation.truth is not None
    centre = at.truth.mean(axis=0)
    farthest = float(np.hypot(ACROSS * next_row(scene), ALONG * scene.spacing))
    largest_deg = np.degrees(farthest / np.hypot(*(at.truth - centre).T).max())
    for _ in range(TRIES):
        turn_deg, shift = rng.uniform(-largest_deg, largest_deg), rng.uniform(-farthest, farthest, 2)
        disturbed = Rigid.turn(turn_deg, about=centre, shift=shift)
        if is_near(at, scene, disturbed @ simulation.truth):
            laid = disturbed @ simulation.truth
            source = simulation.source.replace(xy=laid(simulation.source.xy))
            reference, flight = simulation.flights
            flights = (reference, replace(flight, displacement=flight.displacement.then(laid)))
            return replace(simulation, source=source, truth=disturbed.inverse(), flights=flights)
    raise ValueError(f"no near start in {TRIES} tries")


@dataclass(frozen=True)
class Near:
    """Cases of families with a truth, the source laid anew so that the files' own georeference is a near start."""

    families: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The families' names behind the prefix."""
        return tuple(PREFIX + name for name in self.families if FAMILIES[name].group != "absent")

    def case(self, name: str, seed: int) -> Case:
        """A simulated pair of surveys with its truth."""
        family = name.removeprefix(PREFIX)
        rng = np.random.default_rng([zlib.crc32(family.encode()), seed, 1])
        return of_simulation(brought_near(simulate_family(family, seed), rng), name)
