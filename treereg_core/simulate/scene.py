"""Scene: everything that describes one simulated pair of surveys."""

from __future__ import annotations

import math
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.config import JsonDict

_METRES: JsonDict = {"unit": "m"}
_DEGREES: JsonDict = {"unit": "deg"}

FEWEST_BETWEEN_PATHS = 4
"""Trees of a row, on average, from one path to the next or to the end of the row."""


class Scene(BaseModel):
    """An orchard, two surveys of it and how the second one is misplaced.

    Use it with `simulate(scene, seed)`; the same scene and seed give the same surveys. The defaults are an ordinary
    drone survey of a planted orchard. All shares are between 0 and 1, unless their range says otherwise.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    # The orchard
    trees: int = Field(
        1500, ge=10, le=2_000_000, description="planting positions, roughly; gaps included, headlands not"
    )
    row_spacing: float = Field(5.5, gt=0, le=100, description="distance between rows", json_schema_extra=_METRES)
    spacing: float = Field(3.0, gt=0, le=100, description="distance between trees in a row", json_schema_extra=_METRES)
    curve: float = Field(
        0.0, ge=0, le=1000, description="bow of the rows, from the chord to the middle", json_schema_extra=_METRES
    )
    contour: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="how far rows that follow a slope sway aside, RMS, in waves of 0.4 to 1.2 times the field's length",
        json_schema_extra=_METRES,
    )
    hedgerow: float = Field(
        0.0,
        ge=0,
        le=50,
        description="distance between the two staggered rows of a double row, whose centre lines are a row spacing "
        "apart; 0: single rows",
        json_schema_extra=_METRES,
    )
    paths: int = Field(0, ge=0, le=20, description="lanes across the rows; they end rows, and trees make way for them")
    path_width: float = Field(
        5.0,
        gt=0,
        le=50,
        description="how much farther apart a path puts the trees on both sides",
        json_schema_extra=_METRES,
    )
    headlands: int = Field(
        0, ge=0, le=5, description="rows planted across, a row spacing apart, beyond each of the two ends of the rows"
    )
    outline: Literal["rectangle", "irregular"] = Field(
        "irregular", description="the block's shape: along the rows, or a random polygon turned against them"
    )
    planting_jitter: float = Field(
        0.15, ge=0, description="planting error, sd per axis; the same in both surveys", json_schema_extra=_METRES
    )
    gaps: float = Field(0.05, ge=0, le=0.9, description="share of single positions without a tree")
    holes: int = Field(0, ge=0, le=50, description="compact areas without trees, each about 1 % of the orchard")
    periodic: bool = Field(
        False,
        description="a perfect lattice: straight single rows in a rectangle, no planting error, paths, headlands, gaps "
        "or holes, equal crowns and confidences; it has no unique truth",
    )

    # The crowns
    crown_cover: float = Field(
        0.35,
        gt=0,
        le=1,
        description="median crown area as a share of row spacing x spacing (half of it in double rows), at "
        "most 25 square metres",
    )
    area_variation: float = Field(
        0.3, ge=0, le=2, description="sd of the natural logarithm of measured crown areas, smooth trend aside"
    )
    area_persistence: float = Field(
        0.6, ge=0, le=1, description="correlation of those logarithms between the surveys; 0: areas say nothing"
    )
    vigour: float = Field(0.15, ge=0, le=2, description="sd of the smooth trend in log crown area over the field")
    growth: float = Field(1.1, gt=0, le=10, description="factor on crown width from reference to source")
    dead: float = Field(0.01, ge=0, le=1, description="share of trees that died between reference and source")

    # What only elevation and images show
    height: float = Field(
        3.0, gt=0, le=60, description="height of a tree with a usual crown", json_schema_extra=_METRES
    )
    height_variation: float = Field(
        0.12, ge=0, le=2, description="sd of the natural logarithm of heights, apart from what follows from the crown"
    )
    height_persistence: float = Field(
        0.8, ge=0, le=1, description="correlation of those logarithms between the surveys; 0: they say nothing"
    )
    slope: float = Field(0.06, ge=0, le=1, description="rise of the ground, metres per metre, in a random direction")
    undulation: float = Field(
        0.5, ge=0, le=100, description="gentle waves of the ground on that slope, RMS", json_schema_extra=_METRES
    )

    # What a survey makes of it
    jitter: float = Field(
        0.2, ge=0, description="detection error, sd per axis, new in each survey", json_schema_extra=_METRES
    )
    missed: float = Field(0.05, ge=0, le=1, description="share of trees that a survey misses")
    false: float = Field(0.05, ge=0, le=10, description="false detections, as a share of the trees in view")
    split: float = Field(0.01, ge=0, le=1, description="share of trees that a survey sees as two canopies")
    merged: float = Field(0.01, ge=0, le=1, description="share of trees that a survey joins with the next in the row")
    confidence: float = Field(0.8, gt=0, lt=1, description="median confidence of true detections")
    confidence_variation: float = Field(1.2, ge=0, le=10, description="sd of the confidences' log-odds")
    confidence_information: float = Field(
        0.5,
        ge=0,
        le=1,
        description="correlation of a tree's confidence between the surveys, in log-odds; false detections lie "
        "2.5 times this many standard deviations lower",
    )

    # Which part each survey sees
    overlap: float = Field(
        1.0, ge=0.05, le=1, description="share of the reference's view that the source sees too; 1: both see everything"
    )
    crop: Literal["strips", "windows", "ends", "part"] = Field(
        "strips",
        description="how views are cut: strips (both, two parallel lines each), windows (both, on all sides), ends "
        "(each misses a different end), part (the source sees a part of the reference)",
    )

    # How the source is misplaced
    rotation: float | Literal["any"] | None = Field(
        None,
        description="how far the source is turned about the orchard's centre, counter-clockwise; any: uniform; "
        "without it drawn with --rotation-sd",
        json_schema_extra=_DEGREES,
    )
    rotation_sd: float = Field(1.0, ge=0, description="sd of a drawn rotation", json_schema_extra=_DEGREES)
    shift: tuple[float, float] | None = Field(
        None,
        description="how far it is then shifted, x and y; without it drawn with --shift-sd",
        json_schema_extra=_METRES,
    )
    shift_sd: float = Field(3.0, ge=0, description="sd per axis of a drawn shift", json_schema_extra=_METRES)
    distortion: float = Field(
        0.0,
        ge=0,
        description="smooth displacement of the source, waves of 0.5 to 1.5 field sizes; nine trees in ten move less",
        json_schema_extra=_METRES,
    )
    same_orchard: bool = Field(True, description="whether both show the same orchard; if not, there is no truth")
    other_scale: float = Field(
        1.0, gt=0, le=10, description="factor on all spacings in the source's orchard where that is another one"
    )

    @property
    def rows_together(self) -> int:
        """Rows in each place of a row: 2 in double rows, else 1."""
        return 2 if self.hedgerow > 0 else 1

    @model_validator(mode="after")
    def _rows_keep_apart(self) -> Self:
        if self.hedgerow > self.row_spacing / 2:
            raise ValueError(
                f"The two rows of a hedgerow are {self.hedgerow:g} m apart, more than half the row spacing of "
                f"{self.row_spacing:g} m: ask for a smaller hedgerow, or for a larger row spacing."
            )
        return self

    @model_validator(mode="after")
    def _pieces_are_rows(self) -> Self:
        in_a_row = math.sqrt(self.trees / self.rows_together * self.row_spacing / self.spacing)
        most = max(0, int(in_a_row / FEWEST_BETWEEN_PATHS) - 1)
        if self.paths > most:
            raise ValueError(
                f"Rows of about {in_a_row:.0f} trees are too short for {self.paths} paths: ask for "
                f"{f'at most {most}, or for' if most else 'none, or for'} more trees."
            )
        return self
