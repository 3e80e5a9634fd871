"""The pictures of the first page and of the tutorial: two simulated surveys as the files lie, and as treereg lays them.

    python -m benchmarks.before_after

Writes `docs/img/before-after.png` and `docs/img/tutorial.png`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import treereg_core
from benchmarks.row_pictures import outlines
from treereg_core.features import FeatureSet
from treereg_core.result import Result
from treereg_core.simulate import Scene, simulate, write_simulation
from treereg_core.survey import Survey
from treereg_core.transform import Affine, FloatArray, Rigid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = Path(__file__).parents[1] / "docs" / "img"
SCENE = Scene(trees=700, missed=0.07, false=0.03, rotation=4.0, shift=(2.6, 1.7))
SEED = 3
TUTORIAL, TUTORIAL_SEED = Scene(trees=1000), 1
WINDOW_M, CLOSE_M = 46.0, 26.0
REFERENCE, SOURCE = "#2f6fb5", "#d9691e"
TITLES = "as the files lie", "as treereg lays them"
INCHES = 10, 5.9
DOTS_PER_INCH, COLOURS, COLOURS_OF_IMAGES = 110, 64, 200


def main() -> int:
    """Make both pictures."""
    first_page(PICTURES / "before-after.png")
    tutorial(PICTURES / "tutorial.png")
    return 0


def first_page(path: Path) -> None:
    """The crowns of both surveys as discs."""
    simulation = simulate(SCENE, SEED)
    reference, source = simulation.reference, simulation.source
    figure, axes = beside(reference.xy.mean(axis=0), WINDOW_M)
    for at, transform in zip(axes, before_and_after(treereg_core.register(reference, source)), strict=True):
        discs(at, reference, Rigid.identity(), REFERENCE)
        discs(at, source, transform, SOURCE)
    legend(figure, f"first survey, {len(reference)} canopies", f"second survey, {len(source)} canopies")
    save(figure, path, COLOURS)


def tutorial(path: Path) -> None:
    """The canopies of the tutorial's second survey over the image of its first."""
    import rasterio
    from matplotlib.collections import LineCollection

    with tempfile.TemporaryDirectory() as folder:
        write_simulation(simulate(TUTORIAL, TUTORIAL_SEED), Path(folder), rasters=True)
        result = treereg_core.register(Path(folder) / "reference", Path(folder) / "source")
        assert isinstance(result.source, Survey)
        assert result.frame is not None
        canopies = outlines(result.source)
        with rasterio.open(Path(folder) / "reference" / "visible_10cm.tif") as file:
            image, bounds = np.moveaxis(file.read(), 0, -1), file.bounds
    x, y = result.frame.origin
    extent = (bounds.left - x, bounds.right - x, bounds.bottom - y, bounds.top - y)
    figure, axes = beside(np.array([sum(extent[:2]) / 2, sum(extent[2:]) / 2]), CLOSE_M)
    for at, transform in zip(axes, before_and_after(result), strict=True):
        at.imshow(image, extent=extent)
        at.add_collection(LineCollection([transform(ring) for ring in canopies], colors="#ffd400", linewidths=1.5))
    save(figure, path, COLOURS_OF_IMAGES)


def before_and_after(result: Result) -> tuple[Affine, Affine]:
    """No move, and the one that was found."""
    if result.transform is None or not result.accepted:
        raise SystemExit(f"not accepted: {result.judgement.reason}")
    return Rigid.identity(), result.transform


def beside(centre: FloatArray, window_m: float) -> tuple[Figure, Sequence[Axes]]:
    """Two maps of one place, true to scale."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=INCHES, dpi=DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots(1, 2)
    half = window_m / 2 * np.array([-1, 1])
    for at, title in zip(axes, TITLES, strict=True):
        at.set(xlim=centre[0] + half, ylim=centre[1] + half, aspect="equal", autoscale_on=False, xticks=[], yticks=[])
        at.set_title(title, fontsize=15)
    return figure, axes


def discs(axes: Axes, trees: FeatureSet, transform: Affine, colour: str) -> None:
    """Crowns as discs of their area."""
    from matplotlib.collections import EllipseCollection

    width = 2 * np.sqrt(trees.area / np.pi)
    crowns = EllipseCollection(
        width,
        width,
        np.zeros(len(trees)),
        units="xy",
        offsets=transform(trees.xy),
        offset_transform=axes.transData,
        facecolor=(colour, 0.35),
        edgecolor=colour,
        linewidth=1.0,
    )
    axes.add_collection(crowns)


def legend(figure: Figure, *names: str) -> None:
    """Which colour is which survey."""
    from matplotlib.patches import Patch

    patches = [Patch(facecolor=(colour, 0.35), edgecolor=colour) for colour in (REFERENCE, SOURCE)]
    figure.legend(patches, names, loc="outside lower center", ncols=2, frameon=False, fontsize=12)


def save(figure: Figure, path: Path, colours: int) -> None:
    """Write the picture as PNG, in few colours so that it stays small."""
    from PIL import Image

    whole = BytesIO()
    figure.savefig(whole, bbox_inches="tight", pad_inches=0.05)
    Image.open(whole).convert("RGB").quantize(colours).save(path, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
