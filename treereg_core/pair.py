"""Pair: two surveys, how they lie to each other at present, and what is known of their rows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from treereg_core.features import FeatureSet, IntArray, frozen_array
from treereg_core.transform import Affine, FloatArray, Rigid


@dataclass(frozen=True, eq=False)
class Rows:
    """The planting rows of one survey: for each row the ids of its trees, in order along the row."""

    trees: tuple[IntArray, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "trees", tuple(frozen_array(row, np.int64) for row in self.trees))

    def __len__(self) -> int:
        return len(self.trees)

    def keep(self, ids: IntArray) -> Rows:
        """The same rows, in the same order, less the trees that are not among `ids`."""
        if not self.trees:
            return self
        kept = np.isin(np.concatenate(self.trees), ids)  # of all rows at once: of each by itself it takes their square
        ends = np.cumsum([len(row) for row in self.trees])[:-1]
        return Rows(tuple(row[here] for row, here in zip(self.trees, np.split(kept, ends), strict=True)))


@dataclass(frozen=True, eq=False)
class MatchedRows:
    """Rows of both surveys and which of them are the same.

    `matches` (k, 2) holds positions in `reference.trees` and `source.trees`; each row stands in it at most once. It is
    empty, shape (0, 2), until a row matcher has spoken.
    """

    reference: Rows
    source: Rows
    matches: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "matches", frozen_array(self.matches, np.int64).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class Pair:
    """What flows through the stages: the trees of both surveys as narrowed so far, and the current transform.

    `reference_from_source` takes the source's working coordinates to the reference's; it starts as the identity,
    which is the files' own georeference. `rows` is None until rows were detected.
    """

    reference: FeatureSet
    source: FeatureSet
    reference_from_source: Affine = field(default_factory=Rigid.identity)
    rows: MatchedRows | None = None

    @cached_property
    def source_in_reference(self) -> FloatArray:
        """The source's trees under the current transform, (n, 2) metres: the one place where it is applied."""
        return frozen_array(self.reference_from_source(self.source.xy))

    def at(self, reference_from_source: Affine) -> Pair:
        """The same trees under another transform."""
        return replace(self, reference_from_source=reference_from_source)

    def narrow(self, reference: FeatureSet, source: FeatureSet) -> Pair:
        """The same placement with fewer trees or other weights; rows keep their order and lose what was left out."""
        rows = self.rows and MatchedRows(
            self.rows.reference.keep(reference.ids), self.rows.source.keep(source.ids), self.rows.matches
        )
        return replace(self, reference=reference, source=source, rows=rows)
