"""Small, quick scenes with their truth, for the laws and for tests of a method of one's own.

`ordinary(seed)`, `noisy(seed)` and `SCENES` are simulated surveys; `near` starts a pair close to the truth, `off` a few
trees or rows away from it; `copies` gives two surveys without any noise; `lattices` and `degenerate` hold what nobody
can register.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import MappingProxyType

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.transform import Affine, FloatArray, Rigid

_PLAIN = Scene(
    trees=600,
    planting_jitter=0.2,
    jitter=0.15,
    area_persistence=0.7,
    missed=0.03,
    false=0.03,
    rotation="any",
    shift_sd=15.0,
)
_NOISY = _PLAIN.model_copy(update={"missed": 0.25, "false": 0.25, "jitter": 0.35})

SCENES: Mapping[str, Scene] = MappingProxyType(
    {
        "ordinary": _PLAIN,
        "noisy": _NOISY,
        "half overlap": _PLAIN.model_copy(update={"overlap": 0.5}),
        "few trees": _PLAIN.model_copy(update={"trees": 60}),
        "different orchards": _PLAIN.model_copy(update={"same_orchard": False}),
    }
)
"""By name; the last has no truth."""


@cache
def scene(name: str, seed: int = 0) -> Simulation:
    """The simulation of one of `SCENES`; its surveys are shared, and cannot be changed by any trick of numpy's."""
    simulation = simulate(SCENES[name], seed)
    return replace(simulation, reference=_cast(simulation.reference), source=_cast(simulation.source))


def _cast(features: FeatureSet) -> FeatureSet:
    """The same trees in arrays over immutable memory: `setflags(write=True)` is refused."""
    names = ("ids", "xy", "confidence", "area", "weight")
    arrays = {name: getattr(features, name) for name in names}
    return features.replace(
        **{name: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape) for name, a in arrays.items()}
    )


def ordinary(seed: int = 0) -> Simulation:
    """An orchard of 600 trees with little noise, turned any way and shifted by about 15 m."""
    return scene("ordinary", seed)


def near(simulation: Simulation, seed: int = 0) -> Pair:
    """The surveys of a simulation, laid a quarter of the tree spacing off the truth, as a start for a local method.

    Raises `ValueError` where there is no truth.
    """
    if simulation.truth is None:
        raise ValueError("this simulation has no true transform to start near")
    nudge = small_motion(simulation.truth(simulation.source.xy), simulation.reference.spacing, seed)
    return Pair(simulation.reference, simulation.source, nudge @ simulation.truth)


def small_motion(xy: FloatArray, spacing: float, seed: int = 0) -> Rigid:
    """A motion in a random direction that shifts points by a fifth of the spacing and turns them by a seventh (RMS)."""
    rng = np.random.default_rng(seed)
    direction = rng.uniform(0, 2 * np.pi)
    centre = xy.mean(axis=0)
    radius = float(np.sqrt(((xy - centre) ** 2).sum(axis=1).mean()))
    turn_deg = np.degrees(rng.choice([-1, 1]) * spacing / 7 / radius)
    return Rigid.turn(turn_deg, about=centre, shift=spacing / 5 * np.array([np.cos(direction), np.sin(direction)]))


def copies(features: FeatureSet, reference_from_source: Affine, seed: int = 0) -> Pair:
    """A survey and its exact copy in another frame and another order; the pair begins at the identity.

    Ids tell which trees are the same.
    """
    order = np.random.default_rng(seed).permutation(len(features))
    return Pair(features, moved(features.take(order), reference_from_source.inverse()))


def moved(features: FeatureSet, by: Affine) -> FeatureSet:
    """The same trees elsewhere; crown areas follow the transform's scale."""
    return features.replace(xy=by(features.xy), area=features.area * by.scale**2)


def shuffled(pair: Pair, seed: int = 0) -> Pair:
    """The same pair with the trees of both surveys in another order, ids kept."""
    rng = np.random.default_rng(seed)
    reference = pair.reference.take(rng.permutation(len(pair.reference)))
    source = pair.source.take(rng.permutation(len(pair.source)))
    return Pair(reference, source, pair.reference_from_source, pair.rows)


def swapped(pair: Pair) -> Pair:
    """The same pair with reference and source in each other's place."""
    rows = pair.rows and MatchedRows(pair.rows.source, pair.rows.reference, pair.rows.matches[:, ::-1])
    return Pair(pair.source, pair.reference, pair.reference_from_source.inverse(), rows)


