"""Laws on point matchers, which work near the truth; whole expressions keep them too."""

from __future__ import annotations

import math

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.method import Context, PointMatcher, Registration
from treereg_core.pair import Pair
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import copies, moved, near, ordinary, scene, small_motion, swapped
from treereg_core.testing.using import CONTEXT, MILLIMETRE, placed, require_near, use
from treereg_core.transform import Affine, Model, Rigid, Similarity

SEEDS = range(8)


@law
def a_survey_on_itself_is_the_identity(method: PointMatcher) -> None:
    """Identical surveys, started at the identity, stay where they are."""
    features = ordinary().reference
    placement = placed(use(method, Pair(features, features)))
    require_near(placement, Rigid.identity(), features.xy, MILLIMETRE, "the identity")


@law
def a_known_transform_comes_back(method: PointMatcher) -> None:
    """Exact copies under a transform of every kind that the method fits, started a quarter of the spacing off."""
    features = ordinary().reference
    centre = features.xy.mean(axis=0)
    known = {
        Model.RIGID: Rigid.turn(40.0, shift=(20.0, -35.0)),
        Model.SIMILARITY: Similarity(1.004 * Rigid.turn(40.0).linear, (20.0, -35.0)).about(-centre),
        Model.AFFINE: Affine(Rigid.turn(40.0).linear @ [[1.004, 0.002], [0.001, 0.997]], (20.0, -35.0)).about(-centre),
    }
    for model in sorted(method.models, key=lambda m: m.parameters):
        truth = known[model]
        pair = copies(features, truth).at(small_motion(features.xy, features.spacing) @ truth)
        placement = placed(use(method, pair, Context(model=model)))
        require(type(placement) is model.kind, f"{model.value} was asked for and {type(placement).__name__} given")
        require_near(placement, truth, pair.source.xy, MILLIMETRE, f"a known {model.value} transform")


@law
def it_is_as_good_as_a_fit_to_the_true_pairs(method: PointMatcher) -> None:
    """In a few ordinary and noisy orchards the error is at most 1.5 times that of the best possible fit."""
    for name in ("ordinary", "noisy"):
        simulations = [scene(name, seed) for seed in SEEDS]
        errors = [s.error(placed(use(method, near(s, s.seed)))) for s in simulations]
        best = [s.error(s.true_fit()) for s in simulations]
        error, least = (math.sqrt(float(np.mean(np.square(e)))) for e in (errors, best))
        require(error <= 1.5 * least, f"{name}: {error:.3f} m RMS, where a fit to the true pairs has {least:.3f} m")


@law
def a_moved_source_moves_the_result(method: PointMatcher) -> None:
    """register(T source) is register(source) T^-1: the source's own frame is irrelevant."""
    pair, by = near(ordinary()), Rigid.turn(-57.0, shift=(33.0, 80.0))
    there = Pair(pair.reference, moved(pair.source, by), pair.reference_from_source @ by.inverse())
    before, after = placed(use(method, pair)), placed(use(method, there))
    require_near(after @ by, before, pair.source.xy, MILLIMETRE, "from a moved source")


@law
def a_moved_reference_moves_the_result(method: PointMatcher) -> None:
    """register of T reference is T register: so is the reference's."""
    pair, by = near(ordinary()), Rigid.turn(112.0, shift=(-10.0, 45.0))
    there = Pair(moved(pair.reference, by), pair.source, by @ pair.reference_from_source)
    before, after = placed(use(method, pair)), placed(use(method, there))
    require_near(after, by @ before, pair.source.xy, MILLIMETRE, "onto a moved reference")


@law
def swapped_surveys_give_the_inverse(method: PointMatcher) -> None:
    """Reference and source in each other's place give the inverse, as far as a fit to the true pairs can tell."""
    simulation = ordinary()
    pair = near(simulation)
    before, after = placed(use(method, pair)), placed(use(method, swapped(pair)))
    least = expected_fit_error(simulation.scene.jitter, len(simulation.true_pairs()))
    require_near(after.inverse(), before, pair.source.xy, least, "with the surveys swapped")


@law
def what_is_returned_was_fitted(method: PointMatcher) -> None:
    """Pairs are of trees that are there, weights are finite and not negative, and their fit is the transform."""
    pair = near(ordinary())
    for model in sorted(method.models, key=lambda m: m.parameters):
        result = use(method, pair, Context(model=model))
        require(isinstance(result, Registration), f"it gave {result!r}")
        reference = pair.reference.positions(result.pairs[:, 0])
        source = pair.source.positions(result.pairs[:, 1])
        require((reference >= 0).all() and (source >= 0).all(), "a pair is of a tree that is not there")
        require(np.isfinite(result.weights).all() and (result.weights >= 0).all(), "a weight is not a weight")
        fit = model.fit(pair.source.xy[source], pair.reference.xy[reference], result.weights)
        require_near(result.transform, fit, pair.source.xy, MILLIMETRE, f"{model.value}: the fit of its own pairs")


@law
def trees_of_no_weight_count_for_nothing(method: PointMatcher) -> None:
    """Every fourth tree of the source has weight 0 and stands wrong by a quarter of the spacing: nobody follows it."""
    simulation = ordinary()
    pair = near(simulation)
    wrong = np.arange(len(pair.source)) % 4 == 0
    off = pair.reference.spacing / 4 * np.column_stack([wrong, np.zeros(len(wrong))])
    source = pair.source.replace(xy=pair.source.xy + off, weight=np.where(wrong, 0.0, 1.0))
    error = simulation.error(placed(use(method, Pair(pair.reference, source, pair.reference_from_source))))
    # A fit that follows is off by a quarter of a quarter of the spacing; one that does not has 3/4 of the pairs.
    most = 3 * expected_fit_error(simulation.scene.jitter, 0.75 * len(simulation.true_pairs()))
    require(error <= most, f"{error:.3f} m off where {most:.3f} m are allowed")


@law
def nothing_within_reach_is_refused(method: PointMatcher) -> None:
    """Surveys that lie a hundred kilometres apart give no placement."""
    pair = near(ordinary())
    result = use(method, pair.at(Rigid(np.eye(2), (1e5, 0.0)) @ pair.reference_from_source), CONTEXT)
    require(isinstance(result, NoRegistration), f"it gave {result!r}")


def expected_fit_error(jitter_m: float, pairs: float) -> float:
    """RMS error of a rigid fit to true pairs, metres: sigma sqrt(3 / N), both surveys with this jitter per axis."""
    return math.sqrt(2) * jitter_m * math.sqrt(3 / pairs)
