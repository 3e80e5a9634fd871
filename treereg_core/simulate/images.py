"""The rasters of a simulated survey: its orthomosaic and its elevations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from treereg_core.io.raster_writing import RasterForm, new_raster
from treereg_core.simulate.grid import CELL, Grid
from treereg_core.simulate.scenery import Scenery

TILE = 1024
"""Pixels along a side of what is painted at once: some 100 MB."""
NO_COLOUR = 0
NO_ELEVATION = -9999.0
STEP_M = 0.01
"""Elevations are given to a centimetre; finer is noise, which takes room."""


def write_images(
    scenery: Scenery,
    folder: Path,
    crs: str,
    origin: tuple[float, float],
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write `visible_10cm.tif` and `dem_10cm.tif` into a survey folder; `origin` as in `write_simulation`.

    Red, green and blue are 1 to 255, 0 where nothing was seen; elevations are metres. `progress` is given the share
    that is done.
    """
    grid = Grid.around(scenery.extent, origin)
    place = crs, grid.west + origin[0], grid.north + origin[1], CELL, grid.height, grid.width
    visible = RasterForm(*place, bands=3, kind="uint8", nodata=NO_COLOUR)
    dem = RasterForm(*place, bands=1, kind="float32", nodata=NO_ELEVATION)
    with new_raster(folder / "visible_10cm.tif", visible) as show, new_raster(folder / "dem_10cm.tif", dem) as level:
        tiles = list(grid.tiles(TILE))
        for done, (row, column, tile) in enumerate(tiles, start=1):
            rgb, elevation, flown = scenery.paint(tile)
            show(row, column, np.where(flown, rgb, NO_COLOUR).astype(np.uint8))
            steps = np.rint(elevation.astype(np.float64) / STEP_M) * STEP_M
            level(row, column, np.where(flown, steps, NO_ELEVATION).astype(np.float32)[None])
            progress(done / len(tiles))
