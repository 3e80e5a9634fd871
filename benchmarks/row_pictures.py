"""Pictures of rows: detected against true ones, and the numbered rows of a real survey over its canopies."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.edges import Edge, Edges, whole_trees
from treereg_core.features import FeatureSet
from treereg_core.pair import Rows
from treereg_core.simulate import Simulation
from treereg_core.survey import Survey
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"neither": "#c4c4c4", "right": "#1b9e3a", "missed": "#1f5fe0", "wrong": "#e0201b"}
"""As in Simons 2020, in the order in which they are drawn."""
ROW_COLOURS = ("#1b9e77", "#d95f02", "#7570b3", "#e7298a", "#1f78b4", "#a6761d")
SIDE_INCHES, DOTS_PER_INCH, PALETTE = 7.0, 130, 64


def against_truth(simulation: Simulation, edges: Edges, title: str, path: Path) -> None:
    """The reference's edges in their colours; single whole trees as dots, other detections as rings."""
    survey = simulation.reference
    axes = axes_over(survey, title)
    for kind, colour in COLOURS.items():
        found: frozenset[Edge] = getattr(edges, kind)
        draw(axes, survey, found, colour)
        axes.plot([], [], color=colour, label=f"{kind} {len(found)}")
    whole = whole_trees(simulation.reference_trees) >= 0
    x, y = survey.xy.T
    axes.scatter(x[whole], y[whole], s=2.5, color="black", linewidths=0, zorder=3)
    axes.scatter(x[~whole], y[~whole], s=7, facecolors="none", edgecolors="#777777", linewidths=0.5, zorder=3)
    axes.legend(loc="upper left", bbox_to_anchor=(0, 0), ncols=4, frameon=False, fontsize=8, handlelength=1.2)
    save(axes, path)


def over_canopies(survey: Survey, rows: Rows, title: str, path: Path) -> None:
    """Numbered rows in changing colours over the outlines of a survey's canopies."""
    from matplotlib.collections import LineCollection

    features = survey.features
    axes = axes_over(features, title)
    axes.add_collection(LineCollection(outlines(survey), colors="#bbbbbb", linewidths=0.4))
    for number, row in enumerate(rows.trees, 1):
        colour = ROW_COLOURS[number % len(ROW_COLOURS)]
        xy = features.xy[features.positions(row)]
        axes.plot(*xy.T, color=colour, linewidth=1.1, zorder=2)
        ahead = xy[0] + (xy[0] - xy[1]) / np.hypot(*(xy[0] - xy[1])) * features.spacing / 2
        axes.annotate(str(number), ahead, color=colour, fontsize=7, ha="center", va="center", zorder=4)
    axes.scatter(features.xy[:, 0], features.xy[:, 1], s=2, color="black", linewidths=0, zorder=3)
    save(axes, path)


def outlines(survey: Survey) -> list[FloatArray]:
    """The outer rings of a survey's canopies in its frame, each (k, 2) metres."""
    import shapely

    from treereg_core.io.crs import to_frame
    from treereg_core.io.layer import read_layer

    layer = read_layer(survey.detections)
    polygons = shapely.get_parts(layer.geometry[survey.features.ids])
    return [to_frame(shapely.get_coordinates(shapely.get_exterior_ring(p)), layer.crs, survey.frame) for p in polygons]


def axes_over(features: FeatureSet, title: str) -> Axes:
    """Axes in the survey's frame, true to scale."""
    from matplotlib.figure import Figure

    low, high = features.xy.min(axis=0) - features.spacing, features.xy.max(axis=0) + features.spacing
    size = SIDE_INCHES * (high - low) / (high - low).max()
    axes = Figure(figsize=(max(size[0], 4), size[1]), dpi=DOTS_PER_INCH, layout="tight").add_subplot()
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_title(title, fontsize=9)
    axes.set_axis_off()
    return axes


def draw(axes: Axes, survey: FeatureSet, edges: Iterable[Edge], colour: str) -> None:
    """Draw edges."""
    from matplotlib.collections import LineCollection

    ends = survey.positions(np.array(sorted(edges), dtype=np.int64).reshape(-1, 2))
    axes.add_collection(LineCollection(list(survey.xy[ends]), colors=colour, linewidths=1.3))


def save(axes: Axes, path: Path) -> None:
    """Write the picture as PNG, in few colours so that it stays small."""
    from PIL import Image

    figure = axes.get_figure(root=True)
    assert figure is not None
    whole = BytesIO()
    figure.savefig(whole, bbox_inches="tight", pad_inches=0.05)
    image = Image.open(whole).convert("RGB")
    image.quantize(PALETTE, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)
