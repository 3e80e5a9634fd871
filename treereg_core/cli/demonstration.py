"""The demonstration of `treereg run` without folders: a simulated orchard whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from treereg_core import io
from treereg_core.cli.console import console
from treereg_core.evaluator import Problem
from treereg_core.evaluators import Truth
from treereg_core.result import Result, trees
from treereg_core.survey import Survey

DEMONSTRATION = "demonstration"


def make_orchard(folder: Path, seed: int, rasters: bool) -> Path:
    """Write survey folders `reference` and `source` of a simulated orchard; gives the file of its truth.

    With `rasters` both have their images too, which takes some seconds.
    """
    from treereg_core.simulate import Scene, simulate, write_simulation

    write_simulation(
        simulate(Scene(), seed),
        folder,
        rasters=rasters,
        progress=lambda name, share: console.share(f"paint {name}", share),
    )
    return folder / "truth.json"


def made_at(place: Path, survey: Survey) -> Survey:
    """A survey under the path where it will lie when the run is complete, in its warnings too."""
    warnings = tuple(warning.replace(str(survey.path), str(place)) for warning in survey.warnings)
    return replace(survey, path=place, warnings=warnings)


def true_error(result: Result, truth_file: Path) -> float | None:
    """The true error over the source's trees, RMS, metres; None without a placement."""
    if result.frame is None:
        return None
    truth = io.read_transform(truth_file, result.frame)
    return Truth().score(result.judgement, Problem(trees(result.reference), trees(result.source), truth))["error_m"]
