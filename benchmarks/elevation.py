"""How well heights and the vertical offset are told by simulated rasters, on flat and on sloping ground.

    python -m benchmarks.elevation --seeds 5 --first-seed 500000

Both surveys are written with their rasters and read again; heights are compared with those of the true trees.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.processes import spread
from benchmarks.table import percent, table
from treereg_core.features import IntArray
from treereg_core.heights import vertical_offset
from treereg_core.io import read_surveys
from treereg_core.simulate import Scene, Simulation, simulate, write_simulation
from treereg_core.survey import Survey
from treereg_core.transform import FloatArray

GROUND: dict[str, Any] = {"slope": 0.15, "undulation": 1.0}
NOISE: dict[str, Any] = {"missed": 0.35, "false": 0.35, "jitter": 0.45}
DENSE: dict[str, Any] = {"row_spacing": 3.5, "spacing": 1.5, "jitter": 0.15}
SCENES = {
    "level": {"slope": 0.0, "undulation": 0.0},
    "6 % slope": {},
    "15 % slope": GROUND,
    "30 % slope": {"slope": 0.3, "undulation": 1.5},
    "15 %, heavy noise": {**GROUND, **NOISE},
    "15 %, 3.5 x 1.5 m": {**GROUND, **DENSE},
}
TREES = 400
HEADER = ("ground", "trees", "with height", "median error", "90 %", "bias", "offset error", "spread")
LEGEND = """\
median error, 90 %  of the absolute error of heights, metres, over trees that one detection shows whole
bias                median error with its sign
offset error        largest error of the vertical offset over the seeds, metres; spread: the median one reported"""


@dataclass(frozen=True, eq=False)
class Told:
    """Of one simulation: errors of heights (n,), NaN without one, the error of the vertical offset and its spread."""

    scene: str
    errors: FloatArray
    offset_error: float
    spread: float


def main() -> int:
    """Simulate, read, compare, print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.elevation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--seeds", type=int, default=5, metavar="N", help="simulations of each scene (default 5)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    told = list(spread(tell, [(name, seed) for seed in seeds for name in SCENES], options.jobs))
    print(f"{table(HEADER, [line(name, [t for t in told if t.scene == name]) for name in SCENES])}\n\n{LEGEND}")
    return 0


def tell(name: str, seed: int) -> Told:
    """One simulation written and read."""
    simulation = simulate(Scene(**{"trees": TREES, **SCENES[name]}), seed)
    with tempfile.TemporaryDirectory() as folder:
        write_simulation(simulation, Path(folder), rasters=True)
        reference, source = read_surveys(Path(folder) / "reference", Path(folder) / "source")
    assert reference.heights is not None
    assert source.heights is not None
    offset = vertical_offset(reference.heights, source.heights, simulation.true_pairs())
    truth = simulation.vertical_offset()
    assert offset is not None
    assert truth is not None
    errors = [of(simulation, survey, which) for which, survey in enumerate((reference, source))]
    return Told(name, np.concatenate(errors), offset.median - truth, offset.spread)


def of(simulation: Simulation, survey: Survey, which: int) -> FloatArray:
    """The errors of one survey's heights, metres, for trees that are shown whole by one detection."""
    shown: IntArray = (simulation.reference_trees, simulation.source_trees)[which]
    count = np.bincount(shown[shown >= 0], minlength=len(simulation.trees))
    whole = (shown[:, 0] >= 0) & (shown[:, 1] < 0) & (count[shown[:, 0]] == 1)
    assert survey.heights is not None
    return np.asarray(survey.heights.height[whole] - simulation.heights()[shown[whole, 0], which])


def line(name: str, told: Sequence[Told]) -> Sequence[str]:
    """One line of the table."""
    errors = np.concatenate([t.errors for t in told])
    known = errors[np.isfinite(errors)]
    return (
        name,
        str(len(errors)),
        percent(len(known), len(errors)),
        *(f"{value:.3f}" for value in (*np.quantile(np.abs(known), [0.5, 0.9]), np.median(known))),
        f"{max(abs(t.offset_error) for t in told):.3f}",
        f"{np.median([t.spread for t in told]):.3f}",
    )


if __name__ == "__main__":
    sys.exit(main())
