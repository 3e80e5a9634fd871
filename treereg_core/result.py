"""Result: everything that a run found out, and the registration.json made of it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from treereg_core import io
from treereg_core.errors import InputError, UsageError
from treereg_core.features import FeatureSet
from treereg_core.heights import VerticalOffset, vertical_offset
from treereg_core.judgement import Judgement, Matches, Verdict
from treereg_core.method import Described
from treereg_core.pair import MatchedRows
from treereg_core.plan import Plan
from treereg_core.survey import Frame, Stamp, Survey
from treereg_core.transform import Affine, FloatArray, Model, Rigid

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from matplotlib.axes import Axes

SCHEMA = "treereg/registration/1"
LOG_ODDS_LIMIT = 1e6


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a run found out; `to_json()` is the content of registration.json. In a notebook it shows itself as a card.

    `reference` and `source` are in one working frame; so are the transforms of the judgement. `timings` are seconds.
    `warnings` are sentences for people on what went wrong beside the registration. `described` is what the filters know
    of the reference's and of the source's usable trees at the placement: by name, arrays in the order of the features.
    `rows` are those that the stages went through; None where the method looked for none.
    """

    plan: Plan
    reference: Survey | FeatureSet
    source: Survey | FeatureSet
    judgement: Judgement
    timings: Mapping[str, float]
    warnings: tuple[str, ...] = ()
    described: Described = ({}, {})
    rows: MatchedRows | None = None

    @property
    def accepted(self) -> bool:
        """Whether the judge accepted the placement."""
        return self.judgement.verdict is Verdict.ACCEPTED

    @property
    def transform(self) -> Affine | None:
        """`reference_from_source` in the working frame; None when the verdict is `failed`."""
        return self.judgement.transform

    @property
    def frame(self) -> Frame | None:
        """The working frame; None for trees that were given as plain arrays."""
        return self.reference.frame if isinstance(self.reference, Survey) else None

    @property
    def stamps(self) -> Mapping[Path, Stamp]:
        """Those of both surveys' files when they were read; none for trees that come from no file."""
        read = [survey.stamps for survey in (self.reference, self.source) if isinstance(survey, Survey)]
        return {file: stamp for stamps in read for file, stamp in stamps.items()}

    @property
    def vertical_offset(self) -> VerticalOffset | None:
        """What the source's elevations lack against the reference's, over the matched trees; None where not known."""
        if not isinstance(self.reference, Survey) or not isinstance(self.source, Survey):
            return None
        if self.reference.heights is None or self.source.heights is None:
            return None
        ids = self.judgement.matches.pairs
        at = [survey.features.positions(ids[:, k]) for k, survey in enumerate((self.reference, self.source))]
        return vertical_offset(self.reference.heights, self.source.heights, np.column_stack(at))

    @property
    def comparable(self) -> int:
        """How many trees can be matched at most: those of the smaller survey."""
        return min(len(trees(self.reference)), len(trees(self.source)))

    @property
    def all_warnings(self) -> tuple[str, ...]:
        """What was said on reading the surveys, and then."""
        read = [survey.warnings for survey in (self.reference, self.source) if isinstance(survey, Survey)]
        return (*(warning for warnings in read for warning in warnings), *self.warnings)

    def apply(self, things: Any, *, force: bool = False) -> Any:
        """Anything of the source survey, moved as its trees are: a GeoDataFrame in the CRS it has, or points (n, 2).

        Points are full coordinates in the working CRS (`result.frame.crs`), metres, or, where the surveys were given as
        arrays, in their frame. Raises `UsageError` for a result that is not accepted, unless there is a placement and
        `force` is given; `InputError` for points that are not (n, 2) finite numbers, or features without a CRS.
        """
        motion = self._motion(self._usable(force))
        if io.is_geoframe(things):
            return io.move_geoframe(things, motion)
        points = points_of(things, "points")
        return (motion if isinstance(motion, Affine) else motion.reference_from_source)(points)

    def registered(self, crs: str | None = None, *, force: bool = False) -> GeoDataFrame:
        """The content of detections_registered.geojson as a GeoDataFrame in the working CRS, or in `crs`.

        Its index is that of the GeoDataFrame the source was given as, or counts the features of the source's file, less
        whatever heights positions have there. Trees given as arrays become points without a CRS. Raises `UsageError`
        as `apply` does, `InputError` for a CRS that is unknown or does not reach here, and for surveys whose files are
        no longer those that were read.
        """
        with io.unchanged(self.stamps):
            return io.registered_geoframe(self.source, self._motion(self._usable(force)), self.described, crs)

    def matches(self, crs: str | None = None, *, force: bool = False) -> GeoDataFrame:
        """The content of tree_matches.geojson as a GeoDataFrame: a line from each moved source tree to its partner.

        `reference` and `source` are labels in the indices of the surveys: `reference.loc[result.matches().reference]`
        are the matched trees. Raises what `registered` does.
        """
        surveys: Any = (self.reference, self.source)
        return io.matches_geoframe(surveys, self._usable(force), self.judgement.matches, self.described, crs)

    def plot(self, show: str = "after", *, ax: Axes | None = None, width_m: float | None = None) -> Axes:
        """Draw both surveys' canopies `after` or `before` registration, or the `residuals` of the pairs as arrows.

        Axes are full coordinates, metres; `width_m` shows so much of the middle alone. Crowns without a partner are
        filled darker. A result of any verdict can be drawn; without a placement, as the files' own georeference has it.
        Needs matplotlib (`pip install treereg[plot]`); draws into `ax`, or a new figure, and gives the axes back.
        """
        from treereg_core.notebook.plotting import plot

        return plot(self, show, ax, width_m)

    def save(self, folder: str | Path, *, force: bool = False, overwrite: bool = False) -> None:
        """Write the files of `treereg run` into a folder, the rasters of survey folders among them.

        `force` and `overwrite` are as there. Raises `UsageError` for trees that were given as arrays, and for a folder
        that must not be written into; `InputError` for one that cannot be, a raster that cannot be used, or surveys
        whose files are no longer those that were read.
        """
        from treereg_core.outputs import write_result
        from treereg_core.survey_rasters import raster_plan

        if not isinstance(self.reference, Survey) or not isinstance(self.source, Survey):
            raise UsageError("trees that are given as arrays have no CRS, so there are no files of them")
        surveys = self.reference, self.source
        inputs = [survey.path for survey in surveys if survey.table is None]
        with io.OutputFolder(Path(folder), inputs=inputs, overwrite=overwrite) as place:
            options = io.RasterOptions(threads=min(self.plan.options.threads, os.cpu_count() or 1))
            write_result(self, place, force, raster_plan(surveys, options, place))

    def __repr__(self) -> str:
        said = self.judgement
        error = "" if said.expected_error is None else f", expected error {said.expected_error.rms:.3f} m"
        return (
            f"<Result {said.verdict.value}: {len(said.matches.pairs)} of {self.comparable} trees matched{error}, "
            f"failure probability {said.failure_probability:.2g}>"
        )

    def _repr_html_(self) -> str:
        from treereg_core.notebook.card import card

        return card(self)

    def _usable(self, force: bool) -> Affine:
        """The placement, if it may be used."""
        said = self.judgement
        if said.transform is None:
            raise UsageError(f"there is no placement to use: {said.reason}")
        if not self.accepted and not force:
            raise UsageError(
                f"the result is {said.verdict.value} and not to be used as it stands ({said.reason}); "
                "look at result.plot(), and give force=True to use it all the same"
            )
        return said.transform

    def _motion(self, transform: Affine) -> io.Motion | Affine:
        """The transform in full coordinates, with their CRS where there is one."""
        full = self.full_coordinates(transform)
        return io.Motion(self.frame.crs, full) if self.frame else full

    def full_coordinates(self, transform: Affine) -> Affine:
        """A transform of the working frame in full projected coordinates."""
        return transform.about(-np.asarray(self.frame.origin)) if self.frame else transform

    def to_json(self) -> dict[str, Any]:
        """The content of registration.json: plain values, every number finite."""
        said, offset = self.judgement, self.vertical_offset
        return {
            "schema": SCHEMA,
            "method": self.plan.options.method,
            "settings": self.plan.settings,
            "start": self.plan.options.start,
            "seed": self.plan.options.seed,
            "version": metadata.version("treereg"),
            "plugins": self.plan.plugins,
            "reference": survey_json(self.reference),
            "source": survey_json(self.source),
            "crs": self.frame.crs if self.frame else None,
            "verdict": said.verdict.value,
            "reason": said.reason,
            "transform": self._transform_json(),
            **matches_json(said.matches),
            "expected_error_m": said.expected_error
            and {"rms": float(said.expected_error.rms), "ci95": [float(bound) for bound in said.expected_error.ci95]},
            "failure_probability": float(said.failure_probability),
            "rivals": [
                {
                    "matrix": self.full_coordinates(rival.transform).matrix.tolist(),
                    "log_odds": float(np.clip(rival.log_odds, -LOG_ODDS_LIMIT, LOG_ODDS_LIMIT)),
                }
                for rival in said.rivals
            ],
            "before": matches_json(said.before),
            "timings_s": {name: round(seconds, 4) for name, seconds in self.timings.items()},
            **({"vertical_offset_m": asdict(offset)} if offset else {}),
        }

    def _transform_json(self) -> dict[str, Any] | None:
        transform, frame = self.judgement.transform, self.frame
        if transform is None:
            return None
        return transform_json(transform, trees(self.source), frame.origin if frame else (0.0, 0.0))


