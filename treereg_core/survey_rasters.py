"""The rasters of two surveys: checked before the work, moved when the registration may be used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from treereg_core import io
from treereg_core.errors import InputError
from treereg_core.survey import Survey
from treereg_core.transform import Affine, FloatArray

KINDS = ("visible", "dem")


@dataclass(frozen=True)
class RasterPlan:
    """What will be moved and how: by kind the source's raster and the reference's, if any, both checked."""

    options: io.RasterOptions
    rasters: Mapping[str, tuple[io.Raster, io.Raster | None]]
    warnings: tuple[str, ...]

    def write(
        self, motion: io.Motion, folder: Path, progress: Callable[[str, float], None]
    ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Write the moved rasters into a folder; gives the names of the files, and warnings."""
        names: list[str] = []
        warnings: list[str] = []
        for kind, (source, reference) in self.rasters.items():
            job = io.raster_job(source, motion, reference.grid if reference else None, self.options, folder)
            path = folder / f"{kind}_registered.tif"
            warnings += [warning for warning in job.warnings if warning not in self.warnings]
            warnings += job.write(path, lambda share, kind=kind: progress(kind, share))  # type: ignore[misc]
            names += [file.name for file in job.files(path)]
        return tuple(names), tuple(warnings)


def raster_plan(surveys: tuple[Survey, Survey], options: io.RasterOptions, folder: Path) -> RasterPlan:
    """Check the rasters of reference and source before any work, for files that will be written to `folder`.

    Raises `InputError` for one that is damaged, lies elsewhere than its trees, or would not fit on the disk.
    """
    rasters: dict[str, tuple[io.Raster, io.Raster | None]] = {}
    warnings: list[str] = []
    for kind in KINDS:
        reference, source = (_checked(survey, getattr(survey, kind)) for survey in surveys)
        if source is None:
            continue
        rasters[kind] = (source, reference)
        warnings += [*source.warnings, *(reference.warnings if reference else ())]
        if reference and reference.layout != source.layout:
            warnings.append(
                f"{source.path} has {source.layout}, but {reference.path} {reference.layout}; the source's are kept."
            )
        still = io.Motion(surveys[0].frame.crs, Affine.identity())
        onto = reference.grid if reference and options.extent is io.Extent.REFERENCE else None
        io.check_raster_space(source, onto or source.grid, still, options, folder)
    return RasterPlan(options, rasters, tuple(warnings))


def _checked(survey: Survey, path: Path | None) -> io.Raster | None:
    """A raster of a survey, which must lie where its trees are."""
    if path is None:
        return None
    trees = survey.features.xy + np.asarray(survey.frame.origin)
    raster = io.read_raster(path, (survey.frame.crs, trees))
    if not _overlap(io.raster_outline(raster, survey.frame.crs), trees):
        raise InputError(
            f"{path} does not lie where the trees of its survey are; correct its georeference, or leave rasters out "
            "with --rasters none."
        )
    return raster


def _overlap(outline: FloatArray, points: FloatArray) -> bool:
    """Whether the boxes of two sets of points share ground; not where a coordinate is not finite."""
    apart = (outline.max(axis=0) < points.min(axis=0)) | (points.max(axis=0) < outline.min(axis=0))
    return bool(np.isfinite(outline).all() and not apart.any())
