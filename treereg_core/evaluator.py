"""Evaluators say how good a result is."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from treereg_core.features import FeatureSet
from treereg_core.image import Image, agreement
from treereg_core.judgement import Judgement
from treereg_core.method import Method
from treereg_core.transform import Affine, FloatArray, Rigid


@dataclass(frozen=True, eq=False)
class Problem:
    """Two surveys in one working frame, and what else is known of them, None where it is not.

    `truth` is the true `reference_from_source`, `images` are pictures of both, `checkpoints` the same points in both,
    (k, 2) metres each.
    """

    reference: FeatureSet
    source: FeatureSet
    truth: Affine | None = None
    images: tuple[Image, Image] | None = None
    checkpoints: tuple[FloatArray, FloatArray] | None = None

    @cached_property
    def agreement_before(self) -> tuple[float, float] | None:
        """`agreement` of the images under the files' own georeference, whatever the method; None where unknown."""
        return agreement(*self.images, Rigid.identity()) if self.images else None


class Evaluator(Method):
    """Gives named figures for a judged result."""

    role = "evaluator"

    @abstractmethod
    def score(self, judgement: Judgement, problem: Problem) -> Mapping[str, float | None]:
        """Figures by name, the same names whatever the case, units in them; None for one that cannot be had."""
