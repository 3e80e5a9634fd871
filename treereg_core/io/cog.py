"""Cloud-optimised GeoTIFF: made from a plain one, and read back before anybody sees it."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.raster import Raster, read_raster
from treereg_core.io.raster_tags import STRUCTURE
from treereg_core.io.warping import BLOCK, Progress, block_size

COMPRESSION = "DEFLATE"
"""Lossless, and read by every program that reads GeoTIFF."""


def check_space(folder: Path, path: Path, needed: float) -> None:
    """Raise `InputError` when a folder's disk has fewer free bytes than `path` needs."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        unit, size = ("GB", 1e9) if needed >= 1e8 else ("MB", 1e6)
        raise InputError(
            f"{path} would need {needed / size:,.1f} {unit} while it is moved, but only {free / size:,.1f} {unit} are "
            "free; free space, or choose another place with --out."
        )


def write_cog(plain: Path, path: Path, raster: Raster, threads: int) -> None:
    """Make a cloud-optimised GeoTIFF of a plain one that is complete; the same bytes at any number of threads."""
    import rasterio
    import rasterio.shutil

    read_raster(plain)
    options: dict[str, Any] = {
        "COMPRESS": COMPRESSION,
        "BLOCKSIZE": block_size(raster),
        "BIGTIFF": "IF_SAFER",
        "OVERVIEW_RESAMPLING": "NEAREST" if raster.classes else "AVERAGE",
        "NUM_THREADS": threads,
        "SPARSE_OK": True,
    }
    if np.dtype(raster.dtype).kind != "c":
        options["PREDICTOR"] = "YES"
    with rasterio.open(plain) as made:
        named = set(made.tag_namespaces()).union(*(made.tag_namespaces(band) for band in made.indexes)) - STRUCTURE
        # GDAL 3.10 copies either the tags of namespaces or the plain tags of bands, not both.
        if named and not any(made.tags(band) for band in made.indexes):
            options["COPY_SRC_MDD"] = True
    rasterio.shutil.copy(plain, path, driver="COG", **options)


def verify(plain: Path, path: Path, progress: Progress) -> None:
    """Read a file back and compare it, all of it, with the one that it was made of; `InputError` for any difference."""
    import rasterio
    from rasterio.windows import Window

    with rasterio.open(plain) as made, rasterio.open(path) as found:
        same = all(
            getattr(made, name) == getattr(found, name)
            for name in ("width", "height", "count", "dtypes", "crs", "colorinterp", "mask_flag_enums")
        )
        same = same and np.allclose(tuple(made.transform), tuple(found.transform), rtol=1e-12, atol=0)
        same = same and np.array_equal(made.nodatavals, found.nodatavals, equal_nan=made.nodata is not None)
        if max(made.width, made.height) > BLOCK:
            same = same and bool(found.overviews(1))
        masked = made.mask_flag_enums[0] == [rasterio.enums.MaskFlags.per_dataset]
        side = 2 * made.block_shapes[0][0]
        for row in range(0, made.height, side) if same else ():
            for column in range(0, made.width, side):
                at = Window(column, row, min(side, made.width - column), min(side, made.height - row))
                same = same and _bytes(made, at) == _bytes(found, at)
                if masked:
                    same = same and np.array_equal(made.read_masks(1, window=at), found.read_masks(1, window=at))
            progress(min(1.0, (row + side) / made.height))
    if not same:
        raise InputError(f"{path} was not written as it should be; check the disk, and run it again.")


def _bytes(dataset: Any, window: Any) -> bytes:
    values: bytes = dataset.read(window=window).tobytes()
    return values


def bytes_needed(raster: Raster, width: int, height: int, scale: tuple[float, float]) -> float:
    """How many bytes moving a raster takes on the disk: the plain file, and a finished one of about half its size."""
    shown = raster.grid.width * raster.grid.height / math.prod(scale)
    return 1.5 * min(width * height, shown) * raster.pixel_bytes