def true_rows(simulation: Simulation) -> MatchedRows:
    """The true rows of both surveys, less false detections and rows of fewer than two trees; no matches yet.

    Rows stand in the order of their true numbers, those of the source in reverse and running the other way.
    """
    reference = _rows(simulation, simulation.reference, simulation.reference_trees)
    source = _rows(simulation, simulation.source, simulation.source_trees)
    return MatchedRows(
        Rows(tuple(reference.values())),
        Rows(tuple(row[::-1] for row in reversed(source.values()))),
        np.empty((0, 2), dtype=np.int64),
    )


def off(simulation: Simulation, spacings: float, rows: float) -> Pair:
    """The surveys with their true rows, laid so many tree spacings along and so many rows across off the truth.

    It is where a row matcher starts when the files' own georeference is off by a few metres. Raises `ValueError` where
    there is no truth.
    """
    if simulation.truth is None:
        raise ValueError("this simulation has no true transform to start near")
    along, across = heading(simulation)
    shift = spacings * simulation.scene.spacing * along + rows * simulation.scene.row_spacing * across
    start = Rigid(np.eye(2), shift) @ simulation.truth
    return Pair(simulation.reference, simulation.source, start, true_rows(simulation))


def heading(simulation: Simulation) -> tuple[FloatArray, FloatArray]:
    """The unit vectors (2,) along the true rows and across them, in the reference's frame; of curved rows the mean."""
    trees = simulation.trees
    next_to = (np.diff(trees.row) == 0) & (np.diff(trees.column) == 1)
    x, y = np.diff(trees.xy, axis=0)[next_to].sum(axis=0)
    return np.array([x, y]) / np.hypot(x, y), np.array([-y, x]) / np.hypot(x, y)


def row_of_trees(simulation: Simulation, features: FeatureSet) -> dict[int, int]:
    """The true row of each detection of one of the two surveys, by id; false detections are left out."""
    trees = simulation.reference_trees if features is simulation.reference else simulation.source_trees
    real = trees[:, 0] >= 0
    rows = simulation.trees.row[trees[real, 0]]
    return dict(zip(features.ids[real].tolist(), rows.tolist(), strict=True))


def _rows(simulation: Simulation, features: FeatureSet, trees: IntArray) -> dict[int, IntArray]:
    real = np.flatnonzero(trees[:, 0] >= 0)
    row, column = simulation.trees.row[trees[real, 0]], simulation.trees.column[trees[real, 0]]
    order = np.lexsort((column, row))
    found = {int(k): features.ids[real[order[row[order] == k]]] for k in np.unique(row)}
    return {k: ids for k, ids in found.items() if len(ids) > 1}


def lattices() -> Mapping[str, Pair]:
    """Pairs that many placements explain equally well: what is periodic must be called ambiguous."""
    square = _lattice(24, 24, 4.0, 4.0)
    oblong = _lattice(20, 36, 5.5, 3.0)
    crop = Rigid.turn(33.0, shift=(3.0, -40.0))
    return {
        "a lattice and another crop of it": Pair(oblong, moved(_lattice(14, 26, 5.5, 3.0), crop)),
        "a lattice and itself": Pair(oblong, oblong),
        "a square lattice, turned": Pair(square, moved(square, Rigid.turn(20.0, shift=(7.0, 1.0)))),
    }


def _lattice(rows: int, trees: int, row_spacing: float, spacing: float) -> FeatureSet:
    x, y = np.meshgrid(np.arange(trees) * spacing, np.arange(rows) * row_spacing)
    return FeatureSet.of(np.column_stack([x.ravel(), y.ravel()]), area=np.full(x.size, 5.0))


def degenerate() -> Mapping[str, Pair]:
    """Pairs of surveys with too few trees, or none that stand apart, to say where one lies on the other."""
    many = ordinary().reference
    none, one, two = (many.take(np.arange(n)) for n in range(3))
    point = FeatureSet.of(np.full((20, 2), 7.0), area=np.full(20, 5.0))
    return {
        "no trees": Pair(none, none),
        "one tree": Pair(one, one),
        "two trees": Pair(two, two),
        "no trees in the source": Pair(many, none),
        "no trees in the reference": Pair(none, many),
        "one tree in the source": Pair(many, one),
        "two trees in the reference": Pair(two, many),
        "all trees at one point": Pair(point, point),
        "all source trees at one point": Pair(many, point),
    }


def line() -> Pair:
    """Thirty trees on one straight line, seen twice: enough for a turn and a shift, never for more."""
    row = FeatureSet.of(np.column_stack([np.arange(30) * 3.0, np.arange(30) * 1.0]), area=np.full(30, 5.0))
    return Pair(row, row)
