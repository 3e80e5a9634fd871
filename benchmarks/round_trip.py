"""What is left of an image after the round trip: misregistered, registered, moved back onto its own pixels.

    python -m benchmarks.round_trip --seeds 5 --first-seed 5000

Each seed is a simulated orchard with its images. `own` is the reference misregistered, registered onto itself and moved
back; `own, resampled` the same, its image made north up before, as a drone company would deliver it. `other survey` is
the fair trial: the simulated source, whose image is moved by the transform found and by the true one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.processes import spread
from benchmarks.table import table
from treereg_core.cli import main as treereg
from treereg_core.features import BoolArray
from treereg_core.io import Grid, read_motion, read_raster, write_json
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.transform import Affine, FloatArray

IMAGE = "visible_10cm.tif"
HEADER = ("image", "trials", "error", "exact", "found", "found - exact", "expected", "between")
LEGEND = """\
error          of the transform found, RMS over the image, pixels of 0.1 m
exact          mean squared difference from the original, grey values squared, of the image moved by the exact
               transform: what resampling leaves; for the other survey also another light, other leaves and noise
found          the same of the image moved by the transform found; found - exact: what registering adds
expected       what the error should add: the square of the image's slope along it
between        mean squared difference of the two moved images from each other
Medians over the trials, of pixels that all images show."""


@dataclass(frozen=True)
class Left:
    """What is left in one trial; lengths in pixels, the others in grey values squared."""

    image: str
    error: float
    exact: float
    found: float
    expected: float
    between: float


def main() -> int:
    """Simulate, register, move, compare, print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.round_trip", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--seeds", type=int, default=5, metavar="N", help="orchards (default 5)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--trees", type=int, default=400, metavar="N", help="of each orchard (default 400)")
    add("--method", default="icp", metavar="EXPR", help="default icp")
    add("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tasks = [(seed, options.trees, options.method) for seed in seeds]
    done = [left for trial in spread(trials, tasks, options.jobs) for left in trial]
    rows = [line(name, [left for left in done if left.image == name]) for name in dict.fromkeys(d.image for d in done)]
    print(f"{table(HEADER, rows)}\n\n{LEGEND}")
    return 0


def trials(seed: int, trees: int, method: str) -> list[Left]:
    """The three trials of one orchard."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_simulation(simulate(Scene(trees=trees), seed), folder, rasters=True)
        own = folder / "own"
        command("misregister", folder / "reference", "--seed", seed, "--out", own)
        undoing = own / "misregistration.json"
        done = [trial("own", own, undoing, method)]
        still = folder / "still.json"
        crs = read_raster(own / IMAGE).grid.crs
        write_json(still, {"crs": crs, "transform": {"matrix": np.eye(3).tolist()}})
        command("apply", still, own / IMAGE, "--resampling", "cubic", "--out", folder / "north-up")
        (folder / "north-up" / IMAGE).replace(own / IMAGE)
        done.append(trial("own, resampled", own, undoing, method))
        done.append(trial("other survey", folder / "source", folder / "truth.json", method))
    return done


def trial(name: str, survey: Path, exact: Path, method: str) -> Left:
    """A survey registered onto the reference beside it, its image moved by the transform found and by the exact one."""
    reference, registered = survey.with_name("reference"), survey.with_name(f"{name} registered")
    command("run", reference, survey, "--method", method, "--rasters", "none", "--out", registered)
    found = registered / "registration.json"
    original = reference / IMAGE
    moved = []
    for transform in (exact, found):
        out = survey.with_name(f"{name} by {transform.stem}")
        words = ["--grid", original, "--resampling", "cubic", "--out", out]
        command("apply", transform, survey / IMAGE, *words)
        moved.append(out / IMAGE)
    transforms = [read_motion(path).reference_from_source for path in (exact, found)]
    return left(name, (original, moved[0], moved[1]), off(read_raster(original).grid, *transforms))


def command(*words: object) -> None:
    """One command of treereg's. `RuntimeError` when it fails."""
    with redirect_stdout(StringIO()):
        code = treereg([*map(str, words), "-q"])
    if code:
        raise RuntimeError(f"treereg {words[0]} ended with {code}")


def off(grid: Grid, exact: Affine, found: Affine) -> FloatArray:
    """How far the image moved by `found` lies from where `exact` puts it, at each pixel (height, width, 2), pixels."""
    column, row = np.meshgrid(np.arange(grid.width) + 0.5, np.arange(grid.height) + 0.5)
    pixels = np.column_stack([column.ravel(), row.ravel()])
    ground = grid.map_from_pixel(pixels)
    there = grid.map_from_pixel.inverse()(found(exact.inverse()(ground)))
    return np.asarray((there - pixels).reshape(grid.height, grid.width, 2))


def left(name: str, images: tuple[Path, Path, Path], away: FloatArray) -> Left:
    """The figures of the original, the image moved exactly, and as found; `away` is what the last is off by."""
    values, masks = zip(*map(pixels_of, images), strict=True)
    shown = np.logical_and.reduce(masks)
    original, exact, found = values
    # from each pixel to the next: differences over two pixels miss the finest of what an image shows
    down, across = np.diff(exact, axis=1, append=exact[:, -1:]), np.diff(exact, axis=2, append=exact[:, :, -1:])
    expected = (across * away[..., 0] + down * away[..., 1]) ** 2

    def mean(squares: FloatArray) -> float:
        return float(squares[:, shown].mean())

    return Left(
        image=name,
        error=float(np.sqrt((away[shown] ** 2).sum(axis=1).mean())),
        exact=mean((exact - original) ** 2),
        found=mean((found - original) ** 2),
        expected=mean(expected),
        between=mean((found - exact) ** 2),
    )


def pixels_of(path: Path) -> tuple[FloatArray, BoolArray]:
    """Values (bands, height, width), and which pixels show something that no edge touches (height, width)."""
    from scipy.ndimage import binary_erosion

    with rasterio.open(path) as file:
        return file.read().astype(np.float64), binary_erosion(file.dataset_mask() > 0, iterations=3)


def line(name: str, done: Sequence[Left]) -> Sequence[str]:
    """One line of the table."""
    columns = [
        [d.error for d in done],
        [d.exact for d in done],
        [d.found for d in done],
        [d.found - d.exact for d in done],
        [d.expected for d in done],
        [d.between for d in done],
    ]
    return name, str(len(done)), *(f"{np.median(column):.4g}" for column in columns)


if __name__ == "__main__":
    sys.exit(main())
