"""The files of a batch beside the folders of its orchards: summary.csv and summary.html."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

from treereg_core import io
from treereg_core.batch.attention import first_to_look_at
from treereg_core.batch.order import Order
from treereg_core.batch.outcome import JUDGED, Outcome, Word
from treereg_core.outputs import REGISTRATION
from treereg_core.page import cells, document, made_by

SUMMARY, PAGE = FILES = ("summary.csv", "summary.html")
COLUMNS = (*(field.name for field in fields(Outcome)), "reference", "source")
REPORT = "report.html"
HEADER = (
    *("orchard", "verdict", "expected error", "failure probability", "matched", "apart", "moved", "turned"),
    "seconds",
)


def write_summary(orders: Sequence[Order], outcomes: Sequence[Outcome], folder: Path) -> None:
    """Write both files, each complete or not at all, of orders and their outcomes in the same order."""
    io.write_text(folder / SUMMARY, summary_csv(orders, outcomes))
    io.write_text(folder / PAGE, page(orders, outcomes))


def summary_csv(orders: Sequence[Order], outcomes: Sequence[Outcome]) -> str:
    """A row for each orchard, in the order of the manifest; empty cells where there is no figure."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for order, outcome in zip(orders, outcomes, strict=True):
        row = {**vars(outcome), "verdict": outcome.verdict.value, "warnings": " ".join(outcome.warnings)}
        writer.writerow([_cell(value) for value in (*row.values(), order.reference, order.source)])
    return text.getvalue()


def _cell(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def page(orders: Sequence[Order], outcomes: Sequence[Outcome]) -> str:
    """The page: how many of each verdict, what to look at first and why, and a table of all."""
    folders = {order.orchard: order.folder for order in orders}
    first = first_to_look_at(outcomes)
    looks = "".join(
        f"<tr><td>{link(outcome, folders[outcome.orchard])}</td>{cells([outcome.verdict.value], 'td')}"
        f'<td class="words">{escape(why)}</td></tr>'
        for outcome, why in first
    )
    table = "".join(
        f"<tr><td>{link(outcome, folders[outcome.orchard])}</td>{cells(figures(outcome), 'td')}</tr>"
        for outcome in outcomes
    )
    return document(
        "Batch of registrations",
        [
            f"<p>{escape(counted(outcomes))}.</p>",
            "<h2>To look at first</h2>",
            f'<div class="wide"><table><thead><tr>{cells(("orchard", "verdict"), "th")}<th class="words">why</th>'
            f"</tr></thead><tbody>{looks}</tbody></table></div>"
            if first
            else "<p>All were accepted, and none is unlike the others.</p>",
            "<h2>All orchards</h2>",
            f'<div class="wide"><table><thead><tr>{cells(HEADER, "th")}</tr></thead>',
            f"<tbody>{table}</tbody></table></div>",
            f"<p><small>{escape(made_by(orders[0].work.plugins))}</small></p>",
        ],
    )


def counted(outcomes: Sequence[Outcome]) -> str:
    """How many orchards there are, and of each verdict."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    return f"{len(outcomes)} orchards: " + ", ".join(f"{counts[word]} {word.value}" for word in Word if counts[word])


def link(outcome: Outcome, folder: Path) -> str:
    """The orchard's name, as a link to its report or, without one, to its registration."""
    names = [name for name in (REPORT, REGISTRATION) if outcome.verdict in JUDGED and (folder / name).exists()]
    name = escape(outcome.orchard)
    return f'<a href="{quote(outcome.orchard)}/{names[0]}">{name}</a>' if names else name


def figures(outcome: Outcome) -> tuple[str, ...]:
    """The cells of the table, the orchard's name apart."""

    def told(value: float | None, form: str, unit: str = "") -> str:
        return "-" if value is None else f"{value:{form}}{unit}"

    share = "" if outcome.share is None else f" ({outcome.share:.0%})"
    return (
        outcome.verdict.value,
        told(outcome.expected_error, ".3f", " m"),
        told(outcome.failure_probability, ".2g"),
        told(outcome.matched, "d") + share,
        told(outcome.residual_rms, ".2f", " m"),
        told(outcome.shift, ".2f", " m"),
        told(outcome.rotation_deg, "+z.2f", "°"),
        told(outcome.seconds, ".1f"),
    )
