"""Hypothesis strategies for the values of treereg: transforms, trees, pairs and scenes.

The only module of the core that needs hypothesis. Lengths are metres, within a kilometre of the origin.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from treereg_core.features import FeatureSet
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.transform import Affine, FloatArray, Model, Rigid, Similarity

KILOMETRE = 1000.0


def _numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def shifts() -> st.SearchStrategy[tuple[float, float]]:
    """Shifts of up to a kilometre per axis."""
    return st.tuples(_numbers(-KILOMETRE, KILOMETRE), _numbers(-KILOMETRE, KILOMETRE))


def rigids() -> st.SearchStrategy[Rigid]:
    """Any rotation, and a shift."""
    return st.builds(Rigid.turn, _numbers(-180, 180), shift=shifts())


def similarities() -> st.SearchStrategy[Similarity]:
    """Any rotation, a scale of a half to two, and a shift."""
    return st.builds(lambda rigid, scale: Similarity(scale * rigid.linear, rigid.shift), rigids(), _numbers(0.5, 2))


def affines() -> st.SearchStrategy[Affine]:
    """Scales of a half to two along any two right-angled directions, any rotation, perhaps a reflection; a shift."""

    def build(first: Rigid, second: Rigid, along: float, across: float) -> Affine:
        return Affine(first.linear @ np.diag([along, across]) @ second.linear, first.shift)

    across = st.one_of(_numbers(0.5, 2), _numbers(-2, -0.5))
    return st.builds(build, rigids(), rigids(), _numbers(0.5, 2), across)


def transforms(model: Model | None = None) -> st.SearchStrategy[Affine]:
    """Transforms of the kind that a model fits, or of any kind."""
    of_model: dict[Model, st.SearchStrategy[Affine]] = {
        Model.RIGID: rigids(),
        Model.SIMILARITY: similarities(),
        Model.AFFINE: affines(),
    }
    return of_model[model] if model else st.one_of(*of_model.values())


def points(least: int = 0, most: int = 30) -> st.SearchStrategy[FloatArray]:
    """Points (n, 2), on a grid of 1 mm; some may coincide or lie on a line."""
    millimetres = st.integers(-1_000_000, 1_000_000)
    shapes = st.integers(least, most).map(lambda n: (n, 2))
    return shapes.flatmap(lambda shape: arrays.arrays(np.int64, shape, elements=millimetres)).map(lambda a: a / 1000)


@st.composite
def spread_points(draw: st.DrawFn, least: int = 3, most: int = 30) -> FloatArray:
    """Points (n, 2) that fix a transform of any kind: the first three make a triangle 50 m wide at least."""
    given = draw(points(least, most))
    corner = draw(shifts())
    given[:3] = np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 50.0]]) + corner
    return given


@st.composite
def feature_sets(draw: st.DrawFn, least: int = 0, most: int = 30) -> FeatureSet:
    """Trees with any confidences, areas and weights; ids in any order, with gaps."""
    xy = draw(points(least, most))
    n = len(xy)

    def numbers(low: float, high: float) -> FloatArray:
        return draw(arrays.arrays(np.float64, n, elements=_numbers(low, high)))

    ids = draw(st.lists(st.integers(0, 10_000), min_size=n, max_size=n, unique=True))
    return FeatureSet(np.array(ids, dtype=np.int64), xy, numbers(0, 1), numbers(0.01, 100), numbers(0, 10))


@st.composite
def rows_of(draw: st.DrawFn, features: FeatureSet) -> Rows:
    """Rows of two trees or more of a survey, no tree twice, not every tree in one."""
    ids = draw(st.permutations(features.ids.tolist()))
    cuts = sorted(draw(st.sets(st.integers(0, len(ids)), max_size=6)))
    parts = (ids[a:b] for a, b in pairwise(cuts))
    return Rows(tuple(np.array(part, dtype=np.int64) for part in parts if len(part) > 1))


@st.composite
def pairs(draw: st.DrawFn, least: int = 0, most: int = 30) -> Pair:
    """Two surveys that have nothing to do with each other, under any transform; with or without matched rows."""
    reference, source = draw(feature_sets(least, most)), draw(feature_sets(least, most))
    rows = None
    if draw(st.booleans()):
        ours, theirs = draw(rows_of(reference)), draw(rows_of(source))
        count = draw(st.integers(0, min(len(ours), len(theirs))))
        matches = np.column_stack([np.arange(count), draw(st.permutations(range(len(theirs))))[:count]])
        rows = MatchedRows(ours, theirs, matches)
    return Pair(reference, source, draw(transforms()), rows)


def scenes() -> st.SearchStrategy[Scene]:
    """Small orchards of every layout, with moderate noise, misplaced in any way."""
    return st.builds(
        Scene,
        trees=st.integers(50, 400),
        row_spacing=_numbers(4, 8),
        spacing=_numbers(2.5, 7),
        curve=st.sampled_from([0.0, 5.0]),
        outline=st.sampled_from(["rectangle", "irregular"]),
        missed=_numbers(0, 0.2),
        false=_numbers(0, 0.2),
        jitter=_numbers(0.05, 0.3),
        overlap=_numbers(0.5, 1),
        rotation=st.one_of(st.just("any"), _numbers(-180, 180)),
        shift_sd=_numbers(0, 20),
    )


def simulations() -> st.SearchStrategy[Simulation]:
    """Simulated pairs of surveys with their truth."""
    return st.builds(simulate, scenes(), st.integers(0, 2**32 - 1))
