"""Laws on whole expressions: from the default start, through the stages, to the judge's word."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from treereg_core.errors import NoRegistration, TreeregError
from treereg_core.features import FeatureSet
from treereg_core.judge import Judge
from treereg_core.judgement import Judgement, Verdict
from treereg_core.method import CoarseAligner, Context, PointMatcher
from treereg_core.options import defaults
from treereg_core.pair import Pair
from treereg_core.pipeline import Pipeline
from treereg_core.plan import aligner_named
from treereg_core.registry import installed
from treereg_core.simulate import Simulation
from treereg_core.testing.law import LawSkipped, law, require
from treereg_core.testing.scenes import SCENES, copies, degenerate, lattices, line, moved, ordinary, scene, shuffled
from treereg_core.testing.using import CONTEXT, MILLIMETRE, plain, require_near
from treereg_core.transform import Affine, Rigid

MAX_FAILURE = 0.001
ROWS_OVER = (1, -1, 3)
"""Starts that are so many rows off, from which a local method ends on the wrong trees with a perfect residual."""


@law
def an_ordinary_orchard_is_accepted_and_right(method: PointMatcher) -> None:
    """Turned any way, shifted by tens of metres, little noise: accepted, and right."""
    simulation = ordinary()
    judgement = judged(method, simulation.reference, simulation.source)
    require_right(accepted(judgement), simulation, "an ordinary orchard")


@law
def itself_is_the_identity(method: PointMatcher) -> None:
    """A survey registered onto itself is accepted where it is."""
    features = ordinary().reference
    placement = accepted(judged(method, features, features))
    require_near(placement, Rigid.identity(), features.xy, MILLIMETRE, "the identity")


@law
def a_copy_is_found_anywhere(method: PointMatcher) -> None:
    """A copy turned by any angle and shifted by far more than the spacing is accepted where it belongs."""
    features = ordinary().reference
    for angle, shift in ((17.0, (70.0, -25.0)), (180.0, (0.0, 90.0))):
        truth = Rigid.turn(angle, shift=shift)
        pair = copies(features, truth)
        placement = accepted(judged(method, pair.reference, pair.source))
        require_near(placement, truth, pair.source.xy, MILLIMETRE, f"a copy turned by {angle:g} degrees")


@law
def the_sources_frame_does_not_matter(method: PointMatcher) -> None:
    """register(T source) is register(source) T^-1, all the way."""
    reference, source = ordinary().reference, ordinary().source
    by = Rigid.turn(71.0, shift=(40.0, -90.0))
    before, after = (accepted(judged(method, reference, s)) for s in (source, moved(source, by)))
    require_near(after @ by, before, source.xy, MILLIMETRE, "from a moved source")


@law
def swapped_surveys_are_placed_inversely(method: PointMatcher) -> None:
    """Reference and source in each other's place: the inverse, to within the error of the fit."""
    simulation = ordinary()
    before = accepted(judged(method, simulation.reference, simulation.source))
    after = accepted(judged(method, simulation.source, simulation.reference))
    most = 2 * simulation.error(simulation.true_fit()) + simulation.error(before)
    require_near(after.inverse(), before, simulation.source.xy, most, "with the surveys swapped")


@law
def every_model_is_fitted_all_the_way(method: PointMatcher) -> None:
    """Whichever transform is asked for, of those that all stages can work with, is what is accepted, and right."""
    simulation = ordinary()
    stages = pipeline_of(method).stages
    for model in sorted(frozenset.intersection(*(s.models for s in stages)), key=lambda m: m.parameters):
        context = Context(model=model)
        placement = accepted(judged(method, simulation.reference, simulation.source, context))
        require(type(placement) is model.kind, f"{model.value} was asked for and {type(placement).__name__} accepted")
        require_right(placement, simulation, model.value)


@law
def threads_change_no_word_of_the_judge(method: PointMatcher) -> None:
    """One thread and two give the same judgement, bit by bit."""
    survey = ordinary()
    one, two = (plain(judged(method, survey.reference, survey.source, Context(threads=threads))) for threads in (1, 2))
    require(one == two, "judgements with 1 and 2 threads differ")


@law
def order_of_trees_changes_no_verdict(method: PointMatcher) -> None:
    """Trees in another order, with their ids, are accepted at the same place."""
    pair = Pair(ordinary().reference, ordinary().source)
    mixed = shuffled(pair)
    before, after = (accepted(judged(method, p.reference, p.source)) for p in (pair, mixed))
    require_near(after, before, pair.source.xy, MILLIMETRE, "with the trees in another order")


@law
def hard_scenes_are_right_or_not_accepted(method: PointMatcher) -> None:
    """Noise, outliers, half overlap, few trees, another orchard: nothing wrong is ever accepted."""
    for name in SCENES:
        for seed in range(2):
            simulation = scene(name, seed)
            judgement = judged(method, simulation.reference, simulation.source)
            require_honest(judgement, simulation, f"{name}, seed {seed}")


