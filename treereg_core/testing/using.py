"""Using a method of any role in one way, and comparing what came out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.evaluator import Evaluator, Problem
from treereg_core.judgement import ExpectedError, Judgement, Matches, Verdict
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
from treereg_core.pair import Pair, Rows
from treereg_core.simulate import Simulation
from treereg_core.testing.law import require
from treereg_core.testing.scenes import near, true_rows
from treereg_core.transform import Affine, FloatArray

CONTEXT = Context()
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
MILLIMETRE = 1e-3
"""Far below what any fit to detections is good for, far above rounding and the last step of an iteration."""


def suited(method: Method, simulation: Simulation) -> Pair:
    """A pair on which a method of this role can do its work: near the truth, and with true rows for a row matcher."""
    pair = near(simulation)
    return replace(pair, rows=true_rows(simulation)) if isinstance(method, RowMatcher) else pair


def use(method: Method, pair: Pair, context: Context = CONTEXT) -> Any:
    """What the method's verb gives for a pair, whatever its role; a `NoRegistration` is returned, not raised."""
    try:
        match method:
            case FeatureFilter():
                return method.select(pair, context)
            case CoarseAligner():
                return method.propose(pair, context)
            case RowDetector():
                return method.detect(pair.reference, context), method.detect(pair.source, context)
            case RowMatcher():
                return method.match(pair, context)
            case PointMatcher():
                return method.register(pair, context)
            case Evaluator():
                truth = pair.reference_from_source
                return method.score(judgement_of(truth), Problem(pair.reference, pair.source, truth))
    except NoRegistration as refusal:
        return refusal
    raise TypeError(f"{method.name} plays none of the known roles")


def judgement_of(transform: Affine | None) -> Judgement:
    """An accepted judgement with this transform, or a failed one without."""
    nothing = Matches(NO_MATCHES, np.empty(0))
    if transform is None:
        return Judgement(Verdict.FAILED, "nothing was found", None, nothing, nothing, None, 1.0, ())
    error = ExpectedError(0.01, (0.005, 0.02))
    return Judgement(Verdict.ACCEPTED, "it fits", transform, nothing, nothing, error, 1e-6, ())


def plain(value: Any) -> Any:
    """A value as nested tuples that are equal when, and only when, every bit is."""
    match value:
        case np.ndarray():
            return value.shape, value.dtype.str, np.ascontiguousarray(value).tobytes()
        case Affine():
            return type(value).__name__, value.matrix.tobytes()
        case NoRegistration():
            return "NoRegistration", str(value)
        case Mapping():
            return tuple(sorted((str(key), plain(item)) for key, item in value.items()))
        case tuple() | list():
            return tuple(plain(item) for item in value)
        case _ if is_dataclass(value):
            return tuple(plain(getattr(value, field.name)) for field in fields(value))
        case float():
            return value.hex()
    return value


@dataclass(frozen=True)
class Seen:
    """What matters in a result when the order of trees does not: the weights of trees by id (reference, source), the
    rows as sets of ids, the matched rows, and the first placement."""

    weights: tuple[Mapping[int, float], ...] = ()
    rows: tuple[frozenset[frozenset[int]], ...] = ()
    matches: frozenset[tuple[frozenset[int], frozenset[int]]] = frozenset()
    placement: Affine | None = None
    refused: bool = False


def seen(result: Any) -> Seen:
    """What matters in what `use` gave."""
    match result:
        case NoRegistration():
            return Seen(refused=True)
        case Registration():
            return Seen(placement=result.transform)
        case Pair():
            weights = tuple(
                dict(zip(f.ids.tolist(), f.weight.tolist(), strict=True)) for f in (result.reference, result.source)
            )
            if result.rows is None:
                return Seen(weights, placement=result.reference_from_source)
            ours, theirs = sets_of(result.rows.reference), sets_of(result.rows.source)
            matches = frozenset((ours[i], theirs[j]) for i, j in result.rows.matches)
            return Seen(weights, (frozenset(ours), frozenset(theirs)), matches, result.reference_from_source)
        case (Rows(), Rows()):
            return Seen(rows=tuple(frozenset(sets_of(rows)) for rows in result))
        case (Pair() as first, *_):
            return seen(first)
        case () | []:
            return Seen(refused=True)
    return Seen()


def sets_of(rows: Rows) -> Sequence[frozenset[int]]:
    """Each row as the set of its trees, in either sense."""
    return [frozenset(row.tolist()) for row in rows.trees]


def difference(a: Seen, b: Seen, xy: FloatArray, tolerance_m: float) -> str:
    """What differs between two results, in words; empty when nothing does.

    Placements may put the points `xy` (n, 2) of the source up to the tolerance, metres RMS, from each other.
    """
    if a.refused != b.refused:
        return "one is refused and the other is not"
    if [w.keys() for w in a.weights] != [w.keys() for w in b.weights]:
        count = sum(len(v.keys() ^ w.keys()) for v, w in zip(a.weights, b.weights, strict=True))
        return f"{count} trees are kept in one and not in the other"
    if any(abs(v[k] - w[k]) > 1e-6 for v, w in zip(a.weights, b.weights, strict=True) for k in v):
        return "trees have other weights"
    if a.rows != b.rows:
        return f"{sum(len(v ^ w) for v, w in zip(a.rows, b.rows, strict=True))} rows are not in both"
    if a.matches != b.matches:
        return f"{len(a.matches ^ b.matches)} matches of rows are not in both"
    if a.placement is not None and b.placement is not None:
        distance = apart(a.placement, b.placement, xy)
        return f"the trees lie {distance:.4g} m apart" if distance > tolerance_m else ""
    return ""


def apart(a: Affine, b: Affine, xy: FloatArray) -> float:
    """How far two placements put points (n, 2) from each other, metres, RMS."""
    return float(np.sqrt(np.mean(((a(xy) - b(xy)) ** 2).sum(axis=1))))


def placed(result: Any) -> Affine:
    """The first placement of a result; `AssertionError` for a refusal."""
    placement = seen(result).placement
    if placement is None:
        raise AssertionError(f"it refused ({result})" if isinstance(result, NoRegistration) else "it gave no placement")
    return placement


def require_near(a: Affine, b: Affine, xy: FloatArray, most_m: float, what: str) -> None:
    """Require two placements to put the points `xy` (n, 2) within so many metres, RMS, of each other."""
    distance = apart(a, b, xy)
    require(distance <= most_m, f"{what}: {distance:.4g} m off where {most_m:.4g} m are allowed")


def require_rows(rows: Rows, ids: list[int], name: str) -> None:
    """The least that holds for any rows: two trees or more each, no tree twice, none invented."""
    trees = [tree for row in rows.trees for tree in row.tolist()]
    require(all(len(row) >= 2 for row in rows.trees), f"{name}: a row has fewer than two trees")
    require(len(set(trees)) == len(trees), f"{name}: a tree stands twice")
    require(set(trees) <= set(ids), f"{name}: a row holds a tree that is not in the survey")
