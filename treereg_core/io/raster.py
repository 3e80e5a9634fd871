"""Raster: what a raster file says of itself, checked before any pixel is read."""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from glob import escape
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.crs import WGS84, check_no_files, converter, crs_name, parse_crs
from treereg_core.io.files import reading
from treereg_core.io.grid import Grid, affine_of
from treereg_core.io.untrusted import check_beside
from treereg_core.transform import Affine, FloatArray

if TYPE_CHECKING:
    from pyproj import CRS

LARGEST_BLOCK = 256 * 2**20
"""A raster stored in larger pieces, in bytes, is refused: each must be held whole to read one pixel of it."""
LARGEST_RASTER = 2**40
"""A raster of more bytes of pixels is refused."""

DRIVERS = ("GTiff", "PNG", "JPEG", "JP2OpenJPEG", "WEBP", "BMP", "AAIGrid")
"""The formats that are read, as GDAL names them: their files hold pixels and no names of others."""
OFFLINE = {"CPL_VSIL_CURL_ALLOWED_FILENAME": "none"}
"""GDAL opens no address but one of this name, which there is not."""
SILENT = logging.NullHandler()
"""What GDAL says beside its errors, as of a full disk, is logged and not printed in the midst of a command's words."""


@dataclass(frozen=True)
class Raster:
    """A raster file, its header checked.

    - `grid`: where its pixels lie. `dtype`: the one type of all bands, as numpy names it.
    - `nodata`: the value that means none, for floating point types NaN where the file names none; else None.
    - `alpha`: the band of opacity, counted from 1, or 0. `masked`: whether a mask of its own says which pixels count.
    - `strips`: whether it is stored in whole rows, so that reading a part of some reads them all.
    - `classes`: whether values are names of things, so that a value between two is none.
    - `files`: the file and those that belong to it.
    """

    path: Path
    driver: str
    grid: Grid
    count: int
    dtype: str
    nodata: float | None
    alpha: int
    masked: bool
    strips: bool
    classes: bool
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()

    @property
    def pixel_bytes(self) -> int:
        """Bytes of one pixel, all bands."""
        return self.count * np.dtype(self.dtype).itemsize

    @property
    def layout(self) -> str:
        """Bands and type, for people."""
        return f"{self.count} {'band' if self.count == 1 else 'bands'} of {self.dtype}"


@contextmanager
def quiet_gdal(**options: Any) -> Iterator[None]:
    """GDAL with these settings, which neither writes side files of its own accord nor warns of what is checked here."""
    import rasterio

    logging.getLogger("rasterio").addHandler(SILENT)
    with warnings.catch_warnings(), rasterio.Env(GDAL_PAM_ENABLED=True, **options):
        warnings.simplefilter("ignore")
        yield


@contextmanager
def open_raster(path: Path) -> Iterator[Any]:
    """A raster file that others made, opened by rasterio to be read; what is done inside becomes an `InputError` too.

    Only formats whose files hold their own pixels are tried (`DRIVERS`), so that no file has another one, or an address
    in the network, read. Raises `InputError` for any other, for one whose side files do that, and for one that claims
    more than can be worked on.
    """
    with reading(path, "a raster"), quiet_gdal(**OFFLINE):
        _check_beside(path)
        with _alone(path, DRIVERS) as dataset:
            _check_size(path, dataset)
            yield dataset


@contextmanager
def _alone(path: Path, drivers: tuple[str, ...]) -> Iterator[Any]:
    """A raster file of one of these formats, opened; `InputError` for one that names another as its overviews."""
    from rasterio.io import DatasetReader

    # rasterio.open takes no list of drivers, whatever it says
    with DatasetReader(str(path), driver=list(drivers)) as dataset:
        if dataset.tags(ns="OVERVIEWS"):
            raise InputError(f"{path} names another file as its overviews; export it again.")
        yield dataset


def _check_beside(path: Path) -> None:
    """Refuse what would have others opened: overviews and masks that do, and a CRS that names a file."""
    from rasterio.errors import RasterioIOError

    check_beside(path)
    sides = [side for side in path.parent.glob(f"{escape(path.name)}.*") if side.is_file()]
    for side in sides:
        if side.name.lower().endswith(".aux.xml"):
            check_no_files(unescape(side.read_text(encoding="utf-8", errors="replace")), side)
    for side in sides:
        if side.suffix.lower() in (".ovr", ".msk"):
            try:
                with _alone(side, ("GTiff",)):
                    pass
            except RasterioIOError as error:
                raise InputError(f"{side} is no TIFF; remove it, or make it again.") from error


def read_raster(path: Path, fallback: tuple[str, FloatArray | None] | None = None) -> Raster:
    """What a raster file says of itself.

    `fallback` is the CRS of a file that names none, with points (n, 2) in it among which the raster must lie (None: it
    must lie where that CRS is used); it comes with a warning. Raises `InputError` for a raster that is not
    georeferenced, is damaged or cut off, or claims more than can be worked on.
    """
    with open_raster(path) as dataset:
        raster = _described(path, dataset, fallback)
        _check_complete(raster, dataset)
    return raster


