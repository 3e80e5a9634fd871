"""The picture of simulated images in the documentation: one place in both surveys, and the elevations there.

python -m benchmarks.scenery docs/img/simulated.png
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.simulate import Scene, simulate, write_simulation

SCENE = Scene(trees=250, rotation=8, shift=(2, -1))
SEED = 11
SIDE = 260
"""Of each of the three parts, pixels of 10 cm."""
GAP = 6
COLOURS = 80
"""Few, so that the file is small."""


def main() -> None:
    """Simulate, cut out the same coordinates of each image, write them side by side."""
    parser = argparse.ArgumentParser(
        "benchmarks.scenery", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("picture", type=Path, metavar="FILE.png")
    path = parser.parse_args().picture
    with tempfile.TemporaryDirectory() as folder:
        write_simulation(simulate(SCENE, SEED), Path(folder), rasters=True)
        parts = [middle(Path(folder) / survey / "visible_10cm.tif") for survey in ("reference", "source")]
        parts.append(grey(middle(Path(folder) / "reference" / "dem_10cm.tif")))
    write(path, [np.moveaxis(part, 0, 2) for part in parts])


def middle(path: Path) -> NDArray[Any]:
    """The values (bands, SIDE, SIDE) around the origin of the simulation."""
    import rasterio
    from rasterio.windows import Window

    with rasterio.open(path) as dataset:
        row, column = dataset.index(343_000.0, 6_306_000.0)
        return np.asarray(dataset.read(window=Window(column - SIDE // 2, row - SIDE // 2, SIDE, SIDE)))


def grey(elevation: NDArray[Any]) -> NDArray[np.uint8]:
    """Elevations (1, h, w) as shades, dark ones low, (3, h, w)."""
    low, high = np.quantile(elevation, [0.002, 0.998])
    shade = np.clip((elevation - low) / (high - low), 0, 1)
    return np.repeat((40 + 215 * shade).astype(np.uint8), 3, axis=0)


def write(path: Path, parts: list[NDArray[Any]]) -> None:
    """Write pictures (h, w, 3) side by side."""
    from PIL import Image

    gap = np.full((SIDE, GAP, 3), 255, dtype=np.uint8)
    together = np.hstack([parts[0], *(side for part in parts[1:] for side in (gap, part))])
    picture = Image.fromarray(together).quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)


if __name__ == "__main__":
    main()
