"""`treereg methods`: what is installed, and the settings of one method."""

from __future__ import annotations

import inspect
import json
import re
import textwrap
from dataclasses import asdict
from typing import Annotated, Any

import typer

from treereg_core.cli.columns import with_text
from treereg_core.cli.completion import names
from treereg_core.cli.console import Verbose, console, width
from treereg_core.cli.plugins import Plugin, use_plugins
from treereg_core.judge import Judge
from treereg_core.method import Method
from treereg_core.network import Network
from treereg_core.recipe import Recipe
from treereg_core.registry import Entry, installed
from treereg_core.settings import describe, range_in_words


def methods(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", autocompletion=names, help="One of them, or `judge`, to see its settings."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as JSON.")] = False,
    plugin: Plugin = None,
    verbose: Verbose = False,
) -> None:
    """List every installed method, recipe and evaluator; with NAME its settings, units, ranges, source and network."""
    use_plugins(context, plugin)
    registry = installed()
    if name is None:
        rows = [as_plain(entry) for entry in registry.entries]
        if as_json:
            typer.echo(json.dumps(rows, indent=1, ensure_ascii=False))
        else:
            console.show(table(registry.entries))
        return
    offer: type | Recipe | None = Judge
    row = judge_row()
    if name != "judge":
        entry = registry.entry(name)
        offer, row = entry.offer, as_plain(entry)
    if as_json:
        typer.echo(json.dumps(row, indent=1, ensure_ascii=False))
    else:
        console.show(page(offer, row))


def table(entries: tuple[Entry, ...]) -> str:
    """One line for each entry: name, role, distribution and version, what it is."""
    rows = [(e.name, "BROKEN" if e.problem else e.role, e.origin, e.description) for e in entries]
    if not rows:
        return "no methods are installed; install them with: pip install 'treereg[all]'"
    return "\n".join(with_text(rows, width()))


def as_plain(entry: Entry) -> dict[str, Any]:
    """An entry as plain values."""
    row: dict[str, Any] = {
        "name": entry.name,
        "role": entry.role,
        "distribution": entry.distribution,
        "version": entry.version,
        "description": entry.description,
        "problem": entry.problem,
    }
    if isinstance(entry.offer, Recipe):
        return {**row, "expression": entry.offer.expression, "settings": dict(entry.offer.settings)}
    if entry.offer is None:
        return row
    models = [model.value for model in sorted(entry.offer.models, key=lambda model: model.parameters)]
    row |= {"source": source_of(entry.offer), "models": models, "settings": describe(entry.offer)}
    return {**row, "network": asdict(entry.offer.network) if entry.offer.network else None}


def judge_row() -> dict[str, Any]:
    """The judge in the same words as a method."""
    first = (inspect.getdoc(Judge) or "").partition("\n")[0]
    return {"name": "judge", "role": "judge", "description": first, "settings": describe(Judge)}


def source_of(offer: type[Method]) -> str | None:
    """The source papers that a docstring names, by DOI; None without one."""
    found = [doi.rstrip(".,:;)") for doi in re.findall(r"doi:(10\.\S+)", inspect.getdoc(offer) or "")]
    return ", ".join(f"https://doi.org/{doi}" for doi in dict.fromkeys(found)) or None


def page(offer: type | Recipe | None, row: dict[str, Any]) -> str:
    """Everything about one method, for people."""
    origin = f", {row['distribution']} {row['version']}" if row.get("distribution") else ""
    parts = [f"{row['name']}: {row['role']}{origin}", ""]
    if isinstance(offer, Recipe):
        parts += [row["description"], "", f"stands for {row['expression']}"]
        parts += [f"  {stage}.{k} = {v}" for stage, values in offer.settings.items() for k, v in values.items()]
        return "\n".join(parts)
    parts.append(inspect.getdoc(offer) or "")
    if row.get("source"):
        parts += ["", f"Source: {row['source']}"]
    if row.get("models"):
        parts += ["", f"Models: {', '.join(row['models'])}"]
    parts += ["", "Settings:" if row["settings"] else "No settings."]
    for name, setting in row["settings"].items():
        unit = f" {setting['unit']}" if "unit" in setting else ""
        allowed = range_in_words(setting)
        kind = setting.get("type", "value") if "enum" not in setting else "choice"
        default = json.dumps(setting.get("default"), ensure_ascii=False)
        parts.append(f"  {row['name']}.{name} = {default}{unit}  ({kind}{'; ' + allowed if allowed else ''})")
        parts += textwrap.wrap(setting.get("description", ""), 110, initial_indent="      ", subsequent_indent="      ")
    if isinstance(offer, type) and issubclass(offer, Method) and offer.network:
        parts += ["", "Network, each node after those it depends on:", *drawn(offer.network)]
    return "\n".join(parts)


def drawn(network: Network) -> list[str]:
    """The lines of a network: of each node what it is, its states, and what it depends on."""
    names = [f"{node.name} (hidden)" if node.hidden else node.name for node in network.nodes]
    indent = 4 + max(map(len, names))
    lines = []
    for name, node in zip(names, network.nodes, strict=True):
        texts = [node.about, f"states: {', '.join(node.states)}"]
        texts += [f"depends on: {', '.join(node.parents)}"] if node.parents else []
        wrapped = [part for text in texts for part in textwrap.wrap(text, 116 - indent, subsequent_indent="  ")]
        lines += [f"  {name}".ljust(indent) + wrapped[0], *(" " * indent + part for part in wrapped[1:])]
    return lines
