"""Calibration: from a margin of evidence to the probability that a placement is wrong, fitted to simulated trials."""

from __future__ import annotations

from scipy.special import expit, logit

# Around this margin a rival explains the trees as well.
TIED = 0.75
TIE_SLOPE = 6.0
# A placement that clearly beats its rivals is still wrong so often, less and less beyond this margin.
CHANCE = 0.015
TURN = 11.5
SLOPE = 0.5
# The curve goes on, but no trials that were run could tell smaller probabilities apart.
LEAST_CLAIMED = 1e-6


def failure_probability(margin: float, prior: float = 0.0) -> float:
    """The probability that a placement is wrong which beats a rival, or decoys, by `margin`.

    `margin` is `Comparison.margin`, natural log-odds that the evidence can bear; `prior` are log-odds for the
    placement that were known beforehand. Two things go wrong: a rival explains the trees as well, as on an exact
    lattice, and then the margin is about zero; or a placement was chosen among so many that one looks good by chance.
    """
    # Below zero the evidence speaks for the rival, and one nat is one nat.
    tied = float(expit(min(TIE_SLOPE * (TIED - margin), TIE_SLOPE * TIED - margin)))
    chance = CHANCE * float(expit(SLOPE * (TURN - margin)))
    wrong = min(max(tied + (1 - tied) * chance, 1e-300), 1 - 1e-15)
    return max(float(expit(float(logit(wrong)) - prior)), LEAST_CLAIMED)
