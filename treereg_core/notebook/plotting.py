"""Plots of a result with matplotlib: the canopies of both surveys before and after, and what is left between pairs."""

from __future__ import annotations

import textwrap
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import UsageError
from treereg_core.notebook.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from treereg_core.result import Result

REFERENCE, SOURCE = "#0072B2", "#D55E00"
"""Told apart by colour-blind eyes (Wong 2011, doi:10.1038/nmeth.1618)."""
NAMES = {"reference": REFERENCE, "source": SOURCE}
SIZE_INCHES = (8.0, 7.0)
LONGEST = 0.5
"""Residual vectors are enlarged until most of them are about this long, as a share of the distance between trees."""


class Show(Enum):
    """What a plot shows: the canopies `after` registration or `before` it, or the `residuals` of the matched pairs."""

    AFTER = "after"
    BEFORE = "before"
    RESIDUALS = "residuals"


def plot(result: Result, show: str, ax: Axes | None, width_m: float | None) -> Axes:
    """Draw a result; see `Result.plot`."""
    wanted = _chosen(show)
    axes = _axes() if ax is None else ax
    scene = Scene.of(result, before=wanted is Show.BEFORE)
    if wanted is Show.RESIDUALS:
        _draw_residuals(axes, scene)
    else:
        _draw_canopies(axes, scene, moved=wanted is Show.AFTER and result.transform is not None)
    _frame(axes, scene, result.frame.crs if result.frame else None, width_m)
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


def _draw_canopies(axes: Axes, scene: Scene, moved: bool) -> None:
    """Crowns of both surveys; those without a partner are hatched, pairs joined by a line between their middles."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgba

    for side, (name, colour) in enumerate(NAMES.items()):
        tree, rings = zip(*scene.crowns(side), strict=True)
        alone = scene.alone[side][np.array(tree)]
        word = f"{name}, registered" if side and moved else f"{name}, as georeferenced" if side else name
        for mask, label, fill, style in (
            (~alone, f"{word}: {np.count_nonzero(~scene.alone[side]):,} matched", 0.18, "-"),
            (alone, f"{name} alone: {np.count_nonzero(scene.alone[side]):,}", 0.5, "-"),
        ):
            if mask.any():
                chosen = [ring for ring, wanted in zip(rings, mask, strict=True) if wanted]
                face = to_rgba(colour, fill)
                axes.add_collection(
                    PolyCollection(chosen, facecolors=[face], edgecolors=colour, linewidths=0.8, label=label, ls=style)
                )
    dark = _ink()
    axes.add_collection(LineCollection(list(scene.lines), colors=dark, linewidths=1.2, label="matched pair"))


def _draw_residuals(axes: Axes, scene: Scene) -> None:
    """An arrow at every matched tree, enlarged, from where the source has it towards where the reference has it."""
    vector = np.diff(scene.lines, axis=1)[:, 0]
    at = scene.lines[:, 1]
    factor = _factor(scene, vector)
    arrows = axes.quiver(
        *at.T, *(vector * factor).T, angles="xy", scale_units="xy", scale=1, color=_ink(), width=0.0016, headwidth=4
    )
    for (name, colour), xy, alone, marker in zip(NAMES.items(), scene.xy, scene.alone, "o^", strict=True):
        label = f"{name} alone: {np.count_nonzero(alone):,}"
        axes.scatter(xy[alone, 0], xy[alone, 1], s=16, marker=marker, facecolors="none", edgecolors=colour, label=label)
    if len(vector):
        length = _round(float(np.sqrt(np.mean(np.sum(vector**2, axis=1)))))
        text = f"{length:g} m between a pair (drawn {factor:g} times as long)"
        axes.quiverkey(arrows, 0.03, 0.03, length * factor, text, labelpos="E", coordinates="axes").set_zorder(6)


def _factor(scene: Scene, vector: Any) -> float:
    """By how much vectors are enlarged: a round number."""
    spacing = scene.trees[0].spacing
    usual = float(np.quantile(np.hypot(*vector.T), 0.9)) if len(vector) else 0.0
    return _round(LONGEST * spacing / usual) if usual > 0 and spacing > 0 else 1.0


def _round(value: float) -> float:
    """The nearest of 1, 2, 5, 10, 20 and so on below a positive number."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(digit for digit in (1, 2, 5) if digit <= value / power * (1 + 1e-9)))


def _ink() -> str:
    """The colour of text, which stands out from the background in every style."""
    from matplotlib import rcParams

    return str(rcParams["text.color"])


def _frame(axes: Axes, scene: Scene, crs: str | None, width_m: float | None) -> None:
    """Equal scales, metres at the axes, a bar of round length, the legend below."""
    every = np.concatenate(scene.xy)
    low, high = every.min(axis=0), every.max(axis=0)
    if width_m is not None:
        if not width_m > 0:
            raise UsageError(f"width_m is {width_m}; give the width of the plot in metres, more than 0")
        middle = _middle(scene)
        low, high = middle - width_m / 2, middle + width_m / 2
    else:
        margin = 0.03 * float((high - low).max()) + 2.0
        low, high = low - margin, high + margin
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    where = f", {crs}" if crs and len(crs) < 20 else ""
    axes.set(xlabel=f"easting (m{where})" if crs else "x (m)", ylabel=f"northing (m{where})" if crs else "y (m)")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(_ticks())
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.grid(visible=True, linewidth=0.4, alpha=0.4)
    axes.set_axisbelow(True)
    axes.legend(loc="upper left", bbox_to_anchor=(0, -0.09), ncols=3, frameon=False, fontsize="small", borderaxespad=0)


def _ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=5, steps=[1, 2, 5, 10], integer=True)


def _middle(scene: Scene) -> Any:
    """The tree of the reference nearest to the middle of the pairs, or of the trees."""
    xy = scene.xy[0]
    about = scene.lines[:, 1] if len(scene.lines) else xy
    return xy[np.argmin(np.hypot(*(xy - np.median(about, axis=0)).T))]


def _title(result: Result, show: Show) -> str:
    said = result.judgement
    matches = said.before if show is Show.BEFORE else said.matches
    pairs = f"{len(matches.pairs):,} of {result.comparable:,} trees matched"
    rms = "" if matches.residual_rms is None else f", {matches.residual_rms:.2f} m apart"
    if show is Show.BEFORE:
        return f"before registration\n{pairs}{rms}"
    if said.transform is None:
        return "\n".join(textwrap.wrap(f"{said.verdict.value}: {said.reason}", 90))
    error = said.expected_error
    expected = "" if error is None else f": expected error {error.rms:.3f} m"
    return f"{said.verdict.value}{expected}, failure probability {said.failure_probability:.1g}\n{pairs}{rms}"
