"""Previews: an orthomosaic made small enough to stand in a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.errors import InputError
from treereg_core.io.grid import converted
from treereg_core.io.raster import Raster, open_raster, read_raster
from treereg_core.survey import Survey
from treereg_core.transform import Affine, Model

LARGEST = 1000
"""Pixels of the longer side."""
MOST_PIXELS = 150_000_000
"""A raster of more pixels is read only where it has overviews."""
QUALITY = {"jpeg": 75, "webp": 60}
PERCENTILES = (2, 98)
"""What is black and what is white in an image whose values are not 0 to 255."""


@dataclass(frozen=True, eq=False)
class Preview:
    """A small picture of an orthomosaic.

    - `image`: the file, a JPEG, or a WebP that is transparent where nothing is shown; `kind` says which.
    - `width`, `height`: in pixels.
    - `frame_from_pixel`: takes (column, row), counted from the outer corner of the first pixel, to the survey's working
      frame, metres.
    """

    image: bytes
    kind: str
    width: int
    height: int
    frame_from_pixel: Affine


def read_preview(survey: Survey) -> Preview | None:
    """A preview of a survey's orthomosaic; None where it has none.

    It is read at a reduced size, from overviews where there are some. Raises `InputError` for a raster that cannot be
    read, or is so large that it needs overviews and has none.
    """
    if survey.visible is None:
        return None
    from rasterio.enums import Resampling

    raster = read_raster(survey.visible, (survey.frame.crs, survey.features.xy + np.asarray(survey.frame.origin)))
    grid = raster.grid
    factor = max(1.0, max(grid.width, grid.height) / LARGEST)
    height, width = (max(1, round(side / factor)) for side in (grid.height, grid.width))
    with open_raster(raster.path) as dataset:
        if grid.width * grid.height > MOST_PIXELS and not dataset.overviews(1):
            raise InputError(f"{raster.path} has no overviews, so no preview is made of it; add them with gdaladdo.")
        bands = _bands(raster)
        values = dataset.read(bands, out_shape=(len(bands), height, width), resampling=Resampling.average)
        shown = dataset.dataset_mask(out_shape=(height, width)) > 0
        image, kind = _encoded(_as_bytes(values, shown), shown)
    return Preview(image, kind, width, height, _frame_from_pixel(raster, survey, (width, height)))


def _bands(raster: Raster) -> list[int]:
    """Red, green and blue, or the first band three times."""
    colours = [band for band in range(1, raster.count + 1) if band != raster.alpha]
    return colours[:3] if len(colours) >= 3 else colours[:1] * 3


def _as_bytes(values: NDArray[Any], shown: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Values as 0 to 255; those of other types are stretched."""
    if values.dtype == np.uint8:
        return values
    shown = shown & np.isfinite(values).all(axis=0)
    low, high = np.percentile(values[:, shown], PERCENTILES) if shown.any() else (0.0, 1.0)
    scaled = (np.nan_to_num(values.astype(np.float64)) - low) / max(high - low, 1e-9)
    return np.asarray(np.clip(255 * scaled, 0, 255), dtype=np.uint8)


def _encoded(values: NDArray[np.uint8], shown: NDArray[np.bool_]) -> tuple[bytes, str]:
    """The file and its kind: JPEG is made in a third of the time, but has no transparency."""
    from rasterio.io import MemoryFile

    kind, pixels = "jpeg", values
    if not shown.all():
        kind = "webp"
        pixels = np.concatenate([np.where(shown, values, 0), np.where(shown, 255, 0)[None]]).astype(np.uint8)
    size = {"width": pixels.shape[2], "height": pixels.shape[1], "count": len(pixels), "dtype": "uint8"}
    with MemoryFile() as memory:
        with memory.open(driver=kind.upper(), QUALITY=QUALITY[kind], **size) as image:
            image.write(pixels)
        return bytes(memory.read()), kind


def _frame_from_pixel(raster: Raster, survey: Survey, size: tuple[int, int]) -> Affine:
    """Where the pixels of the preview lie in the frame: exact where the CRS is the frame's, else to centimetres."""
    outline = raster.grid.outline()
    full = converted(raster.grid.map_from_pixel(outline), raster.grid.crs, survey.frame.crs)
    if not np.isfinite(full).all():
        raise InputError(f"{raster.path} lies where {survey.frame.crs:.40} cannot reach; correct its CRS.")
    small = outline * (size[0] / raster.grid.width, size[1] / raster.grid.height)
    return Model.AFFINE.fit(small, full - np.asarray(survey.frame.origin))
