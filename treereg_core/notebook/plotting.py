"""Plots of a result with matplotlib: the canopies of both surveys before and after, and what is left between pairs."""

from __future__ import annotations

import textwrap
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import UsageError
from treereg_core.features import BoolArray
from treereg_core.notebook.scene import Scene
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from treereg_core.result import Result

COLOURS = ("#0072B2", "#D55E00")
"""Reference and source, told apart by colour-blind eyes (Wong 2011, doi:10.1038/nmeth.1618)."""
LIGHT, DARK = 0.18, 0.5
"""How opaque crowns are, with a partner and without."""
SIZE_INCHES = (8.0, 7.5)
LEGEND_POINTS = -38
"""The legend's place, below the lower left corner of the axes."""
ARROWS = 40
"""Residuals are enlarged until so many of the longer ones would reach across the plot."""
TITLE = 60
"""Letters on a line of a title."""
LEAST_M = 1e-6
"""Shorter residuals are rounding, and not drawn."""


class Show(Enum):
    """What a plot shows: the canopies `after` registration or `before` it, or the `residuals` of the matched pairs."""

    AFTER = "after"
    BEFORE = "before"
    RESIDUALS = "residuals"


def plot(result: Result, show: str, ax: Axes | None, width_m: float | None) -> Axes:
    """Draw a result; see `Result.plot`."""
    wanted = _chosen(show)
    low, high = _window(Scene.of(result), width_m)
    axes = _axes() if ax is None else ax
    scene = Scene.of(result, before=wanted is Show.BEFORE)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    if wanted is Show.RESIDUALS:
        _draw_residuals(axes, scene, float((high - low).max()))
    elif wanted is Show.AFTER and result.transform is not None:
        _draw_pairs(axes, scene)
    else:
        for side, name in enumerate(("reference", "source, as georeferenced")):
            _draw_crowns(axes, scene, side, f"{name}: {len(scene.trees[side]):,}", LIGHT)
    _finish(axes, result.frame.crs if result.frame else None)
    axes.set_title(_title(result, wanted), loc="left", fontsize="medium")
    return axes


def _chosen(show: str) -> Show:
    try:
        return Show(show)
    except ValueError:
        known = ", ".join(repr(one.value) for one in Show)
        raise UsageError(f"show={show!r} is not known; give one of {known}") from None


def _axes() -> Axes:
    try:
        from matplotlib import pyplot
    except ImportError:
        raise UsageError("plots need matplotlib; install it with: pip install treereg[plot]") from None
    axes: Axes = pyplot.subplots(figsize=SIZE_INCHES, layout="constrained")[1]
    return axes


def _draw_pairs(axes: Axes, scene: Scene) -> None:
    """Crowns of both surveys, darker without a partner, and a line between the middles of those that are a pair."""
    from matplotlib.collections import LineCollection

    for side, (name, word) in enumerate((("reference", ""), ("source", ", registered"))):
        alone = scene.alone[side]
        _draw_crowns(axes, scene, side, f"{name}{word}: {np.count_nonzero(~alone):,} matched", LIGHT, ~alone)
        _draw_crowns(axes, scene, side, f"{name} only: {np.count_nonzero(alone):,}", DARK, alone)
        if side == 0:  # here for its place in the legend, which has two columns; lines lie above crowns
            lines = LineCollection(list(scene.lines), colors=_ink(), linewidths=1.2, label="between a pair")
            axes.add_collection(lines)


