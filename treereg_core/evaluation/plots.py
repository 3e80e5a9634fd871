"""Plots of an evaluation as SVG: error distributions, success against misregistration, milestones."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from treereg_core.evaluation.summary import Share

WIDTH, HEIGHT = 640, 340
LEFT, RIGHT, TOP, BOTTOM = 56, 16, 16, 48
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8C6D31", "#666666")
"""Told apart by colour-blind eyes (Wong 2011, doi:10.1038/nmeth.1618)."""
DASHES = ("", "6 3", "2 3", "9 3 2 3")
"""Beyond the colours, lines are told apart by dashes; also in print."""
BINS = 6
"""Trials are put into so many bins of the misregistration's size, equally many in each."""


@dataclass(frozen=True)
class Axis:
    """Values to pixels, with its ticks; on a logarithmic scale where it is so."""

    low: float
    high: float
    pixels: tuple[float, float]
    logarithmic: bool = False

    def __call__(self, value: float) -> float:
        """Where a value lies, pixels; one beyond the axis lies at its end."""
        scale: Callable[[float], float] = math.log10 if self.logarithmic else float
        low, high = scale(self.low), scale(self.high)
        share = (scale(min(max(value, self.low), self.high)) - low) / (high - low)
        return self.pixels[0] + share * (self.pixels[1] - self.pixels[0])

    @property
    def ticks(self) -> list[float]:
        """Values to write at the axis."""
        if self.logarithmic:
            first, last = math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9)
            return [10.0**power for power in range(first, last + 1)]
        step = 10.0 ** math.floor(math.log10((self.high - self.low) / 2))
        step *= next(factor for factor in (1, 2, 5, 10) if (self.high - self.low) / (factor * step) <= 6)
        return np.arange(self.low, self.high + step / 2, step).tolist()


def error_distributions(errors: Sequence[tuple[str, Sequence[float]]]) -> str:
    """The share of all trials (NaN: without a placement) whose error is below a value, for each label; metres."""
    finite = [e for _, values in errors for e in values if math.isfinite(e) and e > 0]
    low = 10.0 ** math.floor(math.log10(min(finite, default=0.01)))
    high = 10.0 ** math.ceil(math.log10(max(finite, default=1.0) + 1e-12))
    across = Axis(low, max(high, 10 * low), (LEFT, WIDTH - RIGHT), logarithmic=True)
    up = share_axis()
    parts = []
    for k, (_, values) in enumerate(errors):
        placed = sorted(value for value in values if math.isfinite(value))
        points = [(across(low), up(0.0))]
        for count, value in enumerate(placed, 1):
            points += [(across(value), points[-1][1]), (across(value), up(count / len(values)))]
        points.append((across(across.high), points[-1][1]))
        parts.append(polyline(points, k))
    return drawing(across, up, ("true error, m", "share of trials below"), parts)


def success(right: Sequence[tuple[str, Sequence[tuple[float, bool]]]]) -> str:
    """The share of right trials with its interval against how far the source was misregistered, for each label.

    Each trial is given as the size of the misregistration, metres, and whether it is right.
    """
    sizes = [size for _, trials in right for size, _ in trials if math.isfinite(size)]
    across, up = Axis(0.0, max(sizes, default=1.0) or 1.0, (LEFT, WIDTH - RIGHT)), share_axis()
    parts = []
    for k, (_, trials) in enumerate(right):
        told = sorted(trial for trial in trials if math.isfinite(trial[0]))
        points = []
        for some in (told[i * len(told) // BINS : (i + 1) * len(told) // BINS] for i in range(BINS)):
            if some:
                share = Share(sum(is_right for _, is_right in some), len(some))
                x = across(float(np.mean([size for size, _ in some]))) + 2 * (k - len(right) / 2)
                points.append((x, up(share.count / share.of)))
                parts.append(whisker(x, up, share, k))
        parts.append(polyline(points, k))
    return drawing(across, up, ("misregistration, m RMS over the trees", "share of trials right"), parts)


def milestones(shares: Sequence[tuple[str, Sequence[tuple[float, Share]]]]) -> str:
    """For each label the share of trials that reach each milestone, with its interval."""
    levels = [level for level, _ in shares[0][1]] if shares else []
    across, up = Axis(-0.5, max(len(levels) - 0.5, 0.5), (LEFT, WIDTH - RIGHT)), share_axis()
    parts = []
    for k, (_, reached) in enumerate(shares):
        for place, (_, share) in enumerate(reached):
            if share.of:
                x = across(place + 0.7 * ((k + 0.5) / len(shares) - 0.5))
                parts += [whisker(x, up, share, k), dot(x, up(share.count / share.of), k)]
    names = {float(place): f"{level:.0%}" for place, level in enumerate(levels)}
    return drawing(across, up, ("trees placed within half a spacing", "share of trials that reach it"), parts, names)


def share_axis() -> Axis:
    """From none to all, upwards."""
    return Axis(0.0, 1.0, (HEIGHT - BOTTOM, TOP))


def polyline(points: Iterable[tuple[float, float]], k: int) -> str:
    """A line in the k-th style."""
    at = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{at}" fill="none" stroke="{colour(k)}" stroke-width="2" stroke-dasharray="{dash(k)}"/>'


def whisker(x: float, up: Axis, share: Share, k: int) -> str:
    """The interval of a share."""
    low, high = (up(bound) for bound in share.ci95)
    return f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{low:.1f}" y2="{high:.1f}" stroke="{colour(k)}" stroke-opacity="0.5"/>'


def dot(x: float, y: float, k: int) -> str:
    """A point in the k-th style."""
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour(k)}"/>'


def colour(k: int) -> str:
    """Of the k-th label."""
    return COLOURS[k % len(COLOURS)]


def dash(k: int) -> str:
    """Of the k-th label."""
    return DASHES[k // len(COLOURS) % len(DASHES)]


def drawing(
    across: Axis, up: Axis, titles: tuple[str, str], parts: Iterable[str], names: dict[float, str] | None = None
) -> str:
    """The whole plot: axes with their titles and ticks, and its parts; `names` stand at the horizontal axis instead."""
    bottom, lines = HEIGHT - BOTTOM, []
    for value in names or across.ticks:
        x, text = across(value), names[value] if names else f"{value:g}"
        lines.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}"/>' if not names else "")
        lines.append(f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{escape(text)}</text>')
    for value in up.ticks:
        y = up(value)
        lines.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        lines.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{value:.0%}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    lines.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">{escape(titles[0])}</text>')
    turned = f'transform="translate(14 {(TOP + bottom) / 2}) rotate(-90)"'
    lines.append(f'<text {turned} text-anchor="middle">{escape(titles[1])}</text>')
    body = "\n".join(filter(None, [*lines, *parts]))
    label = escape(f"{titles[1]} against {titles[0]}")
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">\n{body}\n</svg>'
