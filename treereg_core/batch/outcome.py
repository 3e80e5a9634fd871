"""Outcome: what came of one orchard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any

import numpy as np

from treereg_core.result import Result, trees


class Word(Enum):
    """What came of an orchard: the judge's verdict, or why there is none."""

    ACCEPTED = "accepted"
    AMBIGUOUS = "ambiguous"
    FAILED = "failed"
    UNUSABLE = "unusable"
    """Its surveys cannot be used."""
    CRASHED = "crashed"
    """A fault of the code, or its process died."""
    TIMEOUT = "timeout"
    """It took longer than the time limit."""
    MEMORY = "memory"
    """Memory ran out."""
    WAITING = "waiting"
    """The batch was interrupted before it was done."""


JUDGED = (Word.ACCEPTED, Word.AMBIGUOUS, Word.FAILED)
"""Those of which there is a registration, so that they are not done again."""


@dataclass(frozen=True)
class Outcome:
    """One row of the summary. Lengths in metres; None where there is no such figure.

    - `expected_error`: RMS over the trees; `matched`: pairs of trees, `share` of the smaller survey's; `residual_rms`:
      how far they are apart.
    - `shift`, `rotation_deg`: how far the source was moved, and turned.
    - `seconds`: of the work; `attempts`: how often it was begun.
    - `warnings`: sentences for people.
    """

    orchard: str
    verdict: Word
    reason: str
    expected_error: float | None = None
    failure_probability: float | None = None
    matched: int | None = None
    share: float | None = None
    residual_rms: float | None = None
    shift: float | None = None
    rotation_deg: float | None = None
    seconds: float = 0.0
    attempts: int = 0
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(cls, orchard: str, result: Result, **more: Any) -> Outcome:
        """Of a registration; `more` are the fields that are not of it."""
        said = result.judgement
        fewest = min(len(trees(result.reference)), len(trees(result.source)))
        shift = rotation_deg = None
        if said.transform is not None:
            centroid = trees(result.source).xy.mean(axis=0, keepdims=True)
            shift = float(np.linalg.norm(said.transform(centroid) - centroid))
            rotation_deg = float(said.transform.rotation_deg)
        return cls(
            orchard=orchard,
            verdict=Word(said.verdict.value),
            reason=said.reason,
            expected_error=float(said.expected_error.rms) if said.expected_error else None,
            failure_probability=float(said.failure_probability),
            matched=len(said.matches.pairs),
            share=len(said.matches.pairs) / fewest,
            residual_rms=said.matches.residual_rms,
            shift=shift,
            rotation_deg=rotation_deg,
            **more,
        )

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {**vars(self), "verdict": self.verdict.value, "warnings": list(self.warnings)}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Outcome:
        """Of what `to_json` gave. `LookupError`, `TypeError` or `ValueError` for anything else."""
        known = {field.name: values[field.name] for field in fields(cls)}
        return cls(**{**known, "verdict": Word(known["verdict"]), "warnings": tuple(known["warnings"])})
