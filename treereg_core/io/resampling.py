"""Resampling: the pixels of one piece of the target from those of the source."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from treereg_core.io.grid import PixelMap
from treereg_core.io.pieces import Piece, scales
from treereg_core.io.raster import Raster
from treereg_core.transform import Affine

Pixels = NDArray[Any]
Mask = NDArray[np.bool_]

WEIGHT = 100
"""The opacity of a pixel that counts, in the band that carries which do; it fits into every type."""
EDGE = 1e-6
"""A point this near to the source's edge, in pixels, is outside, so that rounding never shows what was not there."""
ALMOST_ONE = 0.05
"""Scales that differ from 1 by less do not blur."""


class Resampling(Enum):
    """How the value of a pixel is made of those around its place in the source.

    `auto` is nearest for classes, bilinear for elevation, cubic for images.
    """

    AUTO = "auto"
    NEAREST = "nearest"
    BILINEAR = "bilinear"
    CUBIC = "cubic"
    LANCZOS = "lanczos"
    AVERAGE = "average"

    def for_raster(self, raster: Raster) -> Resampling:
        """This one, or what suits the raster where it is `auto`."""
        if self is not Resampling.AUTO:
            return self
        if raster.classes:
            return Resampling.NEAREST
        heights = raster.count == 1 and (np.dtype(raster.dtype).kind == "f" or np.dtype(raster.dtype).itemsize > 2)
        return Resampling.BILINEAR if heights or raster.dtype == "int16" else Resampling.CUBIC

    @property
    def reach(self) -> int:
        """How far the kernel reaches, in pixels of the coarser grid."""
        return {"nearest": 1, "bilinear": 1, "cubic": 2, "lanczos": 3, "average": 1}[self.value]


