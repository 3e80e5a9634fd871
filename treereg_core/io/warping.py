"""Warping: a raster moved onto a grid, piece by piece, so that no more than a few pieces are ever in memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from treereg_core.errors import InputError
from treereg_core.io.files import first_line
from treereg_core.io.grid import PixelMap
from treereg_core.io.pieces import Piece, cut
from treereg_core.io.raster import Raster, open_raster, quiet_gdal
from treereg_core.io.raster_tags import describe
from treereg_core.io.raster_writing import writing_raster
from treereg_core.io.resampling import Kernel, Mask, Pixels, Resampling

CACHE_BYTES = 64 * 2**20
"""How many bytes of pixels GDAL may keep."""
STRIPS_CACHE_BYTES = 192 * 2**20
"""The same for a raster in strips: the whole rows of which a row of pieces needs parts."""
MOST_THREADS = 8
"""More would hold too many pieces in memory."""
BLOCK = 512
Progress = Callable[[float], None]


def block_size(raster: Raster) -> int:
    """The side of a tile of the files that are written; smaller where a pixel has many bytes."""
    return BLOCK if raster.pixel_bytes <= 16 else BLOCK // 2


@dataclass(frozen=True)
class Warp:
    """One raster on its way onto a grid."""

    raster: Raster
    pixels: PixelMap
    method: Resampling
    threads: int = 1

    def into(self, path: Path, progress: Progress) -> bool:
        """Write the moved raster as an uncompressed GeoTIFF; gives whether it shows anything of the source.

        Raises `InputError` when the source cannot be read, or `path` cannot be written. The same bytes come out at any
        number of threads.
        """
        kernel = Kernel.of(self.raster, self.method, self.pixels)
        shows = False
        with (
            quiet_gdal(
                GDAL_CACHEMAX=STRIPS_CACHE_BYTES if self.raster.strips else CACHE_BYTES, GDAL_TIFF_INTERNAL_MASK=True
            ),
            self._target(path) as (target, mask),
            _Readers(self.raster, 1 if self.raster.strips else self.workers) as readers,
        ):

            def made(piece: Piece) -> tuple[Pixels, Mask]:
                return kernel(*readers.read(piece), piece)

            for piece, (values, shown) in self._each(made, kernel):
                if not shown.any():
                    continue
                shows = True
                at = _window(piece.target)
                with writing_raster(path):
                    target.write(values, window=at)
                    if mask:
                        target.write_mask(shown, window=at)
                progress((piece.target.row + piece.target.height) / self.pixels.target.height)
        return shows

    def _each(
        self, made: Callable[[Piece], tuple[Pixels, Mask]], kernel: Kernel
    ) -> Iterator[tuple[Piece, tuple[Pixels, Mask]]]:
        """The pieces with what was made of them, in their order; a few ahead are in the making."""
        tile = 2 * block_size(self.raster)
        pieces = cut(self.pixels, tile, kernel.margins, self.raster.pixel_bytes)
        if self.workers == 1:
            for piece in pieces:
                yield piece, made(piece)
            return
        with ThreadPoolExecutor(self.workers) as pool:
            ahead: deque[tuple[Piece, Future[tuple[Pixels, Mask]]]] = deque()
            try:
                for piece in pieces:
                    ahead.append((piece, pool.submit(made, piece)))
                    if len(ahead) > self.workers + 1:
                        first, future = ahead.popleft()
                        yield first, future.result()
                while ahead:
                    first, future = ahead.popleft()
                    yield first, future.result()
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    @property
    def workers(self) -> int:
        """How many pieces are in the making at once."""
        return min(self.threads, MOST_THREADS)

    @property
    def needs_mask(self) -> bool:
        """Whether the target has a mask: the source has one, or it has no other way to say what lies outside of it."""
        raster = self.raster
        if raster.masked:
            return True
        if raster.alpha or raster.nodata is not None:
            return False
        edge = self.pixels(self.pixels.target.outline())
        size = (self.pixels.source.width, self.pixels.source.height)
        return not bool((np.isfinite(edge) & (edge >= 0) & (edge <= size)).all())

    @contextmanager
    def _target(self, path: Path) -> Iterator[tuple[Any, bool]]:
        """The file to write, with all that the source says of its bands."""
        import rasterio
        from rasterio.crs import CRS

        grid, raster = self.pixels.target, self.raster
        block = block_size(raster)
        profile: dict[str, Any] = {
            "driver": "GTiff",
            "width": grid.width,
            "height": grid.height,
            "count": raster.count,
            "dtype": raster.dtype,
            "crs": CRS.from_wkt(grid.wkt),
            "transform": grid.geotransform(),
            "nodata": raster.nodata,
            "tiled": True,
            "blockxsize": block,
            "blockysize": block,
            "interleave": "pixel",
            "sparse_ok": True,
            "bigtiff": "IF_SAFER",
        }
        with rasterio.open(path, "w", **profile) as target:
            with open_raster(raster.path) as source:
                describe(source, target)
            mask = self.needs_mask
            if mask:
                from rasterio.windows import Window

                target.write_mask(np.zeros((1, 1), dtype=bool), window=Window(0, 0, 1, 1))
            yield target, mask


class _Readers:
    """Handles of the source, which may not be shared: one for each piece in the making.

    A raster in strips has a single one, since what one handle has read is of no use to another.
    """

    def __init__(self, raster: Raster, count: int) -> None:
        self._raster = raster
        self._count = count
        self._free: SimpleQueue[Any] = SimpleQueue()
        self._stack = ExitStack()

    def __enter__(self) -> _Readers:
        for _ in range(self._count):
            self._free.put(self._stack.enter_context(open_raster(self._raster.path)))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def read(self, piece: Piece) -> tuple[Pixels, Mask | None]:
        """The source's pixels that a piece needs, and its mask where it has one."""
        from rasterio.errors import RasterioError

        at = _window(piece.source)
        dataset = self._free.get()
        try:
            values: Pixels = dataset.read(window=at)
            return values, dataset.read_masks(1, window=at) > 0 if self._raster.masked else None
        except RasterioError as error:
            why = first_line(error.__cause__ if isinstance(error.__cause__, Exception) else error)
            raise InputError(
                f"{self._raster.path} is damaged near row {piece.source.row} ({why}); copy or export it again."
            ) from error
        finally:
            self._free.put(dataset)


def _window(window: Any) -> Any:
    from rasterio.windows import Window

    return Window(window.column, window.row, window.width, window.height)
