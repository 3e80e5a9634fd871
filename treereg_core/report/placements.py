"""The placements that the page can lay: the files' own georeference, the one found, and its rivals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from treereg_core.evidence import Evidence
from treereg_core.features import FeatureSet, IntArray
from treereg_core.judgement import Matches
from treereg_core.result import Result, matches_json, trees
from treereg_core.transform import Affine, Rigid

ALONE, UNSEEN = -1, -2
"""In place of a partner: the other survey would have shown one, or does not cover the place."""


def placements(result: Result) -> list[dict[str, Any]]:
    """What each placement does to the trees; `before` first, then `after` where one was found, then the rivals.

    `matrix` (2 rows of 3) takes the source's working coordinates to the reference's, metres. `reference` and `source`
    hold for each tree the position of its partner in the other survey, -1 where it has none, -2 where the other survey
    does not cover it. `matched` and `residual_rms_m` count the pairs, `moved_m` is how far the source's trees move
    (RMS), `apart_m` how far they end from where the placement that was found puts them.
    """
    reference, source = trees(result.reference), trees(result.source)
    stand_apart = min(len(reference), len(source)) >= 3 and min(reference.spacing, source.spacing) > 0
    evidence = Evidence(reference, source) if stand_apart else None
    return [
        {
            "name": name,
            "matrix": np.column_stack([transform.linear, transform.shift]).tolist(),
            "turned_deg": round(transform.rotation_deg, 4),
            "moved_m": round(_apart(source, transform, Rigid.identity()), 3),
            "apart_m": round(_apart(source, transform, result.transform or Rigid.identity()), 3),
            **_partners(evidence, transform, (reference, source)),
        }
        for name, transform in _named(result)
    ]


def _named(result: Result) -> Iterator[tuple[str, Affine]]:
    yield "before", Rigid.identity()
    if result.transform is not None:
        yield "after", result.transform
    for number, rival in enumerate(result.judgement.rivals, start=1):
        yield f"rival {number}", rival.transform


def _apart(source: FeatureSet, a: Affine, b: Affine) -> float:
    difference = a(source.xy) - b(source.xy)
    return float(np.sqrt((difference**2).sum(axis=1).mean()))


def _partners(evidence: Evidence | None, transform: Affine, surveys: tuple[FeatureSet, FeatureSet]) -> dict[str, Any]:
    sides = [np.full(len(survey), UNSEEN, dtype=np.int64) for survey in surveys]
    pairs: IntArray = np.empty((0, 2), dtype=np.int64)
    distance = np.empty(0)
    if evidence:
        match = evidence.match(transform)
        sides[0][match.covered_reference] = ALONE
        sides[1][match.covered_source] = ALONE
        sides[0][match.reference] = match.source
        sides[1][match.source] = match.reference
        pairs, distance = np.column_stack([match.reference, match.source]), match.distance
    return {"reference": sides[0].tolist(), "source": sides[1].tolist(), **matches_json(Matches(pairs, distance))}
