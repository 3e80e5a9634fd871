"""The picture of the first page: a corner of two simulated surveys, as the files lie and as treereg lays them.

uv run python -m benchmarks.before_after
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import treereg_core
from treereg_core.features import FeatureSet
from treereg_core.simulate import Scene, simulate
from treereg_core.transform import Affine, Rigid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATH = Path(__file__).parents[1] / "docs" / "img" / "before-after.png"
SCENE = Scene(trees=700, missed=0.07, false=0.03, rotation=4.0, shift=(2.6, 1.7))
SEED = 3
WINDOW_M = 46.0
PALETTE = 64
REFERENCE, SOURCE = "#2f6fb5", "#d9691e"


def main() -> None:
    """Simulate, register and draw."""
    from matplotlib import pyplot as plt
    from matplotlib.patches import Patch
    from PIL import Image

    simulation = simulate(SCENE, SEED)
    reference, source = simulation.reference, simulation.source
    result = treereg_core.register(reference, source, method="icp")
    if not result.accepted or result.transform is None:
        raise SystemExit(f"not accepted: {result.judgement.reason}")
    figure, axes = plt.subplots(1, 2, figsize=(10, 5.5), layout="constrained")
    centre = reference.xy.mean(axis=0)
    laid = (Rigid.identity(), result.transform)
    for at, transform, title in zip(axes, laid, ("as the files lie", "as treereg lays them"), strict=True):
        draw(at, reference, Rigid.identity(), REFERENCE)
        draw(at, source, transform, SOURCE)
        at.set(xlim=centre[0] + WINDOW_M / 2 * np.array([-1, 1]), ylim=centre[1] + WINDOW_M / 2 * np.array([-1, 1]))
        at.set(aspect="equal", xticks=[], yticks=[])
        at.set_title(title, fontsize=15)
    handles = [Patch(facecolor=(c, 0.35), edgecolor=c) for c in (REFERENCE, SOURCE)]
    names = [f"first survey, {len(reference)} canopies", f"second survey, {len(source)} canopies"]
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False, fontsize=12)
    stored = BytesIO()
    figure.savefig(stored, dpi=110)
    Image.open(stored).convert("RGB").quantize(PALETTE).save(PATH, optimize=True)


def draw(axes: Axes, trees: FeatureSet, transform: Affine, colour: str) -> None:
    """Crowns as discs of their area."""
    from matplotlib.collections import EllipseCollection

    width = 2 * np.sqrt(trees.area / np.pi)
    axes.add_collection(
        EllipseCollection(
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
    )


if __name__ == "__main__":
    main()
