"""Writing new rasters block by block: tiled, compressed, the same bytes for the same values."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io.files import first_line, reason

BLOCK = 256
"""Side of a tile of the file, pixels; values are best written in multiples of it."""
FULL_BYTES = 2**20
"""A disk with less is full when something could not be written to it."""
Put = Callable[[int, int, NDArray[Any]], None]
"""Takes a row, a column and the values (bands, h, w) that begin there."""


@dataclass(frozen=True)
class RasterForm:
    """What a raster is before it has values: north up, its outer corner in full coordinates of `crs`.

    `cell` is the width of a pixel in units of the CRS; `kind` is the type of a value, such as `uint8`.
    """

    crs: str
    west: float
    north: float
    cell: float
    height: int
    width: int
    bands: int
    kind: str
    nodata: float


@contextmanager
def new_raster(path: Path, form: RasterForm) -> Iterator[Put]:
    """A new GeoTIFF at `path`, for use in a `with` statement, which gives the function that fills it.

    The file is complete or absent: written aside and renamed when the block ends well. Raises `OSError` when it cannot
    be written.
    """
    import rasterio
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioIOError
    from rasterio.windows import Window

    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    floating = np.issubdtype(form.kind, np.floating)
    try:
        with rasterio.open(
            aside,
            "w",
            driver="GTiff",
            height=form.height,
            width=form.width,
            count=form.bands,
            dtype=form.kind,
            crs=form.crs,
            transform=rasterio.Affine(form.cell, 0, form.west, 0, -form.cell, form.north),
            nodata=form.nodata,
            tiled=True,
            blockxsize=BLOCK,
            blockysize=BLOCK,
            interleave="pixel",
            photometric="RGB" if form.bands == 3 else "MINISBLACK",
            compress="deflate",
            predictor=3 if floating else 2,
            zlevel=4,
            bigtiff="IF_SAFER",
        ) as dataset:

            def put(row: int, column: int, values: NDArray[Any]) -> None:
                dataset.write(values, window=Window(column, row, values.shape[2], values.shape[1]))

            yield put
        os.replace(aside, path)
    except (RasterioIOError, CPLE_BaseError) as error:
        raise OSError(errno.EIO, unwritten(path, error)) from error
    finally:
        aside.unlink(missing_ok=True)


@contextmanager
def writing_raster(path: Path) -> Iterator[None]:
    """Turns what a full disk or a refusing system makes of writing into an `InputError` that names the file."""
    from rasterio._err import CPLE_BaseError
    from rasterio.errors import RasterioError

    try:
        yield
    except (OSError, RasterioError, CPLE_BaseError) as error:
        why = unwritten(path, error)
        raise InputError(f"{path} cannot be written ({why}); free space, or choose another place.") from error


def unwritten(path: Path, error: Exception) -> str:
    """Why a raster could not be written. GDAL does not say when a disk is full, so that is looked at."""
    if isinstance(error, OSError) and error.strerror:
        return reason(error)
    if shutil.disk_usage(path.parent).free < FULL_BYTES:
        return os.strerror(errno.ENOSPC).lower()
    return first_line(error.__cause__ if isinstance(error.__cause__, Exception) else error)
