"""Whether the judge's word can be taken: predicted against observed failure, over files of trials.

    python -m benchmarks.calibration ordinary.csv hard.csv identity.csv

Reads what `benchmarks.accuracy --out` wrote. A trial with the verdict `failed` claims no placement and counts apart.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Sequence
from itertools import pairwise

from benchmarks.given import trials_given
from benchmarks.starts import GROUPS
from benchmarks.table import percent, table
from treereg_core.evaluation import Trial
from treereg_core.options import Options
from treereg_core.statistics import upper_bound, wilson

EDGES = (0.0, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0)
"""Each bin holds its lower edge, the last its upper edge too."""
DEFAULT: float = Options.model_fields["max_failure"].default
LIMITS = (1e-6, 1e-5, 1e-4, DEFAULT, 1e-2, 0.1, 0.5)
"""What `--max-failure` might be."""


def main() -> int:
    """Print the four tables."""
    trials = trials_given("benchmarks.calibration", __doc__)
    placed = [trial for trial in trials if trial.verdict in ("accepted", "ambiguous")]
    print("Failure probability, predicted and observed\n")
    print(reliability(placed))
    print(f"\n{len(trials) - len(placed)} of {len(trials)} trials claim no placement.")
    print("\nAccepted and wrong\n")
    print(silence(trials))
    print("\nThe trade between flagged and wrong, had the limit of the failure probability been another\n")
    print(trade(placed))
    print("\nThe 95 % interval of the expected error, among right placements\n")
    print(coverage([trial for trial in placed if trial.right]))
    return 0


def reliability(trials: Sequence[Trial]) -> str:
    """The predicted failure probability in bins against the share of wrong placements."""
    rows = []
    for low, high in pairwise(EDGES):
        inside = [t for t in trials if low <= t.failure_probability < high or t.failure_probability == high == 1]
        wrong = sum(not t.right for t in inside)
        lower, upper = wilson(wrong, len(inside))
        predicted = statistics.fmean(t.failure_probability for t in inside) if inside else 0.0
        rows.append(
            (
                f"{low:g} to {high:g}",
                str(len(inside)),
                str(wrong),
                f"{predicted:.2g}" if inside else "-",
                f"{wrong / len(inside):.2g}" if inside else "-",
                f"{lower:.2g} to {upper:.2g}" if inside else "-",
                "-" if not inside else "yes" if lower <= predicted <= upper else "NO",
            )
        )
    return table(("predicted", "trials", "wrong", "mean", "observed", "95 % interval", "agrees"), rows)


def silence(trials: Sequence[Trial]) -> str:
    """How many accepted placements are wrong, and how many could be for all that was seen."""
    groups = list(dict.fromkeys(GROUPS[trial.name] for trial in trials))
    rows = []
    for name in (*groups, "all"):
        accepted = [t for t in trials if t.accepted and name in ("all", GROUPS[t.name])]
        wrong = sum(t.silent for t in accepted)
        bound = f"{100 * upper_bound(wrong, len(accepted)):.2f} %" if accepted else "-"
        rows.append((name, str(len(accepted)), str(wrong), bound))
    return table(("group", "accepted", "wrong", "at most, with 95 %"), rows)


def trade(placed: Sequence[Trial]) -> str:
    """For each limit of the failure probability how many right placements would be flagged, and wrong ones accepted."""
    groups = list(dict.fromkeys(GROUPS[trial.name] for trial in placed))
    rows = []
    for name in (*groups, "all"):
        some = [t for t in placed if name in ("all", GROUPS[t.name])]
        right = sum(t.right for t in some)
        for limit in LIMITS:
            accepted = [t for t in some if t.failure_probability <= limit]
            wrong = sum(not t.right for t in accepted)
            flagged = right - (len(accepted) - wrong)
            bound = f"{100 * upper_bound(wrong, len(accepted)):.2f} %" if accepted else "-"
            mark = " (default)" if limit == DEFAULT else ""
            cells = (str(right), str(flagged), percent(flagged, right), str(len(accepted)), str(wrong), bound)
            rows.append((name, f"{limit:g}{mark}", *cells))
    header = ("group", "limit", "right", "flagged", "of the right", "accepted", "wrong", "at most, with 95 %")
    return table(header, rows)


def coverage(right: Sequence[Trial]) -> str:
    """How often the interval holds the true error, by family."""
    names = [name for name in GROUPS if any(trial.name == name for trial in right)]
    plain = [trial for trial in right if trial.bend == 0]
    parts = [(name, [trial for trial in right if trial.name == name]) for name in names]
    rows = []
    for name, part in (*parts, ("all without distortion", plain)):
        inside = sum(t.covered for t in part)
        below, above = sum(t.error < t.ci_low for t in part), sum(t.error > t.ci_high for t in part)
        lower, upper = wilson(inside, len(part))
        rows.append(
            (
                name,
                str(len(part)),
                percent(inside, len(part)),
                f"{100 * lower:.1f} to {100 * upper:.1f} %",
                percent(below, len(part)),
                percent(above, len(part)),
            )
        )
    return table(("family", "right", "covered", "95 % interval", "error below", "error above"), rows)


if __name__ == "__main__":
    sys.exit(main())
