"""What `treereg run` prints for people."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from treereg_core.cli.columns import hanging, labelled
from treereg_core.cli.console import painted, width
from treereg_core.judgement import Judgement, Matches, Verdict
from treereg_core.result import Result, trees

COLOURS = {Verdict.ACCEPTED: "green", Verdict.AMBIGUOUS: "yellow", Verdict.FAILED: "red"}


def summary(result: Result, out: Path, files: Iterable[str], true_error_m: float | None) -> str:
    """The verdict with its reason, how far to trust it, where the files are, and what to do when it is not accepted."""
    said, options = result.judgement, result.plan.options
    names = list(files)
    first, *further = hanging("", f"{said.verdict.value}: {said.reason}", width())
    head = painted(said.verdict.value, COLOURS[said.verdict]) + first.removeprefix(said.verdict.value)
    rows: dict[str, str | Sequence[str]] = {"method": f"{options.method} from {options.start}"}
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
    rows["files"] = [str(out / name) for name in names]
    if not result.accepted:
        rows["what next"] = what_next(said, out / names[0])
    return "\n".join([head, *further, *labelled(rows, width())])


def what_next(said: Judgement, registration: Path) -> str:
    """What a person can do about a result that was not accepted."""
    if said.verdict is Verdict.FAILED:
        return (
            "see that both folders show one orchard and share a good part of it; begin from a placement of your own "
            "with --start FILE.json, or from the files' own georeference with --start identity"
        )
    apply = f"treereg apply {shlex.quote(str(registration))} FILE... --out DIR"
    choose = f"{apply} --rival 1 (the first rival; --force: this one)" if said.rivals else f"{apply} --force"
    return (
        "if you know how far the files' georeference may be off, run it again with --georeference-sd METRES; else "
        f"compare the placements on an image and choose one: {choose}"
    )


def in_words(matches: Matches, used: int) -> str:
    """How many of the trees are matched, and how far apart they are."""
    rms = matches.residual_rms
    return f"{len(matches.pairs)} of {used}" + ("" if rms is None else f", {rms:.2f} m apart")
