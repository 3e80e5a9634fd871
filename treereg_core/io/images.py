"""Images of surveys, small enough to be held: for comparing what they show."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from treereg_core.errors import InputError
from treereg_core.image import Image
from treereg_core.io.files import find_files
from treereg_core.io.raster import open_raster
from treereg_core.survey import Frame, Survey
from treereg_core.transform import Affine

LARGEST = 1000
"""Pixels of the longer side."""


def read_images(reference: Survey, source: Survey) -> tuple[Image, Image] | None:
    """The orthomosaics of two surveys as grey values in their frame; None unless both have one.

    Raises `InputError` for one that cannot be read.
    """
    paths = [find_files(survey.path).visible for survey in (reference, source)]
    if paths[0] is None or paths[1] is None:
        return None
    return read_image(paths[0], reference.frame), read_image(paths[1], source.frame)


def read_image(path: Path, frame: Frame, largest: int = LARGEST) -> Image:
    """An orthomosaic as grey values in 0 to 1, averaged to at most so many pixels a side; NaN where it shows nothing.

    Bands are averaged, less one that holds the opacity; values are over the largest of their type, or of the image
    where that is a floating one. Raises `InputError` for a raster that cannot be read or has no CRS.
    """
    from rasterio.enums import ColorInterp, Resampling
    from rasterio.vrt import WarpedVRT
    from rasterio.warp import calculate_default_transform

    with open_raster(path) as dataset:
        if dataset.crs is None:
            raise InputError(f"{path} names no CRS; give it one.")
        grid = (dataset.crs, frame.crs, dataset.width, dataset.height, *dataset.bounds)
        transform, width, height = calculate_default_transform(*grid)
        factor = math.ceil(max(width, height) / largest)
        a, b, c, d, e, f = transform[:6]
        transform = type(transform)(a * factor, b * factor, c, d * factor, e * factor, f)
        options = {"crs": frame.crs, "transform": transform, "resampling": Resampling.average, "add_alpha": True}
        size = {"width": max(1, width // factor), "height": max(1, height // factor)}
        bands = [k for k, kind in enumerate(dataset.colorinterp, 1) if kind is not ColorInterp.alpha]
        if dataset.nodata is not None:
            options["add_alpha"] = False
        with WarpedVRT(dataset, **options, **size) as warped:
            values = warped.read(bands, out_dtype="float64")
            shown = warped.dataset_mask() > 0
    grey = values.mean(axis=0)
    kind = np.dtype(dataset.dtypes[0])
    top = float(np.iinfo(kind).max) if kind.kind in "iu" else float(np.max(grey[shown], initial=1.0))
    linear = np.array([[transform.a, transform.b], [transform.d, transform.e]])
    corner = np.array([transform.c, transform.f]) - frame.origin
    return Image(np.where(shown, grey / top, np.nan), Affine(linear, corner + linear @ (0.5, 0.5)))
