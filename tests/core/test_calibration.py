"""From margins to probabilities of failure."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from treereg_core.calibration import LEAST_CLAIMED, failure_probability

MARGINS = st.floats(-1e4, 1e4)


def test_a_tie_is_wrong_and_a_clear_lead_is_right():
    assert failure_probability(0.0) > 0.95
    assert failure_probability(-30.0) > 0.999
    assert failure_probability(40.0) == LEAST_CLAIMED


def test_what_is_accepted_by_default_beats_its_rivals_by_far():
    assert failure_probability(14.0) > 0.001 > failure_probability(18.0)


@given(MARGINS, MARGINS, st.floats(-100, 100))
def test_more_margin_is_never_more_probably_wrong(one, other, prior):
    low, high = sorted((one, other))
    assert failure_probability(low, prior) >= failure_probability(high, prior)


@given(MARGINS, st.floats(0, 100))
def test_what_was_known_beforehand_counts_in_its_own_sense(margin, prior):
    assert failure_probability(margin, prior) <= failure_probability(margin) <= failure_probability(margin, -prior)


@given(MARGINS, st.floats(-1e4, 1e4))
def test_it_is_a_probability(margin, prior):
    assert LEAST_CLAIMED <= failure_probability(margin, prior) <= 1


def test_a_prior_settles_a_tie():
    assert failure_probability(0.0, prior=12.0) < 0.001


def test_odds_beforehand_multiply_the_odds():
    margins = np.linspace(1, 10, 10)
    for p, q in zip(map(failure_probability, margins), (failure_probability(m, 2.0) for m in margins), strict=True):
        assert p / (1 - p) == pytest.approx(q / (1 - q) * np.exp(2.0))
