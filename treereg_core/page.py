"""Pages for people: one HTML file each that needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.metadata import version

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
td.words, th.words { text-align: left; white-space: normal; }
a { color: inherit; }
svg { width: 100%; max-width: 44rem; height: auto; display: block; }
svg text { fill: var(--ink); font-size: 13px; }
svg .grid { stroke: var(--faint); }
ul.key { list-style: none; padding: 0; display: flex; flex-wrap: wrap; gap: 0.2rem 1.2rem; }
ul.key svg { width: 2.2rem; display: inline-block; vertical-align: middle; margin-right: 0.4rem; }
small { color: inherit; opacity: 0.75; }
@media print { body { max-width: none; } }
"""


def document(title: str, parts: Sequence[str]) -> str:
    """The page of this title, with these parts, which are HTML."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>\n"
        + "\n".join([f"<h1>{escape(title)}</h1>", *parts])
        + "\n</body></html>\n"
    )


def cells(values: Sequence[str], tag: str) -> str:
    """Cells of a table."""
    return "".join(f"<{tag}>{escape(value)}</{tag}>" for value in values)


def made_by(plugins: Mapping[str, str]) -> str:
    """A sentence with every distribution whose code was run; `plugins` are those of methods, by name."""
    distributions = dict.fromkeys([f"treereg {version('treereg')}", *plugins.values()])
    return f"Made by {', '.join(distributions)}."
