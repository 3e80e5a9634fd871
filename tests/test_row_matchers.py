"""What every row matcher refuses, in the same words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from treereg_bn_rows import BnRows

from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context, RowMatcher
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.rows import NearestRows
from treereg_core.testing.scenes import off, ordinary
from treereg_core.transform import Rigid

CONTEXT = Context()
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
BOTH = pytest.mark.parametrize("matcher", [NearestRows(), BnRows()], ids=lambda matcher: matcher.name)


@BOTH
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda pair: replace(pair, rows=None), "no rows were detected"),
        (lambda pair: replace(pair, rows=replace(pair.rows, source=Rows(()))), "the source has no row of two trees"),
        (
            lambda pair: replace(pair, rows=replace(pair.rows, reference=Rows((np.array([3]), np.array([], int))))),
            "the reference has no row of two trees",
        ),
        (
            lambda pair: pair.at(Rigid.turn(70.0, about=pair.reference.xy.mean(axis=0)) @ pair.reference_from_source),
            "cross each other",
        ),
        (lambda pair: pair.at(Rigid(np.eye(2), (900.0, 0.0)) @ pair.reference_from_source), "lies on the ground"),
    ],
    ids=["no rows", "none in the source", "single trees", "crossing", "elsewhere"],
)
def test_what_cannot_be_matched_is_refused(matcher: RowMatcher, change: object, sentence: str) -> None:
    assert callable(change)
    with pytest.raises(NoRegistration, match=sentence):
        matcher.match(change(off(ordinary(), 0.0, 0.0)), CONTEXT)


@BOTH
def test_two_trees_are_too_few(matcher: RowMatcher) -> None:
    trees = FeatureSet.of([[0.0, 0.0], [0.0, 3.0]])
    row = Rows((np.array([0, 1]),))
    with pytest.raises(NoRegistration, match="too few"):
        matcher.match(Pair(trees, trees, rows=MatchedRows(row, row, NO_MATCHES)), CONTEXT)


@BOTH
def test_trees_at_one_point_are_no_row(matcher: RowMatcher) -> None:
    trees = FeatureSet.of(np.full((6, 2), 7.0))
    row = Rows((np.arange(6),))
    with pytest.raises(NoRegistration, match="stand apart"):
        matcher.match(Pair(trees, trees, rows=MatchedRows(row, row, NO_MATCHES)), CONTEXT)
