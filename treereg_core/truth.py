"""The evaluator that ships with the core, offered through the same door as a stranger's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from treereg_core.evaluator import Evaluator, Problem
from treereg_core.hookspecs import hookimpl
from treereg_core.judgement import Judgement


class Truth(Evaluator):
    """Compares with the known true placement (target registration error; Fitzpatrick 2009, doi:10.1117/12.813601).

    `error_m` is the RMS distance over the source's trees between where they were put and where they belong, metres;
    `placed` the share of trees put within half the reference's tree spacing of where they belong. Both None without a
    truth; without a placement no tree is placed and there is no error.
    """

    name = "truth"

    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """The figures `error_m` and `placed`."""
        if problem.truth is None:
            return {"error_m": None, "placed": None}
        if judgement.transform is None:
            return {"error_m": None, "placed": 0.0}
        xy = problem.source.xy
        distance = np.linalg.norm(judgement.transform(xy) - problem.truth(xy), axis=1)
        return {
            "error_m": float(np.sqrt(np.mean(distance**2))),
            "placed": float(np.mean(distance <= problem.reference.spacing / 2)),
        }


@hookimpl
def treereg_evaluators() -> Iterable[type[Evaluator]]:
    """The evaluators of the core, offered like a stranger's."""
    return [Truth]
