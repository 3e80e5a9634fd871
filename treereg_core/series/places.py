"""Places: the row that each tree of a series stands in, and which of its trees it is."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet, IntArray, frozen_array
from treereg_core.method import Context, RowDetector
from treereg_core.numbering import numbered
from treereg_core.options import defaults
from treereg_core.pair import Rows
from treereg_core.plan import Plan
from treereg_core.registry import installed
from treereg_core.series.history import History, gathered
from treereg_core.series.laid import Laid
from treereg_core.transform import FloatArray


@dataclass(frozen=True, eq=False)
class Places:
    """For each tree (t,) its row and its place in it, from 0 in the order in which people count; -1 for one in none."""

    row: IntArray
    tree: IntArray

    def __post_init__(self) -> None:
        for name in ("row", "tree"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.int64))

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return int(self.row.max(initial=-1)) + 1

    @classmethod
    def of(cls, history: History, plan: Plan, progress: Callable[[str], None]) -> Self:
        """The rows of the trees of all surveys together.

        They are detected by the plan's row detector; without one by the default one, where that is installed.
        """
        row, tree = np.full((2, len(history.probability)), -1, dtype=np.int64)
        detector = _detector(plan)
        if detector is None:
            progress("no row detector is installed, so trees have no row")
            return cls(row, tree)
        progress(f"rows: {detector.name}")
        options = plan.options
        context = Context(seed=options.seed, threads=min(options.threads, os.cpu_count() or 1), progress=progress)
        features = _together(history)
        try:
            found = detector.detect(features, context)
        except NoRegistration as reason:
            progress(f"the trees have no rows: {reason}")
            return cls(row, tree)
        rows = numbered(Rows(tuple(trees for trees in found.trees if len(trees) > 1)), features)
        for number, trees in enumerate(rows.trees):
            row[trees], tree[trees] = number, np.arange(len(trees))
        return cls(row, tree)


def _detector(plan: Plan) -> RowDetector | None:
    own = [stage for stage in plan.pipeline.stages if isinstance(stage, RowDetector)]
    if own:
        return own[0]
    registry, name = installed(), defaults()["rows"]
    if name not in registry.names(RowDetector):
        return None
    offer = registry.method(name)
    assert issubclass(offer, RowDetector)
    return offer()


def _together(history: History) -> FeatureSet:
    """One survey of all probable trees, each where and as it is on the average; its ids are the trees' numbers."""
    trees = np.flatnonzero(history.probable)

    def mean(values: Callable[[Laid], FloatArray]) -> FloatArray:
        return np.asarray(np.nanmean(gathered([values(laid) for laid in history.surveys], history.detection), axis=1))

    return FeatureSet(
        ids=trees,
        xy=mean(lambda laid: laid.xy)[trees],
        confidence=mean(lambda laid: laid.confidence)[trees],
        area=np.exp(mean(lambda laid: laid.log_area)[trees]),
        weight=np.ones(len(trees)),
    )
