"""The georeference of a raster as small text files: a world file, and ground control points for QGIS."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from treereg_core.io.complete import complete_file
from treereg_core.io.grid import Grid, Motion, moved

POINTS = 4
"""Control points along each side of the raster."""


def write_world_file(grid: Grid, path: Path) -> None:
    """Write a world file: the six numbers that take a pixel's column and row, counted at its centre, to the ground."""
    (a, b), (d, e) = grid.map_from_pixel.linear.tolist()
    c, f = grid.map_from_pixel(np.array([[0.5, 0.5]]))[0].tolist()
    with complete_file(path) as file:
        file.write("".join(f"{value!r}\n" for value in (a, d, b, e, c, f)).encode())


def write_points(source: Grid, motion: Motion, target: Grid, path: Path) -> None:
    """Write ground control points for QGIS's georeferencer: places in the raster as it was, and where they belong.

    `source` is the raster before it was moved, whose coordinates the points have as `sourceX` and `sourceY`; `mapX` and
    `mapY` are in the CRS of `target`.
    """
    share = (np.arange(POINTS) + 0.5) / POINTS
    pixels = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2) * (source.width, source.height)
    here = source.map_from_pixel(pixels)
    there = moved(here, source.crs, motion, target.crs)
    lines = [f"#CRS: {target.wkt}", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    lines += [
        ",".join(map(repr, (*to, *at))) + ",1,0,0,0" for to, at in zip(there.tolist(), here.tolist(), strict=True)
    ]
    with complete_file(path) as file:
        file.write(("\n".join(lines) + "\n").encode())