def _draw_crowns(
    axes: Axes, scene: Scene, side: int, label: str, opacity: float, wanted: BoolArray | None = None
) -> None:
    """Crowns of the reference (0) or the source (1), all or those of the trees that are wanted."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    colour = COLOURS[side]
    rings = [ring for tree, ring in scene.crowns(side) if wanted is None or wanted[tree]]
    faces = [to_rgba(colour, opacity)]
    axes.add_collection(PolyCollection(rings, facecolors=faces, edgecolors=colour, linewidths=0.8, label=label))


def _draw_residuals(axes: Axes, scene: Scene, width: float) -> None:
    """An arrow at every matched tree, enlarged, from where the source has it towards where the reference has it."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    vector, at = np.diff(scene.lines, axis=1)[:, 0], scene.lines[:, 1]
    for side, (name, marker) in enumerate((("reference", "o"), ("source", "^"))):
        xy = scene.xy[side][scene.alone[side]]
        label = f"{name} only: {len(xy):,}"
        axes.scatter(xy[:, 0], xy[:, 1], s=14, marker=marker, facecolors="none", edgecolors=COLOURS[side], label=label)
    axes.scatter(at[:, 0], at[:, 1], s=2, color=_ink(), alpha=0.3, linewidths=0)
    usual = float(np.quantile(np.hypot(*vector.T), 0.9)) if len(vector) else 0.0
    if usual < LEAST_M:
        return
    factor = _round(max(width / ARROWS, scene.trees[0].spacing / 2) / usual)
    arrows = vector * factor
    axes.quiver(*at.T, *arrows.T, angles="xy", scale_units="xy", scale=1, color=_ink(), width=0.002, headwidth=3.5)
    length = _round(usual)
    text = f"{length:g} m from source to reference, drawn {factor:g} times as long"
    bar = AnchoredSizeBar(axes.transData, length * factor, text, "lower right", size_vertical=0, sep=4, borderpad=0.6)
    bar.patch.set(facecolor=axes.get_facecolor(), edgecolor="none", alpha=0.85)
    bar.txt_label._text.set(color=_ink(), fontsize="small")
    bar.size_bar.get_children()[0].set(edgecolor=_ink(), linewidth=2)
    axes.add_artist(bar)


def _round(value: float) -> float:
    """The nearest of 1, 2, 5, 10, 20 and so on below a positive number."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1, 2, 5) if digit <= value / power * (1 + 1e-9)))


def _ink() -> str:
    """The colour of text, which stands out from the background in every style."""
    from matplotlib import rcParams

    return str(rcParams["text.color"])


def _window(scene: Scene, width_m: float | None) -> tuple[FloatArray, FloatArray]:
    """The corners of what is shown: all trees, or so many metres about the middle of the reference."""
    every = np.concatenate(scene.xy)
    low, high = every.min(axis=0), every.max(axis=0)
    if width_m is None:
        margin = 0.03 * float((high - low).max()) + 2.0
        return low - margin, high + margin
    if not width_m > 0:
        raise UsageError(f"width_m is {width_m}; give the width of the plot in metres, more than 0")
    middle = np.median(scene.xy[0], axis=0)
    return middle - width_m / 2, middle + width_m / 2


def _finish(axes: Axes, crs: str | None) -> None:
    """Metres at the axes, and the legend below them."""
    from matplotlib.ticker import MaxNLocator
    from matplotlib.transforms import ScaledTranslation

    named = f"m, {crs}" if crs and len(crs) < 20 else "m"
    axes.set(xlabel=f"easting ({named})" if crs else "x (m)", ylabel=f"northing ({named})" if crs else "y (m)")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.grid(visible=True, linewidth=0.4, alpha=0.4)
    axes.set_axisbelow(True)
    figure: Any = axes.get_figure(root=True)
    below = axes.transAxes + ScaledTranslation(0, LEGEND_POINTS / 72, figure.dpi_scale_trans)
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(0, 0),
        bbox_transform=below,
        ncols=2,
        frameon=False,
        fontsize="small",
        borderaxespad=0,
        handlelength=1.6,
        columnspacing=1.2,
    )


def _title(result: Result, show: Show) -> str:
    said = result.judgement
    matches = said.before if show is Show.BEFORE else said.matches
    pairs = f"{len(matches.pairs):,} of {result.comparable:,} trees matched"
    if matches.residual_rms is not None:
        pairs += f", {matches.residual_rms:.2f} m apart"
    if show is Show.BEFORE:
        return f"before registration\n{pairs}"
    if said.expected_error is None:
        return "\n".join(textwrap.wrap(f"{said.verdict.value}: {said.reason}", TITLE))
    trust = f"{said.verdict.value}, failure probability {said.failure_probability:.1g}"
    return f"{trust}\nexpected error {said.expected_error.rms:.3f} m\n{pairs}"
