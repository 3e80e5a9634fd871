"""Laws on how every method behaves, whatever its role."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np

from treereg_core.method import CoarseAligner, Context, Method, PointMatcher, Registration, RowMatcher
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import degenerate, line, moved, ordinary, shuffled
from treereg_core.testing.using import MILLIMETRE, NO_MATCHES, difference, plain, require_rows, seen, suited, use
from treereg_core.transform import Model, Rigid

FAR_ORIGIN = Rigid(np.eye(2), (5e5, 6e6))


@law
def repeatable_under_one_seed(method: Method) -> None:
    """The same input and seed give the same bits, whatever was done in between."""
    pair = suited(method, ordinary())
    first = plain(use(method, pair, Context(seed=3)))
    use(method, suited(method, ordinary(1)), Context(seed=4))
    again = plain(use(type(method)(**dict(method)), pair, Context(seed=3)))
    require(first == again, "two runs with seed 3 differ")


@law
def threads_change_nothing(method: Method) -> None:
    """One thread and two give the same bits."""
    pair = suited(method, ordinary())
    one, two = (plain(use(method, pair, Context(threads=threads))) for threads in (1, 2))
    require(one == two, "results with 1 and 2 threads differ")


@law
def another_process_changes_nothing(method: Method) -> None:
    """What was pickled, method and pair, does the same as before."""
    pair = suited(method, ordinary())
    before = plain(use(method, pair))
    other_method, other_pair = pickle.loads(pickle.dumps((method, pair)))
    require(plain(use(other_method, other_pair)) == before, "the pickled method gives another result")


@law
def inputs_are_untouched(method: Method) -> None:
    """Neither the pair nor the method's own settings are changed."""
    pair = pickle.loads(pickle.dumps(suited(method, ordinary())))
    surveys, settings = plain(pair), method.model_dump_json()
    use(method, pair)
    require(plain(pair) == surveys, "the pair was changed")
    require(method.model_dump_json() == settings, "the settings were changed")


@law
def order_of_trees_is_irrelevant(method: Method) -> None:
    """Trees in another order, with their ids, give the same result."""
    pair = suited(method, ordinary())
    before, after = (seen(use(method, p)) for p in (pair, shuffled(pair)))
    unlike = difference(before, after, pair.source.xy, tolerance(method, pair))
    require(not unlike, f"with the trees in another order {unlike}")


@law
def a_far_origin_changes_nothing(method: Method) -> None:
    """Coordinates about an origin 6,000 km away, as in UTM, give the same result."""
    pair = suited(method, ordinary())
    there = FAR_ORIGIN @ pair.reference_from_source @ FAR_ORIGIN.inverse()
    far = Pair(moved(pair.reference, FAR_ORIGIN), moved(pair.source, FAR_ORIGIN), there, pair.rows)
    before, after = seen(use(method, pair)), seen(use(method, far))
    if after.placement is not None:
        after = replace(after, placement=after.placement.about(FAR_ORIGIN.shift))
    unlike = difference(before, after, pair.source.xy, tolerance(method, pair))
    require(not unlike, f"with (5e5, 6e6) m added to all coordinates {unlike}")


@law
def too_few_trees_are_no_crash_and_no_number(method: Method) -> None:
    """0, 1 or 2 trees, or all at one point, give a refusal or few rows or trees: no error and no placement."""
    for name, pair in degenerate().items():
        result = use(method, with_rows_of_one(pair) if isinstance(method, RowMatcher) else pair)
        if isinstance(method, CoarseAligner | RowMatcher | PointMatcher):
            require(seen(result).refused, f"{name}: a placement was given")
        elif isinstance(result, tuple):
            for rows, survey in zip(result, (pair.reference, pair.source), strict=True):
                require_rows(rows, survey.ids.tolist(), name)


@law
def trees_on_a_line_are_no_crash_and_no_nonsense(method: Method) -> None:
    """A single straight row may be placed or refused, but it never fixes an affine transform."""
    for model in sorted(method.models, key=lambda m: m.parameters):
        pair = line()
        if isinstance(method, RowMatcher):
            rows = Rows((pair.reference.ids,))
            pair = replace(pair, rows=MatchedRows(rows, rows, NO_MATCHES))
        result = use(method, pair, Context(model=model))
        if isinstance(result, tuple) and all(isinstance(rows, Rows) for rows in result):
            require_rows(result[0], pair.reference.ids.tolist(), "all on a line")
        elif isinstance(result, Registration | tuple):
            placement = seen(result).placement
            finite = placement is None or np.isfinite(placement.matrix).all()
            require(finite, f"{model.value}: a placement is not finite")
            if isinstance(method, PointMatcher) and model is Model.AFFINE:
                require(placement is None, "an affine transform was fitted to trees on a line")


def with_rows_of_one(pair: Pair) -> Pair:
    """A degenerate pair with what rows it allows: all trees in one where there are two or more."""
    rows = [Rows((f.ids,)) if len(f) > 1 else Rows(()) for f in (pair.reference, pair.source)]
    return replace(pair, rows=MatchedRows(rows[0], rows[1], NO_MATCHES))


def tolerance(method: Method, pair: Pair) -> float:
    """How far two placements that should be the same may lie apart, metres RMS.

    A matcher fits; a coarse aligner has only to hand over within reach of a matcher.
    """
    return pair.reference.spacing / 4 if isinstance(method, CoarseAligner) else MILLIMETRE
