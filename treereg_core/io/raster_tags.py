"""What a raster says of itself beside its pixels, from one open file to another."""

from __future__ import annotations

from typing import Any

STRUCTURE = frozenset(
    {"IMAGE_STRUCTURE", "DERIVED_SUBDATASETS", "SUBDATASETS", "RPC", "GEOLOCATION", "TIFF", "COLOR_PROFILE"}
)
"""What GDAL says of the file and of the old georeference, which is not true of another file."""


def describe(source: Any, target: Any) -> None:
    """Give one open raster what another says: tags, names, units, scales, colours. Statistics go: they are outdated."""
    from rasterio.enums import ColorInterp

    for space in [None, *(space for space in source.tag_namespaces() if space not in STRUCTURE)]:
        _tag(target, source.tags(ns=space), space, 0)
    for band in source.indexes:
        for space in [None, *(space for space in source.tag_namespaces(band) if space not in STRUCTURE)]:
            _tag(target, source.tags(band, ns=space), space, band)
        if source.colorinterp[band - 1] is ColorInterp.palette:
            target.write_colormap(band, source.colormap(band))
    target.colorinterp = source.colorinterp
    for band, (name, unit) in enumerate(zip(source.descriptions, source.units, strict=True), start=1):
        if name:
            target.set_band_description(band, name)
        if unit:
            target.set_band_unit(band, unit)
    target.scales, target.offsets = source.scales, source.offsets


def _tag(target: Any, tags: dict[str, str], space: str | None, band: int) -> None:
    kept = {name: value for name, value in tags.items() if not name.startswith("STATISTICS_")}
    if kept:
        target.update_tags(band, ns=space, **kept)
