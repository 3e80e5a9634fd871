"""Evaluators say how good a result is."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from treereg_core.features import FeatureSet
from treereg_core.image import Image
from treereg_core.judgement import Judgement
from treereg_core.method import Method
from treereg_core.transform import Affine


@dataclass(frozen=True, eq=False)
class Problem:
    """Two surveys in one working frame; the true `reference_from_source` and their images where these are known."""

    reference: FeatureSet
    source: FeatureSet
    truth: Affine | None = None
    images: tuple[Image, Image] | None = None


class Evaluator(Method):
    """Gives named figures for a judged result."""

    role = "evaluator"

    @abstractmethod
    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """Figures by name, the same names whatever the case, units in them; None for one that cannot be had."""
