"""The Bayesian networks for people: their pictures, and what `docs/networks.md` says of their nodes and tables.

    python -m benchmarks.networks

Writes `docs/img/NAME.png` for each network, and the page anew between its marks `<!-- NAME -->` and `<!-- /NAME -->`;
the text around them is left as it is.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import treereg_bn_landmarks.network
import treereg_bn_landmarks.structure
import treereg_bn_rows.counts
import treereg_bn_rows.structure

from benchmarks.network_pictures import LAYOUTS, picture
from benchmarks.pages import filled, markdown
from treereg_core.network import Network, Node
from treereg_core.transform import FloatArray

DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "networks.md"
LONG = 12
"""Tables of more rows are folded away."""
EXAMPLE = {"offset": "under_0.1", "begin": "under_0.7", "end": "under_0.7"}
"""Signs of two rows, each after those it depends on: the page's example."""


@dataclass(frozen=True)
class Known:
    """A network, and for each node with a table what is known beforehand: counts by the parents' states and its own."""

    network: Network
    counts: Mapping[str, FloatArray]

    def probabilities(self, node: str) -> FloatArray:
        """The table of conditional probabilities: each row, over the node's own states, sums to 1."""
        counts = self.counts[node]
        return np.asarray(counts / counts.sum(axis=-1, keepdims=True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the pictures and the page."""
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.networks", description=__doc__, formatter_class=formatter
    )
    parser.parse_args(arguments)
    for name, known in networks().items():
        picture(known.network, LAYOUTS[name], DOCS / "img" / f"{name}.png")
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), contents()), encoding="utf-8")
    return 0


def networks() -> dict[str, Known]:
    """The networks of the plugins here, by the method's name."""
    return {
        "bn_rows": Known(treereg_bn_rows.structure.NETWORK, treereg_bn_rows.counts.prior()),
        "bn_landmarks": Known(treereg_bn_landmarks.structure.NETWORK, treereg_bn_landmarks.network.prior()),
    }


def contents() -> dict[str, str]:
    """What stands between the page's marks, by their names."""
    known = networks()
    texts = {name: "\n\n".join(section(name, one)) for name, one in known.items()}
    texts["example"] = example(known["bn_rows"], EXAMPLE)
    return texts


def section(name: str, known: Known) -> Iterator[str]:
    """Picture, nodes and tables of one network."""
    yield f"![The network of {name}: what depends on what](img/{name}.png)"
    yield markdown(("node", "what it is", "states", "depends on"), map(described, known.network.nodes))
    for node in known.network.nodes:
        if node.name in known.counts:
            yield f"### {name}: {node.name}"
            yield folded(table(known, node))


def described(node: Node) -> tuple[str, ...]:
    """A node's row in the table of nodes."""
    name = f"**`{node.name}`** (hidden)" if node.hidden else f"`{node.name}`"
    return name, node.about, ", ".join(node.states), ", ".join(f"`{parent}`" for parent in node.parents)


def table(known: Known, node: Node) -> list[str]:
    """The lines of a node's table, per cent: its parents' states in each row, a column for each of its own."""
    states = {each.name: each.states for each in known.network.nodes}
    share = known.probabilities(node.name).reshape(-1, len(node.states))
    seen = known.counts[node.name].sum(axis=-1).reshape(-1)
    given = itertools.product(*(states[parent] for parent in node.parents))
    rows = [
        (*parents, *map(per_cent, shares), "< 1" if count < 1 else f"{count:,.0f}")
        for parents, shares, count in zip(given, share.tolist(), seen.tolist(), strict=True)
    ]
    header = (*(f"`{parent}`" for parent in node.parents), *(f"**{state}**" for state in node.states), "seen")
    return markdown(header, rows, len(node.parents)).splitlines()


def folded(lines: list[str]) -> str:
    """A table as it is, or behind a line to be clicked where it is long."""
    text, rows = "\n".join(lines), len(lines) - 2
    return f"<details><summary>{rows} rows</summary>\n\n{text}\n\n</details>" if rows > LONG else text


def per_cent(share: float) -> str:
    """A probability without the sign, to a tenth; nothing that is possible looks impossible."""
    return "< 0.1" if 0 < share < 0.0005 else f"{100 * share:.1f}" if share else "0"


def example(known: Known, signs: Mapping[str, str]) -> str:
    """How often rows show these signs, those that are the same and others, and so how probable it is that they are."""
    states = {node.name: node.states for node in known.network.nodes}
    parents = {node.name: node.parents for node in known.network.nodes}
    rows, both = [], [1.0, 1.0]
    for sign, state in signs.items():
        given = [(parent, signs[parent]) for parent in parents[sign] if parent != "same"]
        at = tuple(states[name].index(value) for name, value in (*given, (sign, state)))
        shares = [float(table[at]) for table in known.probabilities(sign)]
        both = [so_far * share for so_far, share in zip(both, shares, strict=True)]
        where = f", where {' and '.join(f'`{name}` is {value}' for name, value in given)}" if given else ""
        rows.append((f"`{sign}` is {state}{where}", *(f"{100 * share:.1f} %" for share in shares)))
    rows.append(("all of it, multiplied", *(f"{100 * share:.1f} %" for share in both)))
    shown = markdown(("sign", "rows that are the same", "rows that are not"), rows, 1)
    yes, no = both
    answer = f"{100 * yes:.1f} / ({100 * yes:.1f} + {100 * no:.1f}) = {100 * yes / (yes + no):.0f} %"
    return f"{shown}\n\nSo the two rows are the same with a probability of {answer}."


if __name__ == "__main__":
    sys.exit(main())
