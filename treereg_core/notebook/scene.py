"""Scene: where the trees of a result stand, and which of them have a partner, for plots and cards."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.judgement import Matches
from treereg_core.survey import Survey
from treereg_core.transform import Affine, FloatArray, Rigid

if TYPE_CHECKING:
    from treereg_core.result import Result

CORNERS = 24
"""A crown of which only the area is known is drawn as a circle of so many corners."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Both surveys under one placement; coordinates are full ones of the working CRS, or those of the arrays, metres.

    `surveys` and `trees` are the reference's and the source's, `placement` is `reference_from_source` in the working
    frame, `matches` are its pairs.
    """

    surveys: tuple[Survey | FeatureSet, Survey | FeatureSet]
    placement: Affine
    matches: Matches
    origin: FloatArray

    @classmethod
    def of(cls, result: Result, before: bool = False) -> Scene:
        """At the judged placement; at the files' own georeference with `before`, or where there is none."""
        said = result.judgement
        origin = np.asarray(result.frame.origin if result.frame else (0.0, 0.0))
        surveys = result.reference, result.source
        if before:
            return cls(surveys, Rigid.identity(), said.before, origin)
        return cls(surveys, said.transform or Rigid.identity(), said.matches, origin)

    @cached_property
    def trees(self) -> tuple[FeatureSet, FeatureSet]:
        """The usable trees of both."""
        reference, source = (s.features if isinstance(s, Survey) else s for s in self.surveys)
        return reference, source

    @cached_property
    def xy(self) -> tuple[FloatArray, FloatArray]:
        """Where the trees stand, (n, 2) and (m, 2)."""
        reference, source = self.trees
        return reference.xy + self.origin, self.placement(source.xy) + self.origin

    @cached_property
    def positions(self) -> IntArray:
        """The matched pairs (k, 2) as positions in the arrays."""
        pairs = self.matches.pairs
        return np.column_stack([trees.positions(pairs[:, k]) for k, trees in enumerate(self.trees)])

    @cached_property
    def alone(self) -> tuple[BoolArray, BoolArray]:
        """Which trees have no partner, (n,) and (m,)."""
        masks = []
        for k, trees in enumerate(self.trees):
            mask = np.ones(len(trees), dtype=bool)
            mask[self.positions[:, k]] = False
            masks.append(mask)
        return masks[0], masks[1]

    @property
    def lines(self) -> FloatArray:
        """From every matched source tree to its partner, (k, 2, 2)."""
        (reference, source), at = self.xy, self.positions
        return np.stack([source[at[:, 1]], reference[at[:, 0]]], axis=1)

    def crowns(self, side: int) -> Iterator[tuple[int, FloatArray]]:
        """The rings of the crowns of the reference (0) or the source (1), each with the position of its tree."""
        survey, trees = self.surveys[side], self.trees[side]
        place = self.placement if side else Rigid.identity()
        outlines = survey.outlines if isinstance(survey, Survey) else None
        if outlines is not None:
            xy = place(outlines.xy) + self.origin
            yield from zip(
                outlines.tree.tolist(), np.split(xy, np.flatnonzero(np.diff(outlines.ring)) + 1), strict=True
            )
            return
        angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        radius = np.sqrt(trees.area / np.pi)
        yield from enumerate(self.xy[side][:, None] + radius[:, None, None] * circle)
