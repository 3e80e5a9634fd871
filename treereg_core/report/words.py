"""What a run found, in a sentence that a grower understands."""

from __future__ import annotations

from treereg_core.judgement import Judgement, Verdict

LEAST_CHANCE = 1e-6
LEAST_LENGTH_M = 0.001


def headline(judgement: Judgement) -> str:
    """The verdict in a few words."""
    return {
        Verdict.ACCEPTED: "The two surveys fit together",
        Verdict.AMBIGUOUS: "More than one fit is possible",
        Verdict.FAILED: "The two surveys could not be fitted together",
    }[judgement.verdict]


def sentence(judgement: Judgement) -> str:
    """The verdict and what may be done with it."""
    if judgement.expected_error is None:
        return (
            "No way of laying one survey on the other makes its trees meet, so nothing was moved; check that both show "
            "the same orchard."
        )
    error = distance(judgement.expected_error.rms)
    if judgement.verdict is Verdict.ACCEPTED:
        return (
            f"The surveys now lie on each other tree on tree: expect each tree within {error} of where it belongs. The "
            f"chance that they lie a whole tree or row off is {chance(judgement.failure_probability)}."
        )
    return (
        "The trees do not tell which of several places is the right one (the chance that this one is wrong is "
        f"{chance(judgement.failure_probability)}), so do not use it before you have compared it with the rivals below."
    )


def distance(metres: float) -> str:
    """A length in the unit that people would use."""
    if metres < LEAST_LENGTH_M:
        return "a millimetre"
    return f"about {100 * metres:.1f} cm" if metres < 1 else f"about {metres:.1f} m"


def chance(probability: float) -> str:
    """A probability in words: a small one as one in so many."""
    if probability > 0.05:
        return f"{100 * probability:.0f} %"
    if probability < LEAST_CHANCE:
        return "less than 1 in a million"
    return f"1 in {float(f'{1 / probability:.1g}'):,.0f}"
