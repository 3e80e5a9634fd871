"""Lossless: a copy of a raster file with another georeference, its pixels untouched and unread."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.grid import Grid, Motion, moved
from treereg_core.io.raster import Raster, quiet_gdal
from treereg_core.io.raster_writing import writing_raster
from treereg_core.transform import Affine

WARN_PIXELS = 0.1
"""A geotransform that misses the true place of some pixel by more is worth a warning."""
CHUNK = 2**22
BESIDE = (".ovr", ".msk", ".aux.xml")
"""What may belong to a file, by what follows its name."""


def moved_grid(raster: Raster, motion: Motion) -> tuple[Grid, tuple[str, ...]]:
    """The raster's own pixels where they belong, and a warning where one geotransform cannot say that exactly."""
    grid = raster.grid
    if grid.crs == motion.crs:
        full = motion.reference_from_source @ grid.map_from_pixel
        return Grid(Affine(full.linear, full.shift), grid.width, grid.height, grid.crs, grid.wkt), ()
    steps = np.linspace(0, 1, 9)
    points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * (grid.width, grid.height)
    there = moved(grid.map_from_pixel(points), grid.crs, motion, grid.crs)
    if not np.isfinite(there).all():
        raise InputError(
            f"{raster.path} lies where the transform's CRS does not reach; correct the CRS of one of them."
        )
    middle, mean = points.mean(axis=0), there.mean(axis=0)
    slopes, *_ = np.linalg.lstsq(points - middle, there - mean, rcond=None)
    fitted = Affine(slopes.T, mean - slopes.T @ middle)
    worst = float(np.hypot(*(fitted.inverse()(there) - points).T).max())
    warning = (
        f"{raster.path} is in another CRS than the transform, so that no georeference alone puts it right: pixels lie "
        f"up to {worst:.2f} pixels off; reproject it, or leave out lossless."
    )
    found = Grid(fitted, grid.width, grid.height, grid.crs, grid.wkt)
    return found, (warning,) if worst > WARN_PIXELS else ()


def sidecars(raster: Raster, path: Path) -> dict[Path, Path]:
    """The files that belong to a raster, each with its name beside `path`."""
    pairs = {Path(f"{raster.path}{end}"): Path(f"{path}{end}") for end in BESIDE}
    return {old: new for old, new in pairs.items() if old.is_file()}


def check_geotiff(raster: Raster) -> None:
    """Raise `InputError` for a raster whose georeference alone cannot be rewritten."""
    if raster.driver != "GTiff":
        raise InputError(
            f"{raster.path} is no GeoTIFF, so that its georeference alone cannot be rewritten; export it as one, or "
            "leave out lossless."
        )


def rewrite(raster: Raster, grid: Grid, path: Path) -> None:
    """Copy a GeoTIFF and what belongs to it to `path`, and give the copy the georeference of `grid`.

    Raises `InputError` when it cannot be written.
    """
    import rasterio
    from rasterio.crs import CRS

    copies = {raster.path: path, **sidecars(raster, path)}
    with writing_raster(path), quiet_gdal():
        for old, new in copies.items():
            copy_sparse(old, new)
        with rasterio.open(path, "r+", IGNORE_COG_LAYOUT_BREAK="YES") as dataset:
            dataset.transform = grid.geotransform()
            if dataset.crs is None:
                dataset.crs = CRS.from_wkt(grid.wkt)
        with rasterio.open(path) as dataset:
            same = (dataset.width, dataset.height, dataset.count) == (grid.width, grid.height, raster.count)
            if not same or not np.allclose(tuple(dataset.transform), tuple(grid.geotransform()), rtol=1e-12, atol=0):
                raise InputError(f"{path} was not written as it should be; check the disk, and run it again.")


def stored_bytes(raster: Raster) -> int:
    """How many bytes a raster's files take on the disk: fewer than their lengths where they have holes."""
    found = [file.stat() for file in (raster.path, *sidecars(raster, raster.path))]
    return sum(min(file.st_size, getattr(file, "st_blocks", file.st_size) * 512) for file in found)


def copy_sparse(source: Path, target: Path) -> None:
    """Copy a file; holes stay holes where the system knows of them, so that a huge empty file is copied at once."""
    with source.open("rb", buffering=0) as old, target.open("wb", buffering=0) as new:
        length = os.fstat(old.fileno()).st_size
        at = 0
        while at < length:
            at, end = _data(old.fileno(), at, length)
            old.seek(at)
            new.seek(at)
            while at < end:
                part = old.read(min(CHUNK, end - at))
                if not part:
                    raise OSError(errno.EIO, "the file became shorter while it was copied")
                new.write(part)
                at += len(part)
        new.truncate(length)


def _data(file: int, at: int, length: int) -> tuple[int, int]:
    """Where the next data of an open file begin and end; all the rest of it where the system does not tell."""
    try:
        begin = os.lseek(file, at, os.SEEK_DATA)
        return begin, os.lseek(file, begin, os.SEEK_HOLE)
    except AttributeError:
        return at, length
    except OSError as error:
        return (length, length) if error.errno == errno.ENXIO else (at, length)
