"""What the judge says: the verdict on a placement, its reason, its rivals and the error to expect."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from treereg_core.features import IntArray, frozen_array
from treereg_core.transform import Affine, FloatArray


class Verdict(Enum):
    """`accepted`; `ambiguous`: a rival explains the trees about as well; `failed`: no placement explains them."""

    ACCEPTED = "accepted"
    AMBIGUOUS = "ambiguous"
    FAILED = "failed"


@dataclass(frozen=True)
class Rival:
    """Another placement, with its natural log-odds against the chosen one (negative: less probable)."""

    transform: Affine
    log_odds: float


@dataclass(frozen=True)
class ExpectedError:
    """The true error to expect, RMS over the source's trees, metres, given that the placement is right."""

    rms: float
    ci95: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Matches:
    """One-to-one pairs of trees under one transform: `pairs` (n, 2) ids (reference, source), `residual` (n,) metres."""

    pairs: IntArray
    residual: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", frozen_array(self.pairs, np.int64).reshape(-1, 2))
        object.__setattr__(self, "residual", frozen_array(self.residual))

    @property
    def residual_rms(self) -> float | None:
        """Root mean square of the residuals, metres; None without pairs."""
        return float(np.sqrt(np.mean(self.residual**2))) if len(self.residual) else None


@dataclass(frozen=True, eq=False)
class Judgement:
    """The judge's word on a run; the same for every method.

    When the verdict is `failed`, `transform` and `expected_error` are None, `matches` is empty and
    `failure_probability` is 1. `before` are the pairs under the files' own georeference.
    """

    verdict: Verdict
    reason: str
    transform: Affine | None
    matches: Matches
    before: Matches
    expected_error: ExpectedError | None
    failure_probability: float
    rivals: tuple[Rival, ...]