def transform_json(transform: Affine, source: FeatureSet, origin: tuple[float, float]) -> dict[str, Any]:
    """A transform `reference_from_source` as files have it: its matrix in full coordinates, and numbers to read.

    `source` are the trees at whose centroid the shift is given. Both are in coordinates less `origin`, metres.
    """
    centroid = source.xy.mean(axis=0, keepdims=True)
    return {
        "model": next(model.value for model in Model if isinstance(transform, model.kind)),
        "matrix": transform.about(-np.asarray(origin)).matrix.tolist(),
        "rotation_deg": transform.rotation_deg,
        "translation_m": (transform(centroid) - centroid)[0].tolist(),
        **({} if isinstance(transform, Rigid) else {"scale": transform.scale}),
    }


def trees(survey: Survey | FeatureSet) -> FeatureSet:
    """The usable trees of a survey, or the trees themselves."""
    return survey.features if isinstance(survey, Survey) else survey


def points_of(values: Any, name: str) -> FloatArray:
    """Points (n, 2), checked. `InputError` for what is none, with their name."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"the {name} are not numbers; give an array (n, 2), east and north in metres.") from None
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"the {name} have the shape {points.shape}; give an array (n, 2), east and north in metres.")
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        raise InputError(
            f"the {name} hold a number that is not finite at {wrong[0]} (counted from 0); mend or remove it."
        )
    return points


def survey_json(survey: Survey | FeatureSet) -> dict[str, Any]:
    """Path, features in the file and usable ones; no path for a survey that was given as a GeoDataFrame or arrays."""
    if isinstance(survey, Survey):
        path = str(survey.path) if survey.table is None else None
        return {"path": path, "features": survey.count, "used": len(survey.features)}
    return {"path": None, "features": len(survey), "used": len(survey)}


def matches_json(matches: Matches) -> dict[str, Any]:
    """How many trees are matched, and how far apart they are."""
    return {"matched": len(matches.pairs), "residual_rms_m": matches.residual_rms}
