"""Orchards made by hand, and placements on them, for the tests of the judge and what it is built from."""

from __future__ import annotations

import numpy as np

from treereg_core.correlation import Correlator
from treereg_core.evidence import Evidence
from treereg_core.features import FeatureSet
from treereg_core.judge import Judge
from treereg_core.judgement import Judgement
from treereg_core.method import Context, Registration
from treereg_core.pair import Pair
from treereg_core.rotation import rotations
from treereg_core.screening import screen
from treereg_core.simulate import Simulation
from treereg_core.transform import Affine, FloatArray, Model, Rigid

CONTEXT = Context()
IDENTITY = Rigid.identity()
MAX_FAILURE = 0.001


def grid(rows: int, columns: int, row_spacing: float = 5.5, spacing: float = 3.0) -> FloatArray:
    """Trees of straight rows along x, metres, row by row, the first at (0, 0)."""
    x, y = np.meshgrid(np.arange(columns) * spacing, np.arange(rows) * row_spacing)
    return np.column_stack([x.ravel(), y.ravel()])


def shifted_by(x: float, y: float) -> Rigid:
    """A placement that shifts by so many metres and does not turn."""
    return Rigid(np.eye(2), (x, y))


def half_turn_symmetric(planting_error_m: float) -> tuple[FloatArray, FloatArray]:
    """Positions about (0, 0) and areas of an orchard with gaps that a half turn leaves as it is."""
    rng = np.random.default_rng(7)
    half = grid(10, 30) + rng.normal(0, planting_error_m, (300, 2)) - np.array([43.5, 52.25])
    keep = rng.random(300) > 0.08
    area = rng.lognormal(1.6, 0.3, 300)[keep]
    return np.concatenate([half[keep], -half[keep]]), np.concatenate([area, area])


def alike(xy: FloatArray) -> FeatureSet:
    """Trees that are all the same but for where they stand."""
    return FeatureSet.of(xy, area=np.full(len(xy), 5.0))


def pair_of(simulation: Simulation) -> Pair:
    """The two surveys of a simulation, at the identity."""
    return Pair(simulation.reference, simulation.source)


def truth_of(simulation: Simulation) -> Affine:
    """The true placement; an assertion fails where there is none."""
    assert simulation.truth is not None
    return simulation.truth


def lattice_steps(simulation: Simulation) -> FloatArray:
    """The step to the next tree of a row and that to the next row, (2, 2) metres, in the reference's frame."""
    trees = simulation.trees
    design = np.column_stack([trees.column, trees.row, np.ones(len(trees))])
    return np.asarray(np.linalg.lstsq(design, trees.xy)[0][:2])


def off_by(simulation: Simulation, along: int, across: int) -> Affine:
    """The placement that is so many trees along the row and so many rows across away from the truth."""
    step = np.array([along, across]) @ lattice_steps(simulation)
    return Rigid(np.eye(2), step) @ truth_of(simulation)


def settled(pair: Pair, near: Affine) -> Registration:
    """The least-squares registration that the nearest trees give near a placement, as any local method would."""
    evidence = Evidence(pair.reference, pair.source)
    match = evidence.match(evidence.refine(near, Model.RIGID))
    pairs = np.column_stack([pair.reference.ids[match.reference], pair.source.ids[match.source]])
    return Registration(match.transform, pairs, np.ones(len(pairs)))


def judged(pair: Pair, *near: Affine, context: Context = CONTEXT) -> Judgement:
    """The judge's word on what is found near these placements."""
    return Judge().judge(pair, [settled(pair, placement) for placement in near], context, MAX_FAILURE)


def guesses(pair: Pair, count: int = 6) -> list[Affine]:
    """The placements at which most speaks for the pair, from all turns and shifts: what a search might end on."""
    evidence = Evidence(pair.reference, pair.source)
    correlator = Correlator(evidence)
    turns, _ = rotations(pair.reference, pair.source, evidence.spacing, CONTEXT.rng("guesses"), 3)
    found = [
        peaks.transform(int(k))
        for turn_deg in turns
        for peaks in correlator.at(Rigid.turn(turn_deg))
        for k in peaks.foremost(8)
    ]
    screened = screen(evidence, tuple(found), np.arange(0, len(pair.source), 3))
    chosen: list[Affine] = []
    for k in np.argsort(-screened.score):
        if all(evidence.apart(screened.transforms[k], other) > evidence.gate for other in chosen):
            chosen.append(screened.transforms[k])
    return chosen[:count]
