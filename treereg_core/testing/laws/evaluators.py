"""Laws on evaluators."""

from __future__ import annotations

import math
from collections.abc import Mapping

from treereg_core.evaluator import Evaluator, Problem
from treereg_core.testing.law import law, require
from treereg_core.testing.scenes import ordinary
from treereg_core.testing.using import judgement_of


@law
def figures_are_numbers_or_none(method: Evaluator) -> None:
    """Whatever is known or found, there are figures with names, each a finite number or None, under the same names."""
    simulation = ordinary()
    problem = Problem(simulation.reference, simulation.source, simulation.truth)
    unknown = Problem(simulation.reference, simulation.source)
    named: set[str] | None = None
    for judgement in (judgement_of(simulation.truth), judgement_of(None)):
        for case in (problem, unknown):
            figures: Mapping[str, float | None] = method.score(judgement, case)
            for name, value in figures.items():
                require(value is None or math.isfinite(value), f"{name} is {value}")
            require(named is None or named == figures.keys(), "the names of the figures depend on the case")
            named = set(figures)
    require(named, "there are no figures")
