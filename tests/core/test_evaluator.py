"""The truth evaluator by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.methods import orchard
from treereg_core.evaluator import Problem
from treereg_core.evaluators import Truth
from treereg_core.judgement import Judgement, Matches, Verdict
from treereg_core.transform import Affine, Rigid

NONE = Matches(np.empty((0, 2)), np.empty(0))


def judged(transform: Affine | None) -> Judgement:
    return Judgement(Verdict.AMBIGUOUS, "for a test", transform, NONE, NONE, None, 0.5, ())


@pytest.mark.parametrize(("shift", "placed"), [((0.3, 0.4), 1.0), ((0.0, 3.0), 0.0)])
def test_a_shift_is_its_own_error(shift: tuple[float, float], placed: float) -> None:
    trees = orchard()
    truth = Rigid.turn(10)
    found = Rigid.turn(0, shift=shift) @ truth
    figures = Truth().score(judged(found), Problem(trees, trees, truth))
    assert figures["error_m"] == pytest.approx(np.hypot(*shift))
    assert figures["placed"] == placed


def test_a_turn_is_measured_over_the_trees() -> None:
    trees = orchard()
    figures = Truth().score(judged(Rigid.turn(1, about=(0, 0))), Problem(trees, trees, Rigid.identity()))
    chord = 2 * np.sin(np.radians(1) / 2)
    assert figures["error_m"] == pytest.approx(chord * np.sqrt((trees.xy**2).sum(axis=1).mean()))


def test_without_a_truth_or_a_placement() -> None:
    trees = orchard()
    assert Truth().score(judged(Rigid.identity()), Problem(trees, trees)) == {"error_m": None, "placed": None}
    assert Truth().score(judged(None), Problem(trees, trees, Rigid.identity())) == {"error_m": None, "placed": 0.0}