@dataclass(frozen=True)
class Kernel:
    """How the pieces of one raster are resampled; the same for all of them, so that no seam shows."""

    raster: Raster
    method: Resampling
    scale: tuple[float, float]

    @classmethod
    def of(cls, raster: Raster, method: Resampling, pixels: PixelMap) -> Kernel:
        """The kernel for one map; pixels of the target that cover several of the source average over them."""
        wide = (value if abs(value - 1) > ALMOST_ONE else 1.0 for value in scales(pixels))
        across, down = (max(1.0, value) for value in wide)
        return cls(raster, method, (across, down))

    @property
    def margins(self) -> tuple[int, int]:
        """How many source pixels beyond a piece the kernel reaches, along columns and rows."""
        across, down = (math.ceil(self.method.reach * value) + 2 for value in self.scale)
        return across, down

    @property
    def fill(self) -> float:
        """What stands where the source shows nothing."""
        return 0 if self.raster.nodata is None else self.raster.nodata

    def __call__(self, source: Pixels, weight: Mask | None, piece: Piece) -> tuple[Pixels, Mask]:
        """Values (bands, height, width) of a piece, and which of its pixels show the source.

        `source` holds the piece's part of the source, `weight` the mask that comes with it, if any.
        """
        if self.raster.alpha:
            return self._with_alpha(source, piece)
        counted = self._counted(source) if weight is None else self._counted(source) & weight
        if counted.ndim == 3 and (counted == counted[0]).all():
            counted = counted[0]
        if counted.ndim == 2:
            return self._band(source, counted, piece)
        bands = [self._band(source[k : k + 1], counted[k], piece) for k in range(len(source))]
        return np.concatenate([values for values, _ in bands]), np.logical_or.reduce([shown for _, shown in bands])

    def _counted(self, source: Pixels) -> Mask:
        """Which pixels of the source count: (height, width), or for floating point types (bands, height, width)."""
        nodata = self.raster.nodata
        if np.dtype(self.raster.dtype).kind == "f":
            counted: Mask = ~np.isnan(source)
            return counted if nodata is None or math.isnan(nodata) else counted & (source != source.dtype.type(nodata))
        if nodata is None:
            return np.ones(source.shape[1:], dtype=bool)
        return np.asarray((source != source.dtype.type(nodata)).any(axis=0))

    def _band(self, source: Pixels, weight: Mask, piece: Piece) -> tuple[Pixels, Mask]:
        """Bands that share which pixels count; the fill stands where none is shown."""
        size = (piece.target.height, piece.target.width)
        if self.method is Resampling.NEAREST and source.dtype in (np.int64, np.uint64):
            values, shown = self._picked(source, weight, piece)
        elif weight.all():
            values = np.zeros((len(source), *size), dtype=source.dtype)
            self._warp(source, values, piece)
            shown = self._inside(piece)
        elif weight.any():
            weighted = np.concatenate([np.where(weight, source, 0), (weight * WEIGHT)[None]]).astype(source.dtype)
            out = np.zeros((len(weighted), *size), dtype=source.dtype)
            self._warp(weighted, out, piece, len(weighted), WEIGHT)
            values, shown = out[:-1], (out[-1] > 0) & self._inside(piece)
            if self.method is Resampling.AVERAGE:
                share = np.zeros((1, *size), dtype=np.uint8)
                self._warp((weight * np.uint8(WEIGHT))[None], share, piece)
                shown &= share[0] >= WEIGHT / 2
        else:
            values, shown = np.zeros((len(source), *size), dtype=source.dtype), np.zeros(size, dtype=bool)
        nodata = self.raster.nodata
        if nodata is None:
            return values, shown
        return self._marked(values, shown, values.dtype.type(nodata)), shown

    def _picked(self, source: Pixels, weight: Mask, piece: Piece) -> tuple[Pixels, Mask]:
        """The nearest pixels, picked here: GDAL takes whole numbers of 64 bits through floating point."""
        target, window = piece.target, piece.source
        columns = target.column + 0.5 + np.arange(target.width)
        rows = target.row + 0.5 + np.arange(target.height)
        centres = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        at = np.floor(piece.source_from_target(centres)).astype(np.int64)
        column = np.clip(at[:, 0] - window.column, 0, window.width - 1)
        row = np.clip(at[:, 1] - window.row, 0, window.height - 1)
        size = (target.height, target.width)
        shown = weight[row, column].reshape(size) & self._inside(piece)
        return np.where(shown, source[:, row, column].reshape(-1, *size), 0).astype(source.dtype), shown

    @staticmethod
    def _marked(values: Pixels, shown: Mask, nodata: Any) -> Pixels:
        """Nodata where nothing is shown, and nowhere else: a value that came out as it is moved by the least step."""
        if values.dtype.kind in "iu":
            taken = (values == nodata).all(axis=0) & shown
            if taken.any():
                step = -1 if nodata == np.iinfo(values.dtype).max else 1
                values[:, taken] = nodata + step
        values[:, ~shown] = nodata
        return values

    def _with_alpha(self, source: Pixels, piece: Piece) -> tuple[Pixels, Mask]:
        """Bands of which one is opacity: colours weigh as much as they can be seen."""
        at, kind = self.raster.alpha - 1, source.dtype
        most = 1 if kind.kind == "f" else np.iinfo(kind).max
        out = np.zeros((len(source), piece.target.height, piece.target.width), dtype=kind)
        if (source[at] == most).all():
            self._warp(source, out, piece)
            out[at] = most
        else:
            self._warp(source, out, piece, at + 1, most)
        shown = self._inside(piece) & (out[at] > 0)
        out[:, ~shown] = 0
        return out, shown

    def _warp(self, source: Pixels, out: Pixels, piece: Piece, alpha: int = 0, most: float = 0) -> None:
        from rasterio.enums import Resampling as Method
        from rasterio.warp import reproject

        opacity = {"src_alpha": alpha, "dst_alpha": alpha, "SRC_ALPHA_MAX": most, "DST_ALPHA_MAX": most}
        reproject(
            np.ascontiguousarray(source),
            out,
            src_transform=_geotransform(_target_from_window(piece)),
            dst_transform=_geotransform(Affine.identity()),
            src_crs=_plane(),
            dst_crs=_plane(),
            resampling=Method[self.method.value],
            init_dest_nodata=False,
            warp_mem_limit=1024,
            XSCALE=1 / self.scale[0],
            YSCALE=1 / self.scale[1],
            **(opacity if alpha else {}),
        )

    def _inside(self, piece: Piece) -> Mask:
        """Which pixels of a piece have their centre on the source."""
        target, grid = piece.target, self.raster.grid
        corners = piece.source_from_target(target.points(np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])))
        high = np.array([grid.width, grid.height]) - EDGE
        if (corners >= EDGE).all() and (corners <= high).all():
            return np.ones((target.height, target.width), dtype=bool)
        column = target.column + 0.5 + np.arange(target.width)
        row = (target.row + 0.5 + np.arange(target.height))[:, None]
        shown = np.ones((target.height, target.width), dtype=bool)
        for (a, b), c, most in zip(piece.source_from_target.linear, piece.source_from_target.shift, high, strict=True):
            at = a * column + (b * row + c)
            shown &= (at >= EDGE) & (at <= most)
        return shown


def _target_from_window(piece: Piece) -> Affine:
    """From pixels of the piece's part of the source to pixels of the piece's part of the target."""
    into = Affine([[1, 0], [0, 1]], (piece.source.column, piece.source.row))
    out = Affine([[1, 0], [0, 1]], (-piece.target.column, -piece.target.row))
    return out @ piece.source_from_target.inverse() @ into


def _geotransform(affine: Affine) -> Any:
    """As rasterio has it; one step aside, since it takes the identity for no georeference at all."""
    from rasterio.transform import Affine as Geotransform

    (a, b), (d, e) = affine.linear.tolist()
    c, f = affine.shift.tolist()
    return Geotransform(a, b, c + 1, d, e, f + 1)


@cache
def _plane() -> Any:
    """A CRS for both sides: any one will do, nothing is converted."""
    from rasterio.crs import CRS

    return CRS.from_epsg(3857)
