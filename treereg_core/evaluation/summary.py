"""Summary: what trials say together, method by method and start by start, with how far it could be due to chance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from treereg_core.evaluation.case import RIGHT_M
from treereg_core.evaluation.trial import CRASHED, Trial
from treereg_core.evaluators import MILESTONES
from treereg_core.statistics import bootstrap, median, percentile_95, upper_bound, wilson

ALL = "all"
"""The name under which the trials of all names are summed up."""
PLACED = "truth.placed"
FEWEST, AGREE = 5, 0.1
"""So many accepted placements say that files are off when their errors differ by less than this share of them."""


@dataclass(frozen=True)
class Share:
    """So many of so many, with its 95 % interval (Wilson)."""

    count: int
    of: int

    @property
    def ci95(self) -> tuple[float, float]:
        """The interval, shares."""
        return wilson(self.count, self.of)

    def to_json(self) -> dict[str, Any]:
        """Plain values; the share is null where there is nothing to share."""
        return {
            "count": self.count,
            "of": self.of,
            "share": self.count / self.of if self.of else None,
            "ci95": self.ci95,
        }


@dataclass(frozen=True)
class Typical:
    """A median and a 95th percentile, each with its 95 % interval (bootstrap); None without values."""

    median: float
    median_ci95: tuple[float, float]
    p95: float
    p95_ci95: tuple[float, float]

    @classmethod
    def of(cls, values: Sequence[float]) -> Typical | None:
        """Of the values that are there."""
        given = np.array([value for value in values if math.isfinite(value)])
        if not len(given):
            return None
        return cls(
            float(median(given)), bootstrap(given, median), float(percentile_95(given)), bootstrap(given, percentile_95)
        )


@dataclass(frozen=True)
class Line:
    """What the trials of one method and start say, of one name or of all.

    - `right`: with an error below 0.5 m, or 1.25 times that of the fit with the true pairs.
    - `silent`: accepted though wrong; `silent_at_most` is the 95 % upper bound of its share among the accepted.
    - `flagged`: of the right, not accepted; `failed`: without a placement; `crashed`: a fault of the code.
    - `covered`: of the right, those in which the 95 % interval of the expected error holds the true one.
    - `error`: metres, over all trials with a placement; `ratio`: its median over that of the fit with the true pairs,
      both over the right; None where that is not known.
    - `milestones`: trials in which such a share of the trees, or more, was placed within half a tree spacing.
    - `figures`: the median of each evaluator's figure over the trials that have it; `seconds`: median, one thread.
    """

    method: str
    start: str
    name: str
    trials: int
    right: Share
    silent: int
    silent_at_most: float
    flagged: Share
    failed: Share
    covered: Share
    crashed: int
    error: Typical | None
    ratio: float | None
    milestones: Mapping[float, Share]
    figures: Mapping[str, float]
    seconds: float | None

    @classmethod
    def of(cls, trials: Sequence[Trial], name: str) -> Line:
        """Of trials of one method and start, one at least."""
        right = [trial for trial in trials if trial.right]
        accepted = sum(trial.accepted for trial in trials)
        silent = sum(trial.silent for trial in trials)
        fits = [trial.fit_error for trial in right if math.isfinite(trial.fit_error)]
        placed = [trial.figures[PLACED] for trial in trials if math.isfinite(trial.figures.get(PLACED, math.nan))]
        seconds = [trial.seconds for trial in trials if math.isfinite(trial.seconds)]
        return cls(
            method=trials[0].method,
            start=trials[0].start,
            name=name,
            trials=len(trials),
            right=Share(len(right), len(trials)),
            silent=silent,
            silent_at_most=upper_bound(silent, accepted),
            flagged=Share(sum(not trial.accepted for trial in right), len(right)),
            failed=Share(sum(trial.verdict == "failed" for trial in trials), len(trials)),
            covered=Share(sum(trial.covered for trial in right), len(right)),
            crashed=sum(trial.verdict == CRASHED for trial in trials),
            error=Typical.of([trial.error for trial in trials]),
            ratio=float(np.median([t.error for t in right]) / np.median(fits)) if fits else None,
            milestones={m: Share(sum(share >= m for share in placed), len(placed)) for m in MILESTONES},
            figures=dict(_medians(trials)),
            seconds=float(np.median(seconds)) if seconds else None,
        )

    def to_json(self) -> dict[str, Any]:
        """Plain values, every number finite or null."""
        error = self.error
        return {
            "method": self.method,
            "start": self.start,
            "name": self.name,
            "trials": self.trials,
            "right": self.right.to_json(),
            "silently_wrong": {"count": self.silent, "share_at_most": self.silent_at_most},
            "flagged_though_right": self.flagged.to_json(),
            "failed": self.failed.to_json(),
            "interval_holds_error": self.covered.to_json(),
            "crashed": self.crashed,
            "error_m": error
            and {
                "median": error.median,
                "median_ci95": error.median_ci95,
                "p95": error.p95,
                "p95_ci95": error.p95_ci95,
            },
            "error_over_best_fit": self.ratio,
            "milestones": {f"{milestone:.2f}": share.to_json() for milestone, share in self.milestones.items()},
            "figures_median": dict(self.figures),
            "seconds_median": self.seconds,
        }


def _medians(trials: Sequence[Trial]) -> Iterator[tuple[str, float]]:
    for name in dict.fromkeys(name for trial in trials for name in trial.figures):
        values = [trial.figures[name] for trial in trials if math.isfinite(trial.figures.get(name, math.nan))]
        if values:
            yield name, float(np.median(values))


def not_in_place(trials: Sequence[Trial]) -> str | None:
    """A sentence when the accepted placements agree with each other but not with the files; None otherwise."""
    errors = [trial.error for trial in trials if trial.accepted and math.isfinite(trial.error)]
    if len(errors) < FEWEST:
        return None
    low, middle, high = np.quantile(errors, (0.1, 0.5, 0.9)).tolist()
    if middle < RIGHT_M or high - low > AGREE * middle:
        return None
    return (
        f"The accepted placements agree with each other, but all lie {middle:.2f} m from where the files have the "
        "surveys, which so do not lie rightly on each other: register them first (treereg run), move the source with "
        "treereg apply, and evaluate that."
    )


def summed_up(trials: Iterable[Trial]) -> list[Line]:
    """A line for every method, start and name, and one for all names where there are several."""
    groups: dict[tuple[str, str], dict[str, list[Trial]]] = {}
    for trial in trials:
        groups.setdefault((trial.method, trial.start), {}).setdefault(trial.name, []).append(trial)
    lines = []
    for by_name in groups.values():
        lines += [Line.of(some, name) for name, some in by_name.items()]
        if len(by_name) > 1:
            lines.append(Line.of([trial for some in by_name.values() for trial in some], ALL))
    return lines
