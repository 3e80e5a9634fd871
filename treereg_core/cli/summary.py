"""What `treereg run` prints for people."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from treereg_core.judgement import Matches
from treereg_core.result import Result, trees


def summary(result: Result, out: Path, files: Iterable[str], true_error_m: float | None) -> str:
    """The verdict with its reason, how far to trust it, and where the files are."""
    said, options = result.judgement, result.plan.options
    lines = [f"{said.verdict.value}: {said.reason}"]
    rows = {"method": f"{options.method} from {options.start}"}
    if said.transform is not None:
        centroid = trees(result.source).xy.mean(axis=0, keepdims=True)
        east, north = (said.transform(centroid) - centroid)[0]
        rows["source moved"] = (
            f"{east:+z.3f} m east, {north:+z.3f} m north, turned {said.transform.rotation_deg:+z.4f} deg"
        )
    used = min(len(trees(result.reference)), len(trees(result.source)))
    rows["trees matched"] = f"{in_words(said.matches, used)} (before: {in_words(said.before, used)})"
    if said.expected_error is not None:
        low, high = said.expected_error.ci95
        rows["expected error"] = f"{said.expected_error.rms:.3f} m (95 %: {low:.3f} to {high:.3f} m)"
    offset = result.vertical_offset
    if offset is not None:
        rows["vertical offset"] = (
            f"{offset.median:+z.2f} m from the source's elevations to the reference's, spread {offset.spread:.2f} m; "
            "not applied"
        )
    rows["failure probability"] = f"{said.failure_probability:.2g}"
    if true_error_m is not None:
        rows["true error"] = f"{true_error_m:.3f} m (a simulated orchard, so it is known)"
    rows["files"] = ", ".join(str(out / name) for name in files)
    width = max(map(len, rows)) + 2
    return "\n".join(lines + [f"  {name.ljust(width)}{text}" for name, text in rows.items()])


def in_words(matches: Matches, used: int) -> str:
    """How many of the trees are matched, and how far apart they are."""
    rms = matches.residual_rms
    return f"{len(matches.pairs)} of {used}" + ("" if rms is None else f", {rms:.2f} m apart")
