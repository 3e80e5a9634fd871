"""Survey: one dated capture of one orchard, read into the working frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from treereg_core.features import FeatureSet
from treereg_core.heights import Heights
from treereg_core.outlines import Outlines

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from shapely import Geometry


Stamp = tuple[int, int] | None
"""What changes when a file does: its size and time of change; None where there is no file."""


@dataclass(frozen=True)
class Frame:
    """The working frame: projected coordinates in `crs`, in metres, less a local origin.

    - `crs`: an authority code (`EPSG:32734`) where there is one, else WKT 2; east before north.
    - `origin`: full coordinates (easting, northing) of the local origin, whole metres. Arithmetic is done about it,
      because northings of six million metres eat digits.
    """

    crs: str
    origin: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Survey:
    """One dated capture of one orchard.

    - `path`: the survey's folder; `detections`: the file of canopy polygons in it.
    - `table`: the GeoDataFrame that the survey was given as, None for a folder; with one, `path` and `detections` are
      only its name in messages.
    - `features`: its usable trees; `xy` in metres in `frame`, `area` in square metres, `ids` the features' indices in
      the file, counted from 0.
    - `count`: the features in the file, unusable ones included.
    - `digest`: of the outlines and confidences as they stand in the file, the same in every frame and folder.
    - `boundary`: the orchard's outline in `frame`, metres, or None. It is of the reference's making, so it must not
      crop a source that is not registered yet.
    - `heights`: of the usable trees, by the survey's elevation raster, or None; where enough of them have one, the
      features have the attribute `height` too.
    - `warnings`: one sentence each, for stderr.
    - `visible`, `dem`: the rasters in the folder, not read yet.
    - `outlines`: of the usable trees, in `frame`, or None where only their centroids are known.
    - `stamps`: of its files when they were read, so that it is seen when they are no longer the same.
    """

    path: Path
    detections: Path
    features: FeatureSet
    frame: Frame
    count: int
    digest: str
    boundary: Geometry | None = None
    heights: Heights | None = None
    table: GeoDataFrame | None = None
    warnings: tuple[str, ...] = ()
    visible: Path | None = None
    dem: Path | None = None
    outlines: Outlines | None = None
    stamps: Mapping[Path, Stamp] = field(default_factory=dict)