def _described(path: Path, dataset: Any, fallback: tuple[str, FloatArray | None] | None) -> Raster:
    from rasterio.enums import ColorInterp, MaskFlags

    if dataset.count == 0:
        raise InputError(f"{path} holds several rasters and no bands of its own; export the one to be moved.")
    if len(set(dataset.dtypes)) > 1 or len(set(map(str, dataset.nodatavals))) > 1:
        raise InputError(f"{path} has bands of different types or nodata values; export them as files of their own.")
    dtype = dataset.dtypes[0]
    if dtype == "complex_int16":
        raise InputError(f"{path} has pixels of the type {dtype}, which cannot be moved; export it as complex64.")
    affine = _georeference(path, dataset)
    bare = Raster(
        path=path,
        driver=dataset.driver,
        grid=Grid(affine, dataset.width, dataset.height, "", dataset.crs.to_wkt() if dataset.crs else ""),
        count=dataset.count,
        dtype=dtype,
        nodata=dataset.nodata,
        alpha=0,
        masked=False,
        strips=dataset.block_shapes[0][1] == dataset.width,
        classes=_has_classes(dataset),
        files=tuple(Path(name) for name in dataset.files),
    )
    raster = _with_crs(bare, fallback)
    if ColorInterp.alpha in dataset.colorinterp:
        return replace(raster, alpha=dataset.colorinterp.index(ColorInterp.alpha) + 1)
    if MaskFlags.per_dataset in dataset.mask_flag_enums[0]:
        return replace(raster, masked=True)
    if raster.nodata is None and np.dtype(dtype).kind == "f":
        return replace(raster, nodata=math.nan)
    return raster


def _georeference(path: Path, dataset: Any) -> Affine:
    if dataset.transform.is_identity:
        other = dataset.gcps[0] or dataset.rpcs
        hint = "only ground control points or RPCs" if other else "no georeference"
        raise InputError(f"{path} has {hint}; export it with a geotransform or a world file.")
    try:
        return affine_of(dataset.transform)
    except ValueError as error:
        raise InputError(f"{path} has an unusable geotransform ({error}); georeference it again.") from error


def _has_classes(dataset: Any) -> bool:
    """Whether there is a colour table, or the bands say that they are thematic."""
    from rasterio.enums import ColorInterp

    told = (dataset.tags(), *(dataset.tags(band) for band in dataset.indexes))
    return ColorInterp.palette in dataset.colorinterp or any(
        str(tags.get("LAYER_TYPE", "")).lower() == "thematic" for tags in told
    )


def _with_crs(raster: Raster, fallback: tuple[str, FloatArray | None] | None) -> Raster:
    if raster.grid.wkt:
        crs = parse_crs(raster.grid.wkt, raster.path)
        return replace(raster, grid=replace(raster.grid, crs=crs_name(crs)))
    if fallback is None:
        raise InputError(f"{raster.path} has no CRS; assign it.")
    from pyproj import CRS

    name, points = fallback
    crs = CRS.from_user_input(name)
    corners = raster.grid.map_from_pixel(raster.grid.outline())
    where = "the trees" if points is not None else f"where {name:.40} is used"
    if not (_among(corners, points) if points is not None else _in_use(corners, crs)):
        raise InputError(f"{raster.path} has no CRS, and in {name:.40} it would not lie at {where}; assign its CRS.")
    warning = f"{raster.path} has no CRS; it is taken to be in {name:.40}, in which it lies at {where}."
    grid = replace(raster.grid, crs=name, wkt=crs.to_wkt())
    return replace(raster, grid=grid, warnings=(*raster.warnings, warning))


def _among(corners: FloatArray, points: FloatArray) -> bool:
    """Whether the box of the corners and that of the points share ground."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool((points.max(axis=0) >= low).all() and (points.min(axis=0) <= high).all())


def _in_use(corners: FloatArray, crs: CRS) -> bool:
    area = crs.area_of_use
    lonlat = converter(crs_name(crs), WGS84)(corners)
    if area is None or not np.isfinite(lonlat).all():
        return False
    east = (lonlat[:, 0] - area.west) % 360
    inside = (lonlat[:, 1] >= area.south) & (lonlat[:, 1] <= area.north)
    return bool((inside & (east <= ((area.east - area.west) % 360 or 360))).all())


def _check_size(path: Path, dataset: Any) -> None:
    """Refuse what claims more than can be worked on, as a file made to exhaust a machine does."""
    if dataset.count == 0:
        return
    sample = max(4 if name == "complex_int16" else np.dtype(name).itemsize for name in dataset.dtypes)
    size = dataset.width * dataset.height * dataset.count * sample
    if size > LARGEST_RASTER:
        raise InputError(
            f"{path} claims {dataset.width} x {dataset.height} pixels ({size / 2**40:,.0f} TB), too many to be true "
            "of an orchard; cut it to size."
        )
    height, width = dataset.block_shapes[0]
    whole = dataset.count if dataset.interleaving and dataset.interleaving.name == "pixel" else 1
    block = height * width * whole * sample
    if dataset.compression and block > LARGEST_BLOCK:
        raise InputError(
            f"{path} is stored in pieces of {width} x {height} pixels ({block / 2**20:,.0f} MB), too large to "
            "hold; export it again in tiles."
        )


def _check_complete(raster: Raster, dataset: Any) -> None:
    """Refuse a GeoTIFF whose tiles lie beyond the end of the file: what was cut off. No pixel is read."""
    if raster.driver != "GTiff":
        return
    length = raster.path.stat().st_size
    height, width = dataset.block_shapes[0]
    pixel = bool(dataset.interleaving and dataset.interleaving.name == "pixel")
    for band in range(1, 2 if pixel else raster.count + 1):
        for row in range(math.ceil(raster.grid.height / height)):
            for column in range(math.ceil(raster.grid.width / width)):
                name = f"{column}_{row}"
                offset = dataset.get_tag_item(f"BLOCK_OFFSET_{name}", "TIFF", bidx=band)
                if offset is None:
                    continue
                size = dataset.get_tag_item(f"BLOCK_SIZE_{name}", "TIFF", bidx=band)
                if int(offset) + int(size or 0) > length:
                    raise InputError(f"{raster.path} is cut off: pixels are missing at its end; copy it again.")
