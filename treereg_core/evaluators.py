"""The evaluators that ship with the core, offered through the same door as a stranger's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from treereg_core.evaluator import Evaluator, Problem
from treereg_core.hookspecs import hookimpl
from treereg_core.image import agreement
from treereg_core.judgement import Judgement
from treereg_core.transform import Rigid

MILESTONES = (0.70, 0.80, 0.90, 0.95)
"""Shares of trees placed that treereg's founding proposal set itself as aims."""


class Truth(Evaluator):
    """Compares with the known true placement (target registration error; Fitzpatrick 2009, doi:10.1117/12.813601).

    - `error_m`: RMS distance over the source's trees between where they were put and where they belong, metres.
    - `rotation_error_deg`: of the turn, without sign; `translation_error_m`: of the place of the trees' centroid.
    - `placed`: the share of trees put within half the reference's tree spacing of where they belong, the registration
      accuracy; `milestone`: the highest of 0.70, 0.80, 0.90 and 0.95 that it reaches, 0 below.

    All are None without a truth; without a placement no tree is placed and there is no error.
    """

    name = "truth"

    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """The figures above."""
        names = ("error_m", "rotation_error_deg", "translation_error_m", "placed", "milestone")
        unknown: dict[str, float | None] = dict.fromkeys(names)
        if problem.truth is None:
            return unknown
        if judgement.transform is None:
            return {**unknown, "placed": 0.0, "milestone": 0.0}
        xy = problem.source.xy
        off = judgement.transform(xy) - problem.truth(xy)
        distance = np.hypot(*off.T)
        placed = float(np.mean(distance <= problem.reference.spacing / 2))
        turn = judgement.transform.rotation_deg - problem.truth.rotation_deg
        return {
            "error_m": float(np.sqrt(np.mean(distance**2))),
            "rotation_error_deg": abs(Rigid.turn(turn).rotation_deg),
            "translation_error_m": float(np.hypot(*off.mean(axis=0))),
            "placed": placed,
            "milestone": max((milestone for milestone in MILESTONES if placed >= milestone), default=0.0),
        }


class Residuals(Evaluator):
    """How far the judge's one-to-one pairs are apart (Fitzpatrick 2009, doi:10.1117/12.813601): no measure of accuracy.

    `rms_m`, `median_m`, `p95_m`: of the distances, metres; `matched`: the share of the smaller survey's trees that have
    a partner; `rms_before_m` and `matched_before` under the files' own georeference. None without pairs.
    """

    name = "residuals"

    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """The figures above."""
        said, before = judgement.matches, judgement.before
        fewer = min(len(problem.reference), len(problem.source))
        some = len(said.pairs) > 0
        return {
            "rms_m": said.residual_rms,
            "median_m": float(np.median(said.residual)) if some else None,
            "p95_m": float(np.quantile(said.residual, 0.95)) if some else None,
            "matched": len(said.pairs) / fewer if fewer else None,
            "rms_before_m": before.residual_rms,
            "matched_before": len(before.pairs) / fewer if fewer else None,
        }


class Pixels(Evaluator):
    """Compares the images, as they lie on each other (Zitova & Flusser 2003, doi:10.1016/S0262-8856(03)00137-9).

    `mse`: mean squared difference of the registered and the reference image over the area that both show, of
    grey values in 0 to 1; `ncc`: their normalised cross-correlation; `mse_before` and `ncc_before` under the files' own
    georeference. Two flights differ in light and growth, so a difference that remains is no error by itself. None
    without images, or where too little is common to both.
    """

    name = "pixels"

    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """The figures above."""
        found = problem.images and judgement.transform and agreement(*problem.images, judgement.transform)
        mse, ncc = found or (None, None)
        mse_before, ncc_before = problem.agreement_before or (None, None)
        return {"mse": mse, "ncc": ncc, "mse_before": mse_before, "ncc_before": ncc_before}


class Checkpoints(Evaluator):
    """Compares points that a person found in both surveys (ASPRS 2014, doi:10.14358/PERS.81.3.A1-A26).

    `rmse_m`: RMS distance, metres; `ce90_m`: the distance within which nine points in ten lie; both with `_before`
    under the files' own georeference. The error of finding the points is in them. None without checkpoints.
    """

    name = "checkpoints"

    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """The figures above."""
        said: dict[str, float | None] = {}
        for suffix, transform in (("", judgement.transform), ("_before", Rigid.identity())):
            said[f"rmse_m{suffix}"] = said[f"ce90_m{suffix}"] = None
            if problem.checkpoints and transform:
                reference, source = problem.checkpoints
                distance = np.hypot(*(transform(source) - reference).T)
                said[f"rmse_m{suffix}"] = float(np.sqrt(np.mean(distance**2)))
                said[f"ce90_m{suffix}"] = float(np.quantile(distance, 0.9))
        return said


@hookimpl
def treereg_evaluators() -> Iterable[type[Evaluator]]:
    """The evaluators of the core, offered like a stranger's."""
    return [Truth, Residuals, Pixels, Checkpoints]
