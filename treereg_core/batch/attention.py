"""What a person should look at first: what was not accepted, then what was and is unlike the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from treereg_core.batch.outcome import Outcome, Word

URGENCY = (Word.CRASHED, Word.MEMORY, Word.TIMEOUT, Word.UNUSABLE, Word.FAILED, Word.AMBIGUOUS)
FEWEST = 10
"""Among fewer accepted orchards none is called unlike the others."""
LIMIT = 3.5
"""Modified z-scores beyond it are outliers (Iglewicz and Hoaglin 1993, How to Detect and Handle Outliers)."""

Figure = Callable[[Outcome], float | None]
UNUSUAL: tuple[tuple[str, int, Figure], ...] = (
    ("a high expected error ({:.3f} m)", 1, lambda o: o.expected_error),
    ("few trees matched ({:.0%})", -1, lambda o: o.share),
    ("matched trees far apart ({:.2f} m)", 1, lambda o: o.residual_rms),
    ("moved far ({:.2f} m)", 1, lambda o: o.shift),
    ("turned far ({:.2f}°)", 1, lambda o: None if o.rotation_deg is None else abs(o.rotation_deg)),
)
"""What is said of an outlier, on which side it lies, and the figure."""


def first_to_look_at(outcomes: Sequence[Outcome]) -> list[tuple[Outcome, str]]:
    """Outcomes that want a look, the most urgent first, each with why.

    First those that were not accepted, crashes before verdicts; then accepted ones of which a figure is an
    outlier among the accepted, the highest expected error first.
    """
    others = [outcome for outcome in outcomes if outcome.verdict in URGENCY]
    first = [(outcome, outcome.reason) for outcome in sorted(others, key=lambda o: URGENCY.index(o.verdict))]
    accepted = [outcome for outcome in outcomes if outcome.verdict is Word.ACCEPTED]
    odd = [(outcome, "; ".join(said)) for outcome, said in zip(accepted, _said(accepted), strict=True) if said]
    return first + sorted(odd, key=lambda entry: -(entry[0].expected_error or 0.0))


def _said(accepted: Sequence[Outcome]) -> list[list[str]]:
    """What is unusual about each."""
    said: list[list[str]] = [[] for _ in accepted]
    for words, side, figure in UNUSUAL:
        values = np.array([np.nan if (value := figure(outcome)) is None else value for outcome in accepted])
        known = values[np.isfinite(values)]
        if len(known) < FEWEST:
            continue
        middle = np.median(known)
        deviation = np.median(np.abs(known - middle))
        if deviation > 0:
            for k in np.flatnonzero(0.6745 * side * (values - middle) / deviation > LIMIT):
                said[k].append(words.format(values[k]))
    return said
