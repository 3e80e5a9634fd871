"""Pictures of Bayesian networks: a box for each node, an arrow from what a node depends on to the node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.row_pictures import DOTS_PER_INCH, save
from treereg_core.network import Network

Point = tuple[float, float]

HIDDEN: dict[str, Any] = {"facecolor": "#fde3b0", "edgecolor": "#a05a00", "linewidth": 2.0, "linestyle": (0, (4, 2))}
EVIDENCE: dict[str, Any] = {"facecolor": "#e3eef8", "edgecolor": "#1f4e79", "linewidth": 1.2, "linestyle": "solid"}
"""Told apart by the outline too, for those who see colours otherwise."""
ARROW: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 13, "color": "#444444", "zorder": 0.5}
HEIGHT, LETTER, MARGIN = 0.46, 0.115, 0.9
"""Height of a box, what a letter adds to its width, and what is left around; inches."""


@dataclass(frozen=True)
class Layout:
    """Where the nodes stand, inches, x to the right and y up; which arrows are bent, and how much (to the left < 0)."""

    places: Mapping[str, Point]
    bends: Mapping[tuple[str, str], float] = field(default_factory=dict)


ROWS = Layout(
    {
        "same": (4.0, 2.3),
        "direction": (2.3, 4.2),
        "offset": (5.7, 4.2),
        "field": (7.6, 3.2),
        "context": (7.6, 1.4),
        "gaps": (6.0, 0.2),
        "trees": (4.2, 0.0),
        "length": (2.0, 0.2),
        "end": (0.6, 1.5),
        "begin": (0.6, 3.1),
    },
    {("begin", "length"): 0.75},
)
LANDMARKS = Layout(
    {
        "surroundings": (0.8, 4.2),
        "row": (3.0, 4.2),
        "place": (4.7, 4.2),
        "agreement": (7.3, 4.2),
        "real": (2.4, 2.5),
        "landmark": (6.0, 2.5),
        "earlier": (4.9, 1.45),
        "confidence": (0.8, 0.1),
        "size": (3.2, 0.5),
        "partner": (6.7, 0.5),
        "their": (8.6, -0.5),
    }
)
LAYOUTS = {"bn_rows": ROWS, "bn_landmarks": LANDMARKS}


def picture(network: Network, layout: Layout, path: Path) -> None:
    """Write the picture of a network as PNG."""
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Patch

    x, y = zip(*layout.places.values(), strict=True)
    low, high = (min(x) - MARGIN, min(y) - MARGIN), (max(x) + MARGIN, max(y) + HEIGHT)
    figure = Figure(figsize=(high[0] - low[0], high[1] - low[1]), dpi=DOTS_PER_INCH)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    boxes = {}
    for node in network.nodes:
        at, width = layout.places[node.name], 0.3 + LETTER * len(node.name)
        corner, style = (at[0] - width / 2, at[1] - HEIGHT / 2), HIDDEN if node.hidden else EVIDENCE
        boxes[node.name] = FancyBboxPatch(corner, width, HEIGHT, boxstyle="round,pad=0,rounding_size=0.1", **style)
        axes.add_patch(boxes[node.name])
        axes.text(*at, node.name, ha="center", va="center", fontsize=11, weight="bold" if node.hidden else "normal")
    for parent, name in ((parent, node.name) for node in network.nodes for parent in node.parents):
        arrow = FancyArrowPatch(
            layout.places[parent],
            layout.places[name],
            patchA=boxes[parent],
            patchB=boxes[name],
            connectionstyle=f"arc3,rad={layout.bends.get((parent, name), 0)}",
            shrinkB=2,
            **ARROW,
        )
        axes.add_patch(arrow)
    kinds = [Patch(label="hidden: the network says how probable it is", **HIDDEN), Patch(label="evidence", **EVIDENCE)]
    axes.legend(handles=kinds, loc="lower center", ncols=2, frameon=False, fontsize=10)
    save(axes, path)
