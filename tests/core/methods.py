"""Small methods of every role, and a registry of them, for the tests of the core."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import (
    CoarseAligner,
    Context,
    FeatureFilter,
    Method,
    PointMatcher,
    Registration,
    RowDetector,
    RowMatcher,
)
from treereg_core.network import Network, Node
from treereg_core.pair import Pair, Rows
from treereg_core.recipe import Recipe
from treereg_core.registry import Entry, Registry
from treereg_core.transform import Model


class Sure(FeatureFilter):
    """Keeps confident trees."""

    name = "sure"
    least: float = Field(0.5, ge=0, le=1, description="least confidence")

    def select(self, pair: Pair, context: Context) -> Pair:
        reference, source = (f.take(f.confidence >= self.least) for f in (pair.reference, pair.source))
        return pair.narrow(reference, source)


class Big(Sure):
    """Keeps big trees."""

    name = "big"

    def select(self, pair: Pair, context: Context) -> Pair:
        return pair


class Columns(RowDetector):
    """Rows are the trees whose x, rounded to `width`, is the same."""

    name = "columns"
    width: float = Field(5.0, gt=0, description="row spacing", json_schema_extra={"unit": "m"})

    def detect(self, features: FeatureSet, context: Context) -> Rows:
        context.progress("detect")
        column = np.round(features.xy[:, 0] / self.width)
        order = np.argsort(features.xy[:, 1], kind="stable")
        rows = (order[column[order] == value] for value in np.unique(column))
        return Rows(tuple(features.ids[row] for row in rows if len(row) > 1))


class Lines(Columns):
    """Another row detector."""

    name = "lines"


class SameRows(RowMatcher):
    """Matches rows by their number."""

    name = "same_rows"
    models = frozenset({Model.RIGID})

    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        raise NoRegistration("no rows are the same")


class Nearest(PointMatcher):
    """Pairs each source tree with the nearest reference tree and fits once."""

    name = "nearest"
    reach: float = Field(3.0, gt=0, le=50, description="farthest pair", json_schema_extra={"unit": "m"})

    def register(self, pair: Pair, context: Context) -> Registration:
        if len(pair.reference) < 3 or len(pair.source) < 3:
            raise NoRegistration("fewer than three trees")
        distance, partner = pair.reference.tree.query(pair.source_in_reference)
        near = np.flatnonzero(distance <= self.reach)
        try:
            transform = context.model.fit(pair.source.xy[near], pair.reference.xy[partner[near]])
        except ValueError as error:
            raise NoRegistration(str(error)) from None
        pairs = np.column_stack([pair.reference.ids[partner[near]], pair.source.ids[near]])
        return Registration(transform, pairs, np.ones(len(near)))


class Middle(CoarseAligner):
    """Lays centroid on centroid."""

    name = "middle"
    network = Network(
        (
            Node("near", "whether the surveys lie near each other", ("no", "yes"), hidden=True),
            Node("meet", "how many trees meet " * 10 + "in all", ("few", "many"), ("near",)),
        )
    )
    turns: int = Field(1, ge=1, le=4, description="how many quarter turns to propose")

    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        shift = pair.reference.xy.mean(axis=0) - pair.source.xy.mean(axis=0)
        return (pair.at(Model.RIGID.kind(np.eye(2), shift)),)


METHODS: tuple[type[Method], ...] = (Sure, Big, Columns, Lines, SameRows, Nearest, Middle)
BOTH = Recipe("both", "sure+columns+nearest", "all of it", {"sure": {"least": 0.2}})
REGISTRY = Registry(
    (
        *(Entry(method.name, method.role, "test", "1", method) for method in METHODS),
        Entry("both", "recipe", "test", "1", BOTH),
        Entry("lost", "plugin", "other", "2", None, "other 2 cannot be loaded: ImportError: gone"),
    )
)


def orchard(rows: int = 6, trees: int = 20, seed: int = 0) -> FeatureSet:
    """Rows along y, 5 m apart, trees every 3 m, planted 0.2 m off."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(5.0 * np.arange(rows), 3.0 * np.arange(trees), indexing="ij")
    xy = np.column_stack([x.ravel(), y.ravel()]) + rng.normal(0, 0.2, (rows * trees, 2))
    return FeatureSet.of(xy, rng.uniform(0.1, 1, len(xy)), rng.uniform(2, 6, len(xy)))
