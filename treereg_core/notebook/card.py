"""A result as a card of HTML: the verdict, how far to trust it, and a small map. Looks right in light and in dark."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from treereg_core.judgement import Verdict
from treereg_core.notebook.scene import Scene
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from treereg_core.result import Result

BADGES = {
    Verdict.ACCEPTED: ("✓", "#00705a"),
    Verdict.AMBIGUOUS: ("?", "#8a5a00"),
    Verdict.FAILED: ("✗", "#a8322a"),
}
MATCHED, REFERENCE, SOURCE = "currentColor", "#2b8fd6", "#e2711d"
SIZE = 240.0
MOST_DOTS = 4000
"""A map of more trees shows every second, third and so on."""


def card(result: Result) -> str:
    """The card; text from names and plugins is escaped, and there is no script and no outside link."""
    said = result.judgement
    mark, colour = BADGES[said.verdict]
    rows = "".join(
        f'<tr style="background:none"><td style="text-align:left;padding:1px 14px 1px 0;opacity:.7;white-space:nowrap">'
        f'{escape(name)}</td><td style="text-align:left;padding:1px 0">{escape(text)}</td></tr>'
        for name, text in facts(result).items()
    )
    warned = "".join(
        f'<p style="margin:6px 0 0;font-size:90%">⚠ {escape(warning)}</p>' for warning in result.all_warnings
    )
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:20px;align-items:flex-start;max-width:860px;padding:14px 16px;'
        'border:1px solid rgba(128,128,128,.4);border-radius:8px;font-family:system-ui,sans-serif;line-height:1.45">'
        '<div style="flex:1 1 340px;min-width:0">'
        f'<span style="display:inline-block;padding:2px 10px;border-radius:999px;background:{colour};color:#fff;'
        f'font-weight:600">{mark} {said.verdict.value}</span>'
        f'<p style="margin:8px 0 10px">{escape(said.reason)}</p>'
        '<table style="border-collapse:collapse;border:0;margin:0;font-size:95%;font-variant-numeric:tabular-nums">'
        f"{rows}</table>{warned}</div>{small_map(Scene.of(result))}</div>"
    )


def facts(result: Result) -> dict[str, str]:
    """What a person wants to know, by name."""
    said, options = result.judgement, result.plan.options
    found: dict[str, str] = {}
    if said.expected_error is not None:
        low, high = said.expected_error.ci95
        found["expected error"] = f"{said.expected_error.rms:.3f} m (95 %: {low:.3f} to {high:.3f} m)"
    found["failure probability"] = f"{said.failure_probability:.2g}"
    apart = [
        "" if matches.residual_rms is None else f", {matches.residual_rms:.2f} m apart"
        for matches in (said.matches, said.before)
    ]
    found["trees matched"] = (
        f"{len(said.matches.pairs):,} of {result.comparable:,}{apart[0]} (before: {len(said.before.pairs):,}{apart[1]})"
    )
    if said.transform is not None:
        centroid = Scene.of(result, before=True).trees[1].xy.mean(axis=0, keepdims=True)
        east, north = (said.transform(centroid) - centroid)[0]
        turned = said.transform.rotation_deg
        found["source moved"] = f"{east:+z.3f} m east, {north:+z.3f} m north, turned {turned:+z.4f}°"
    found["method"] = f"{options.method} from {options.start}"
    return found


def small_map(scene: Scene) -> str:
    """The trees as dots: matched ones, and those that only one of the surveys has."""
    reference, source = scene.xy
    every = np.concatenate([reference, source])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = (SIZE - 8) / max(float((high - low).max()), 1e-9)
    width, height = (high - low) * scale + 8
    step = -(-len(every) // MOST_DOTS)
    layers = []
    for colour, xy in (
        (MATCHED, reference[~scene.alone[0]]),
        (REFERENCE, reference[scene.alone[0]]),
        (SOURCE, source[scene.alone[1]]),
    ):
        at = np.column_stack([xy[::step, 0] - low[0], high[1] - xy[::step, 1]]) * scale + 4
        weight, opacity = (2.2, 0.45) if colour == MATCHED else (3.4, 1)
        layers.append(
            f'<path d="{dots(at)}" stroke="{colour}" stroke-width="{weight}" stroke-opacity="{opacity}" '
            'stroke-linecap="round" fill="none"/>'
        )
    counts = (len(scene.positions), np.count_nonzero(scene.alone[0]), np.count_nonzero(scene.alone[1]))
    names = ("matched", "reference only", "source only")
    legend = " ".join(
        f'<span style="white-space:nowrap;margin-right:8px"><span style="color:{colour}">●</span> {name} {count:,}'
        "</span>"
        for colour, name, count in zip((MATCHED, REFERENCE, SOURCE), names, counts, strict=True)
    )
    return (
        f'<figure style="margin:0;flex:0 0 auto;max-width:{SIZE:.0f}px">'
        f'<svg width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}" role="img" '
        f'aria-label="map of the trees">{"".join(layers)}</svg>'
        f'<figcaption style="font-size:80%;margin-top:4px">{legend}</figcaption></figure>'
    )


def dots(at: FloatArray) -> str:
    """Points (n, 2) as a path of lines without length, which round ends make dots of."""
    return "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at.tolist())
