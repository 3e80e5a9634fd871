"""Moving rasters: checked before any work, written aside, read back, and only then in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from glob import escape
from pathlib import Path

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.cog import bytes_needed, check_space, verify, write_cog
from treereg_core.io.georeference import write_points, write_world_file
from treereg_core.io.grid import Grid, Motion, PixelMap, converted, covering, extended
from treereg_core.io.lossless import check_geotiff, moved_grid, rewrite, sidecars, stored_bytes
from treereg_core.io.pieces import scales
from treereg_core.io.raster import Raster, quiet_gdal
from treereg_core.io.raster_writing import writing_raster
from treereg_core.io.resampling import Resampling
from treereg_core.io.warping import CACHE_BYTES, Warp
from treereg_core.transform import FloatArray

WARPED, FINISHED = 0.6, 0.9
"""How much of the work is done when the pixels are moved, and when the file is finished but not read back."""


class Extent(Enum):
    """How far the pixels reach: as far as those of the reference's raster, or as far as the moved source."""

    REFERENCE = "reference"
    SOURCE = "source"


@dataclass(frozen=True)
class RasterOptions:
    """How rasters are moved.

    - `lossless`: only the georeference is rewritten; no pixel is read.
    - `extent`: without a grid always that of the source.
    - `world_file`, `gcp_points`: further files beside the raster.
    """

    lossless: bool = False
    resampling: Resampling = Resampling.AUTO
    extent: Extent = Extent.REFERENCE
    world_file: bool = False
    gcp_points: bool = False
    threads: int = 1


@dataclass(frozen=True)
class RasterJob:
    """A raster that is to be moved, checked: onto which grid, and what a person should know of it beforehand."""

    raster: Raster
    motion: Motion
    grid: Grid
    options: RasterOptions
    warnings: tuple[str, ...] = ()

    def files(self, path: Path) -> tuple[Path, ...]:
        """What is written when the moved raster is written to `path`."""
        beside = sidecars(self.raster, path) if self.options.lossless else {}
        more = [path.with_suffix(".tfw")] if self.options.world_file else []
        more += [Path(f"{path}.points")] if self.options.gcp_points else []
        return (path, *beside.values(), *more)

    def write(self, path: Path, progress: Callable[[float], None] = lambda share: None) -> tuple[str, ...]:
        """Write the moved raster to `path`, and what was asked for beside it; gives warnings.

        `progress` is given the share of the work that is done. Every file is complete or absent. Raises `InputError`
        for a raster that is damaged or shows nothing of the grid, and when `path` cannot be written.
        """
        if self.options.lossless:
            rewrite(self.raster, self.grid, path)
            warnings: tuple[str, ...] = ()
        else:
            warnings = self._resample(path, progress)
        if self.options.world_file:
            write_world_file(self.grid, path.with_suffix(".tfw"))
        if self.options.gcp_points:
            write_points(self.raster.grid, self.motion, self.grid, Path(f"{path}.points"))
        return warnings

    def _resample(self, path: Path, progress: Callable[[float], None]) -> tuple[str, ...]:
        plain, aside = (path.with_name(f".{path.name}.{part}.tif") for part in ("plain", "cog"))
        pixels = PixelMap(self.grid, self.raster.grid, self.motion)
        warp = Warp(self.raster, pixels, self.options.resampling.for_raster(self.raster), self.options.threads)
        try:
            with quiet_gdal(GDAL_CACHEMAX=CACHE_BYTES, GDAL_TIFF_INTERNAL_MASK=True), writing_raster(path):
                shows = warp.into(plain, lambda share: progress(WARPED * share))
                write_cog(plain, aside, self.raster, self.options.threads)
                progress(FINISHED)
                verify(plain, aside, lambda share: progress(FINISHED + (1 - FINISHED) * share))
                aside.replace(path)
        finally:
            for file in (plain, aside):
                for rest in path.parent.glob(f"{escape(file.name)}*"):
                    rest.unlink(missing_ok=True)
        return () if shows else (f"{self.raster.path} holds no data where it was moved; check what it shows.",)


def raster_job(raster: Raster, motion: Motion, onto: Grid | None, options: RasterOptions, folder: Path) -> RasterJob:
    """What moving a raster will do; nothing is written and no pixel read.

    `onto` is the grid of the reference's raster, if any; `folder` is where the raster will be written. Raises
    `InputError` when the raster would lie beside that grid, when a CRS does not reach, or the disk is too small.
    """
    if options.lossless:
        check_geotiff(raster)
        grid, warnings = moved_grid(raster, motion)
        check_raster_space(raster, grid, motion, options, folder)
        return RasterJob(raster, motion, grid, options, raster.warnings + warnings)
    if onto is None:
        grid = covering(raster.grid, motion, raster.path)
    elif options.extent is Extent.SOURCE:
        grid = extended(onto, raster.grid, motion, raster.path)
    else:
        grid = onto
    job = RasterJob(raster, motion, grid, options, raster.warnings)
    _check_overlap(job, extended(grid, raster.grid, motion, raster.path))
    check_raster_space(raster, grid, motion, options, folder)
    return job


def check_raster_space(raster: Raster, grid: Grid, motion: Motion, options: RasterOptions, folder: Path) -> None:
    """Raise `InputError` when a folder's disk has no room for a raster that is moved onto a grid."""
    if options.lossless:
        check_space(folder, raster.path, stored_bytes(raster))
    else:
        scale = scales(PixelMap(grid, raster.grid, motion))
        check_space(folder, raster.path, bytes_needed(raster, grid.width, grid.height, scale))


def raster_outline(raster: Raster, crs: str) -> FloatArray:
    """Points (n, 2) along the edge of a raster, full coordinates in `crs`; not finite where that does not reach."""
    return converted(raster.grid.map_from_pixel(raster.grid.outline()), raster.grid.crs, crs)


def _check_overlap(job: RasterJob, reach: Grid) -> None:
    """Refuse a raster of which the grid shows nothing. `reach`: the same pixels where the moved source lies."""
    first = job.grid.map_from_pixel.inverse()(reach.map_from_pixel.shift[None])[0]
    beyond = first + np.array([reach.width, reach.height])
    if (beyond <= 0).any() or first[0] >= job.grid.width or first[1] >= job.grid.height:
        raise InputError(
            f"{job.raster.path} shows nothing of the ground that the grid covers; give another grid, or keep the "
            "extent of the source."
        )
