"""Small survey folders for the tests of reading and writing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

CRS = "EPSG:32734"
ORIGIN = (343_000.0, 6_306_000.0)
"""An orchard near Ceres, South Africa, in UTM zone 34 S."""


def grid(rows: int = 3, trees: int = 4, row_spacing: float = 5.0, spacing: float = 3.0) -> np.ndarray:
    """Tree positions (n, 2) about the orchard's corner, metres, slightly off the grid."""
    xy = np.array([(i * spacing, j * row_spacing) for j in range(rows) for i in range(trees)], dtype=float)
    return xy + np.random.default_rng(1).normal(0, 0.1, xy.shape)


def square(centre: Any, side: float = 2.0, crs: str = CRS, origin: tuple[float, float] = ORIGIN) -> list[list[float]]:
    """A closed ring of a square about a point of the working frame, in longitude and latitude."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * side / 2 + np.asarray(centre) + origin
    return lonlat(corners, crs).tolist()


def lonlat(full: np.ndarray, crs: str = CRS) -> np.ndarray:
    """Full projected coordinates to longitude and latitude."""
    return np.column_stack(pyproj.Transformer.from_crs(crs, "OGC:CRS84", always_xy=True).transform(*full.T))


def polygon(ring: list[list[float]], *holes: list[list[float]]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [ring, *holes]}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def trees(xy: np.ndarray | None = None, confidence: float = 0.5, **frame: Any) -> list[dict[str, Any]]:
    """One square canopy with a confidence at each point."""
    points = grid() if xy is None else xy
    return [feature(polygon(square(point, **frame)), confidence=confidence) for point in points]


def collection(features: list[Any], **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", **members, "features": features}


def survey(
    folder: Path, features: list[Any] | None = None, name: str = "raw-detections.geojson", **members: Any
) -> Path:
    """Write a survey folder whose detections are these features."""
    return raw(folder, json.dumps(collection(trees() if features is None else features, **members)), name)


def raw(folder: Path, content: str | bytes, name: str = "raw-detections.geojson") -> Path:
    """Write a survey folder whose detections file holds exactly this."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


def table(folder: Path, suffix: str, crs: str | None = "EPSG:4326", **columns: Any) -> Path:
    """Write the usual trees as a GeoPackage or GeoParquet in this CRS; None: unknown, coordinates as in WGS 84."""
    import geopandas
    import shapely

    shapes = [shapely.Polygon(f["geometry"]["coordinates"][0]) for f in trees()]
    frame = geopandas.GeoDataFrame(columns or {"confidence": [0.5] * len(shapes)}, geometry=shapes, crs="EPSG:4326")
    frame = frame.set_crs(None, allow_override=True) if crs is None else frame.to_crs(crs)
    folder.mkdir(exist_ok=True)
    if suffix == "gpkg":
        import pyogrio

        pyogrio.write_dataframe(frame, folder / "raw-detections.gpkg")
    else:
        frame.to_parquet(folder / "raw-detections.parquet")
    return folder
