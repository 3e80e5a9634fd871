"""Moving rasters against gdalwarp, side by side, and the memory that a huge one takes.

    python -m benchmarks.rasters --threads 2

An image of `--side` pixels each way is turned by 3 degrees and shifted, onto a grid of the same size, as a
cloud-optimised GeoTIFF, by both programs in turn with the same resampling, threads and options of the driver; one run
of each to warm up, then `--runs`, of which the median counts. Both are whole processes. gdalwarp is given the turned
georeference, and does neither mask what lies outside nor read back what it wrote. Then an empty raster of `--huge`
pixels each way is moved by treereg alone, and once more without touching its pixels.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.transform import Affine as Geotransform

from benchmarks.table import table
from treereg_core.io import write_json
from treereg_core.transform import Rigid

CRS, CORNER, PIXEL = "EPSG:32734", (343_000.0, 6_306_000.0), 0.1
TREEREG = str(Path(sys.executable).with_name("treereg"))
HEADER = ("raster", "resampling", "treereg", "gdalwarp", "ratio", "memory", "gdalwarp's memory")


@dataclass(frozen=True)
class Used:
    """Seconds and peak memory, bytes, of one process."""

    seconds: float
    peak: int


def main() -> int:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.rasters", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--side", type=int, default=8_000, metavar="PIXELS", help="of the image that both move (default 8000)")
    add("--huge", type=int, default=40_000, metavar="PIXELS", help="of the empty one, 0 for none (default 40000)")
    add("--runs", type=int, default=5, metavar="N", help="of each program (default 5)")
    add("--threads", type=int, default=2, metavar="N", help="default 2")
    add("--resampling", nargs="+", default=["cubic", "bilinear", "lanczos"], metavar="NAME", help="default: three")
    add("--folder", type=Path, metavar="DIR", help="where the rasters go (default: the place for temporary files)")
    arguments = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        folder = Path(name)
        transform = folder / "transform.json"
        middle = np.array(CORNER) + np.array([1, -1]) * PIXEL * arguments.side / 2
        motion = Rigid.turn(3, about=middle, shift=(1.23, -0.77))
        write_json(transform, {"crs": CRS, "transform": {"matrix": motion.matrix.tolist()}})
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:  # a process inherits its parent's peak
            source = process.submit(image, folder / "source" / "image.tif", arguments.side).result()
        for method in arguments.resampling:
            rows.append(side_by_side((source, transform, motion), method, arguments.threads, arguments.runs))
        if arguments.huge:
            rows += huge(folder, transform, arguments.huge, arguments.threads)
    print(table(HEADER, rows))
    return 0


def image(path: Path, side: int) -> Path:
    """An image of waves and noise, compressed, as hard to compress as a photograph."""
    path.parent.mkdir()
    rng = np.random.default_rng(0)
    with rasterio.open(path, "w", compress="deflate", predictor=2, photometric="RGB", **profile(side)) as file:
        column = np.arange(side, dtype=np.float32)
        for row in range(0, side, 512):
            rows = np.arange(row, min(row + 512, side), dtype=np.float32)[:, None]
            waves = [128 + 60 * np.sin(column / 37 + band) + 50 * np.cos(rows / 23 - band) for band in range(3)]
            noisy = np.stack(waves) + rng.normal(0, 6, (3, len(rows), side)).astype(np.float32)
            file.write(noisy.clip(0, 255).astype(np.uint8), window=((row, row + len(rows)), (0, side)))
    return path


def profile(side: int) -> dict[str, Any]:
    """Three bands of bytes, north up, in tiles."""
    return {
        "driver": "GTiff",
        "width": side,
        "height": side,
        "count": 3,
        "dtype": "uint8",
        "crs": CRS,
        "transform": Geotransform(PIXEL, 0, CORNER[0], 0, -PIXEL, CORNER[1]),
        "tiled": True,
        "blockxsize": 512,
        "blockysize": 512,
    }


def side_by_side(given: tuple[Path, Path, Rigid], method: str, threads: int, runs: int) -> tuple[str, ...]:
    """One line of the table: both programs in turn; treereg alone where there is no gdalwarp."""
    source, transform, motion = given
    ours = [TREEREG, "apply", transform, source, "--grid", source, "--threads", threads, "--resampling", method, "-q"]
    theirs = gdalwarp(source, motion, method, threads)
    taken: list[tuple[Used, Used | None]] = []
    for _ in range(1 + runs):
        out = source.parents[1] / "out"
        used = run([*map(str, ours), "--out", str(out)])
        shutil.rmtree(out)
        taken.append((used, run(theirs) if theirs else None))
    median = statistics.median(one.seconds for one, _ in taken[1:])
    peak = max(one.peak for one, _ in taken)
    with rasterio.open(source) as file:
        size = f"{file.width:,} x {file.height:,}"
    if not theirs:
        return size, method, f"{median:.1f} s", "-", "-", f"{peak / 1e6:.0f} MB", "-"
    other = [used for _, used in taken if used]
    yardstick = statistics.median(used.seconds for used in other[1:])
    memory = max(used.peak for used in other)
    times = f"{median:.1f} s", f"{yardstick:.1f} s", f"{median / yardstick:.2f}"
    return size, method, *times, f"{peak / 1e6:.0f} MB", f"{memory / 1e6:.0f} MB"


def gdalwarp(source: Path, motion: Rigid, method: str, threads: int) -> list[str]:
    """The command that does the same with gdalwarp; none where that is not installed."""
    if not shutil.which("gdalwarp"):
        return []
    turned = source.with_name("turned.tif")
    if not turned.exists():
        shutil.copyfile(source, turned)
        with rasterio.open(turned, "r+") as file:
            old = np.array(file.transform, dtype=float).reshape(3, 3)
            file.transform = Geotransform(*(motion.matrix @ old).ravel()[:6])
    with rasterio.open(source) as file:
        box = [file.bounds.left, file.bounds.bottom, file.bounds.right, file.bounds.top]
    options = {
        "COMPRESS": "DEFLATE",
        "PREDICTOR": "YES",
        "OVERVIEW_RESAMPLING": "AVERAGE",
        "BIGTIFF": "IF_SAFER",
        "NUM_THREADS": threads,
    }
    words = ["gdalwarp", "-q", "-overwrite", "-r", method, "-multi", "-wo", f"NUM_THREADS={threads}", "-of", "COG"]
    words += ["-te", *map(repr, box), "-tr", str(PIXEL), str(PIXEL)]
    words += [word for name, value in options.items() for word in ("-co", f"{name}={value}")]
    return [*words, str(turned), str(source.with_name("warped.tif"))]


def huge(folder: Path, transform: Path, side: int, threads: int) -> list[tuple[str, ...]]:
    """The lines of an empty raster: onto its own grid, and by its georeference alone."""
    path = folder / "huge" / "huge.tif"
    path.parent.mkdir()
    with rasterio.open(path, "w", sparse_ok=True, bigtiff="YES", photometric="RGB", **profile(side)):
        pass
    rows: list[tuple[str, ...]] = []
    ways: dict[str, list[Any]] = {"cubic": ["--grid", path, "--threads", threads], "lossless": ["--lossless"]}
    for method, more in ways.items():
        used = run([*map(str, [TREEREG, "apply", transform, path, *more, "-q", "--out", folder / "out"])])
        shutil.rmtree(folder / "out")
        figures = f"{used.seconds:.1f} s", "-", "-", f"{used.peak / 1e6:.0f} MB", "-"
        rows.append((f"{side:,} x {side:,}, empty", method, *figures))
    return rows


def run(command: Sequence[str]) -> Used:
    """What one process uses. `CalledProcessError` when it fails."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, resources = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    unit = 1 if sys.platform == "darwin" else 1024
    return Used(time.perf_counter() - begin, math.ceil(resources.ru_maxrss * unit))


if __name__ == "__main__":
    sys.exit(main())
