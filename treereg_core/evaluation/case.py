"""Case: what one trial starts from, and where cases come from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from treereg_core.evaluator import Problem
from treereg_core.features import BoolArray, FeatureSet
from treereg_core.image import Image
from treereg_core.misregistration import drawn, misregistration
from treereg_core.simulate import FAMILIES, Simulation, simulate_family
from treereg_core.transform import Affine, FloatArray

NONE = math.nan
RIGHT_M = 0.5
RIGHT_FACTOR = 1.25


@dataclass(frozen=True, eq=False)
class Case:
    """Two surveys of which it is known how they lie to each other.

    - `name`: the family, or the names of the surveys; `seed`: tells cases of one name apart.
    - `problem`: the surveys, and the truth where there is one.
    - `counted` (m,): the source's trees that the error is taken over.
    - `fit_error`: of the fit with the true pairs, metres; `bend`: what no rigid transform can undo, RMS metres. NaN and
      0 where they are not known.
    """

    name: str
    seed: int
    problem: Problem
    counted: BoolArray
    fit_error: float = NONE
    bend: float = 0.0

    def error(self, found: Affine | None) -> float:
        """RMS distance of the counted trees from where they belong, metres; NaN where it cannot be told."""
        truth = self.problem.truth
        if found is None or truth is None or not self.counted.any():
            return NONE
        xy = self.problem.source.xy[self.counted]
        return math.sqrt(float(np.mean(((found(xy) - truth(xy)) ** 2).sum(axis=1))))

    def right(self, found: Affine | None) -> bool:
        """Whether a placement counts as right: `is_right` of its error; never without a placement or a truth."""
        return is_right(self.error(found), self.fit_error, self.bend)

    @property
    def misplaced(self) -> tuple[float, float]:
        """How far the files' own georeference is off: turn, degrees, and shift of the trees' centroid, metres."""
        truth = self.problem.truth
        if truth is None:
            return NONE, NONE
        centroid = self.problem.source.xy.mean(axis=0, keepdims=True)
        return abs(truth.rotation_deg), float(np.hypot(*(truth(centroid) - centroid)[0]))


def is_right(error: float, fit_error: float, bend: float) -> bool:
    """Whether an error, metres, is below 0.5 m or 1.25 times that of the fit with the true pairs; never for NaN.

    Both then count the distortion that no rigid transform can undo (`bend`).
    """
    limit = RIGHT_M if math.isnan(fit_error) else max(RIGHT_M, RIGHT_FACTOR * math.hypot(fit_error, bend))
    return math.hypot(error, bend) < limit


class Source(Protocol):
    """Where cases come from."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its cases."""

    def case(self, name: str, seed: int) -> Case:
        """The case of this name and seed; the same ones give the same case."""


@dataclass(frozen=True)
class Families:
    """Simulated pairs of surveys, by family."""

    names: tuple[str, ...] = tuple(FAMILIES)

    def case(self, name: str, seed: int) -> Case:
        """A simulated pair of surveys with its truth."""
        return of_simulation(simulate_family(name, seed), name)


def of_simulation(simulation: Simulation, name: str) -> Case:
    """The case of simulated surveys."""
    try:
        fit_error = simulation.error(simulation.true_fit())
    except ValueError:
        fit_error = NONE
    return Case(
        name=name,
        seed=simulation.seed,
        problem=Problem(simulation.reference, simulation.source, simulation.truth),
        counted=simulation.source_trees[:, 0] >= 0,
        fit_error=fit_error,
        bend=simulation.bend,
    )


@dataclass(frozen=True, eq=False)
class Misregistered:
    """Two surveys that are taken to lie rightly on each other, or one and itself, the source misregistered anew.

    It is turned about its trees' centroid and then shifted, both drawn from normal distributions: `rotation_sd` in
    degrees, `translation_sd` in metres for each axis.
    """

    name: str
    reference: FeatureSet
    source: FeatureSet
    rotation_sd: float
    translation_sd: float
    images: tuple[Image, Image] | None = None
    checkpoints: tuple[FloatArray, FloatArray] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The one name of all its cases."""
        return (self.name,)

    def case(self, name: str, seed: int) -> Case:
        """The surveys with the misregistration of this seed."""
        wrong = misregistration(self.source, *drawn(seed, self.rotation_sd, self.translation_sd))
        source = self.source.replace(xy=wrong(self.source.xy))
        images = self.images and (self.images[0], self.images[1].moved(wrong))
        checkpoints = self.checkpoints and (self.checkpoints[0], wrong(self.checkpoints[1]))
        problem = Problem(self.reference, source, wrong.inverse(), images, checkpoints)
        return Case(name, seed, problem, np.ones(len(source), dtype=bool))
