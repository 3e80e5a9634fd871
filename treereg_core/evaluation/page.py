"""The page of an evaluation: evaluation.html, one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from treereg_core.evaluation import plots
from treereg_core.evaluation.summary import ALL, Line, Share
from treereg_core.evaluation.trial import Trial

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --faint: #d5d5d5; --ground: #fff; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --faint: #444; --ground: #161616; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--ground);
  max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.9rem; }
th, td { padding: 0.25rem 0.7rem; border-bottom: 1px solid var(--faint); text-align: right; white-space: nowrap; }
th:first-child, td:first-child, td:nth-child(2), th:nth-child(2) { text-align: left; }
tr.all td { font-weight: 600; }
svg { width: 100%; max-width: 44rem; height: auto; display: block; }
svg text { fill: var(--ink); font-size: 13px; }
svg .grid { stroke: var(--faint); }
ul.key { list-style: none; padding: 0; display: flex; flex-wrap: wrap; gap: 0.2rem 1.2rem; }
ul.key svg { width: 2.2rem; display: inline-block; vertical-align: middle; margin-right: 0.4rem; }
small { color: inherit; opacity: 0.75; }
@media print { body { max-width: none; } }
"""
LEGEND = (
    "In brackets 95 % intervals: Wilson for shares, bootstrap for errors. Right: an error below 0.5 m, or 1.25 times "
    "that of the fit with the true pairs where these are known. Silent: accepted though wrong, with the 95 % "
    "upper bound of its share among the accepted. Flagged: right, but not accepted. Errors are of all trials with a "
    "placement, wrong ones too. Coverage: how often, among the right, the 95 % interval of the expected error holds "
    "the true one."
)
HEADER = (
    *("method and start", "trials of", "trials", "right", "silent", "flagged", "failed"),
    *("median error", "95th percentile", "error / best fit", "coverage", "seconds"),
)


def page(title: str, notes: Sequence[str], trials: Sequence[Trial], lines: Sequence[Line]) -> str:
    """The page of these trials: what was done (`notes`, a sentence each), the table of lines, and the plots."""
    several = len({line.name for line in lines} - {ALL}) > 1
    whole = [line for line in lines if line.name == ALL or not several]
    by_label: dict[str, list[Trial]] = {}
    for trial in trials:
        by_label.setdefault(label(trial), []).append(trial)
    truth = [(name, [t for t in some if t.misplaced == t.misplaced]) for name, some in by_label.items()]
    key = "".join(key_entry(name, k) for k, name in enumerate(by_label))
    parts = [
        f"<h1>{escape(title)}</h1>",
        *(f"<p>{escape(note)}</p>" for note in notes),
        f'<div class="wide"><table><thead><tr>{cells(HEADER, "th")}</tr></thead>',
        f"<tbody>{''.join(map(row, lines))}</tbody></table></div>",
        f"<p><small>{escape(LEGEND)}</small></p>",
        f'<ul class="key">{key}</ul>',
        "<h2>Errors</h2>",
        plots.error_distributions([(name, [t.error for t in some]) for name, some in truth]),
        "<h2>Success against misregistration</h2>",
        plots.success([(name, [(t.misplaced, t.right) for t in some]) for name, some in truth]),
        "<h2>Milestones</h2>",
        plots.milestones([(label(line), list(line.milestones.items())) for line in whole]),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )


def label(of: Trial | Line) -> str:
    """How a method and start are called."""
    return f"{of.method} from {of.start}"


def key_entry(name: str, k: int) -> str:
    """A label with its colour and dashes."""
    line = plots.polyline([(0, 6), (36, 6)], k)
    return f'<li><svg viewBox="0 0 36 12" aria-hidden="true">{line}</svg>{escape(name)}</li>'


def row(line: Line) -> str:
    """A line of the table."""
    error = line.error
    values = (
        *(label(line), line.name, str(line.trials), in_words(line.right), silent_in_words(line)),
        *(in_words(line.flagged), in_words(line.failed)),
        f"{error.median:.3f} m [{error.median_ci95[0]:.3f}, {error.median_ci95[1]:.3f}]" if error else "-",
        f"{error.p95:.3f} m [{error.p95_ci95[0]:.3f}, {error.p95_ci95[1]:.3f}]" if error else "-",
        f"{line.ratio:.2f}" if line.ratio is not None else "-",
        in_words(line.covered),
        f"{line.seconds:.2f}" if line.seconds is not None else "-",
    )
    return f"<tr{' class=all' if line.name == ALL else ''}>{cells(values, 'td')}</tr>"


def cells(values: Sequence[str], tag: str) -> str:
    """Cells of a table."""
    return "".join(f"<{tag}>{escape(value)}</{tag}>" for value in values)


def in_words(share: Share) -> str:
    """A share with its interval."""
    if not share.of:
        return "-"
    low, high = share.ci95
    return f"{100 * share.count / share.of:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def silent_in_words(line: Line) -> str:
    """How many are wrong in silence, and how many of the accepted ones could be for all that was seen."""
    return f"{line.silent} (at most {100 * line.silent_at_most:.2f} %)"