@law
def a_wrong_start_is_found_out(method: PointMatcher) -> None:
    """Started a row over or turned by half, a local method ends on the wrong trees: it is not accepted there."""
    simulation = ordinary()
    starts = wrong_starts(simulation)
    for name, start in starts.items():
        pair = Pair(simulation.reference, simulation.source)
        judgement = judged_from(method, pair, [pair.at(start)])
        require_honest(judgement, simulation, f"started {name}")


@law
def a_lattice_is_ambiguous(method: PointMatcher) -> None:
    """Exactly periodic surveys, the same or differing crops of one, are called ambiguous, never accepted."""
    for name, pair in lattices().items():
        verdict = judged(method, pair.reference, pair.source).verdict
        require(verdict is Verdict.AMBIGUOUS, f"{name} is {verdict.value}, where ambiguous is right")


@law
def too_few_trees_are_never_accepted(method: PointMatcher) -> None:
    """0, 1 or 2 trees, all at one point: failed, without a transform. An even line: not accepted."""
    for name, pair in degenerate().items():
        judgement = judged(method, pair.reference, pair.source)
        require(judgement.verdict is Verdict.FAILED, f"{name}: {judgement.verdict.value}, where failed is right")
        require(judgement.transform is None, f"{name}: a transform was given")
    verdict = judged(method, line().reference, line().source).verdict
    require(verdict is not Verdict.ACCEPTED, "trees evenly on a line were accepted")


def judged(method: PointMatcher, reference: FeatureSet, source: FeatureSet, context: Context = CONTEXT) -> Judgement:
    """The judge's word on a method from the default start."""
    pair = Pair(reference, source)
    try:
        starts: Sequence[Pair] = default_aligner().propose(pair, context)
    except NoRegistration:
        starts = ()
    return judged_from(method, pair, starts, context)


def judged_from(method: PointMatcher, pair: Pair, starts: Sequence[Pair], context: Context = CONTEXT) -> Judgement:
    """The judge's word on a method from these starts."""
    candidates = pipeline_of(method).registrations(starts, context)
    return Judge().judge(pair, candidates, context, MAX_FAILURE)


def pipeline_of(method: PointMatcher) -> Pipeline:
    """The method as a whole expression: itself when it is one."""
    return method if isinstance(method, Pipeline) else Pipeline.of([method])


@cache
def default_aligner() -> CoarseAligner:
    """The coarse aligner that a run uses where nothing else is said; the law is skipped where it is not installed."""
    try:
        aligner = aligner_named(defaults()["start"], installed())
    except TreeregError as error:
        raise LawSkipped(f"there is no default start: {error}") from None
    if aligner is None:
        raise LawSkipped("the default start is no coarse aligner")
    return aligner()


def accepted(judgement: Judgement) -> Affine:
    """The transform of an accepted judgement; `AssertionError` for any other."""
    happened = f"it is {judgement.verdict.value}: {judgement.reason}"
    require(judgement.verdict is Verdict.ACCEPTED, happened)
    if judgement.transform is None:
        raise AssertionError("it is accepted and has no transform")
    return judgement.transform


def require_honest(judgement: Judgement, simulation: Simulation, name: str) -> None:
    """Require a judgement to be right or not accepted."""
    if judgement.verdict is Verdict.ACCEPTED:
        require(simulation.truth is not None, f"{name}: accepted, where there is no truth")
        require_right(accepted(judgement), simulation, name)


def require_right(placement: Affine, simulation: Simulation, name: str) -> None:
    """Require an error under half a metre, or 1.25 times that of the fit to the true pairs where that is more."""
    error, most = simulation.error(placement), max(0.5, 1.25 * simulation.error(simulation.true_fit()))
    require(error <= most, f"{name}: accepted and {error:.2f} m off where {most:.2f} m are allowed")


def wrong_starts(simulation: Simulation) -> dict[str, Affine]:
    """Placements that a local method takes for the truth: rows over, trees over and the half turn."""
    truth = simulation.truth
    if truth is None:
        raise ValueError("this simulation has no true transform")
    trees = simulation.trees
    follow = (np.diff(trees.row) == 0) & (np.diff(trees.column) == 1)
    along = np.median(np.diff(trees.xy, axis=0)[follow], axis=0)
    across = np.array([-along[1], along[0]]) / np.hypot(*along) * simulation.scene.row_spacing
    centre = trees.xy.mean(axis=0)
    starts: dict[str, Affine] = {"a tree over": Rigid(np.eye(2), along) @ truth}
    for rows in ROWS_OVER:
        starts[f"{rows} rows over"] = Rigid(np.eye(2), rows * across) @ truth
    starts["turned by half"] = Rigid.turn(180.0, about=centre) @ truth
    return starts
