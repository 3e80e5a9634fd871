"""Result: everything that a run found out, and the registration.json made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.heights import VerticalOffset, vertical_offset
from treereg_core.judgement import Judgement, Matches, Verdict
from treereg_core.method import Described
from treereg_core.plan import Plan
from treereg_core.survey import Frame, Survey
from treereg_core.transform import Affine, Model, Rigid

SCHEMA = "treereg/registration/1"
LOG_ODDS_LIMIT = 1e6


@dataclass(frozen=True, eq=False)
class Result:
    """What a run found out; `to_json()` is the content of registration.json.

    `reference` and `source` are in one working frame; so are the transforms of the judgement. `timings` are seconds.
    `warnings` are sentences for people on what went wrong beside the registration. `described` is what the filters know
    of the reference's and of the source's usable trees at the placement: by name, arrays in the order of the features.
    """

    plan: Plan
    reference: Survey | FeatureSet
    source: Survey | FeatureSet
    judgement: Judgement
    timings: Mapping[str, float]
    warnings: tuple[str, ...] = ()
    described: Described = ({}, {})

    @property
    def accepted(self) -> bool:
        """Whether the judge accepted the placement."""
        return self.judgement.verdict is Verdict.ACCEPTED

    @property
    def transform(self) -> Affine | None:
        """`reference_from_source` in the working frame; None when the verdict is `failed`."""
        return self.judgement.transform

    @property
    def frame(self) -> Frame | None:
        """The working frame; None for trees that were given as plain arrays."""
        return self.reference.frame if isinstance(self.reference, Survey) else None

    @property
    def vertical_offset(self) -> VerticalOffset | None:
        """What the source's elevations lack against the reference's, over the matched trees; None where not known."""
        if not isinstance(self.reference, Survey) or not isinstance(self.source, Survey):
            return None
        if self.reference.heights is None or self.source.heights is None:
            return None
        ids = self.judgement.matches.pairs
        at = [survey.features.positions(ids[:, k]) for k, survey in enumerate((self.reference, self.source))]
        return vertical_offset(self.reference.heights, self.source.heights, np.column_stack(at))

    def full_coordinates(self, transform: Affine) -> Affine:
        """A transform of the working frame in full projected coordinates."""
        return transform.about(-np.asarray(self.frame.origin)) if self.frame else transform

    def to_json(self) -> dict[str, Any]:
        """The content of registration.json: plain values, every number finite."""
        said, offset = self.judgement, self.vertical_offset
        return {
            "schema": SCHEMA,
            "method": self.plan.options.method,
            "settings": self.plan.settings,
            "start": self.plan.options.start,
            "seed": self.plan.options.seed,
            "version": metadata.version("treereg"),
            "plugins": self.plan.plugins,
            "reference": survey_json(self.reference),
            "source": survey_json(self.source),
            "crs": self.frame.crs if self.frame else None,
            "verdict": said.verdict.value,
            "reason": said.reason,
            "transform": self._transform_json(),
            **matches_json(said.matches),
            "expected_error_m": said.expected_error
            and {"rms": float(said.expected_error.rms), "ci95": [float(bound) for bound in said.expected_error.ci95]},
            "failure_probability": float(said.failure_probability),
            "rivals": [
                {
                    "matrix": self.full_coordinates(rival.transform).matrix.tolist(),
                    "log_odds": float(np.clip(rival.log_odds, -LOG_ODDS_LIMIT, LOG_ODDS_LIMIT)),
                }
                for rival in said.rivals
            ],
            "before": matches_json(said.before),
            "timings_s": {name: round(seconds, 4) for name, seconds in self.timings.items()},
            **({"vertical_offset_m": asdict(offset)} if offset else {}),
        }

    def _transform_json(self) -> dict[str, Any] | None:
        transform, frame = self.judgement.transform, self.frame
        if transform is None:
            return None
        return transform_json(transform, trees(self.source), frame.origin if frame else (0.0, 0.0))


def transform_json(transform: Affine, source: FeatureSet, origin: tuple[float, float]) -> dict[str, Any]:
    """A transform `reference_from_source` as files have it: its matrix in full coordinates, and numbers to read.

    `source` are the trees at whose centroid the shift is given. Both are in coordinates less `origin`, metres.
    """
    centroid = source.xy.mean(axis=0, keepdims=True)
    return {
        "model": next(model.value for model in Model if isinstance(transform, model.kind)),
        "matrix": transform.about(-np.asarray(origin)).matrix.tolist(),
        "rotation_deg": transform.rotation_deg,
        "translation_m": (transform(centroid) - centroid)[0].tolist(),
        **({} if isinstance(transform, Rigid) else {"scale": transform.scale}),
    }


def trees(survey: Survey | FeatureSet) -> FeatureSet:
    """The usable trees of a survey, or the trees themselves."""
    return survey.features if isinstance(survey, Survey) else survey


def survey_json(survey: Survey | FeatureSet) -> dict[str, Any]:
    """Path, features in the file and usable ones; no path for trees that were given as plain arrays."""
    if isinstance(survey, Survey):
        return {"path": str(survey.path), "features": survey.count, "used": len(survey.features)}
    return {"path": None, "features": len(survey), "used": len(survey)}


def matches_json(matches: Matches) -> dict[str, Any]:
    """How many trees are matched, and how far apart they are."""
    return {"matched": len(matches.pairs), "residual_rms_m": matches.residual_rms}
