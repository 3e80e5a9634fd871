"""Scene: everything that describes one simulated pair of surveys."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

_METRES: JsonDict = {"unit": "m"}
_DEGREES: JsonDict = {"unit": "deg"}


class Scene(BaseModel):
    """An orchard, two surveys of it and how the second one is misplaced.

    Use it with `simulate(scene, seed)`; the same scene and seed give the same surveys. The defaults are an ordinary
    drone survey of a planted orchard. All shares are between 0 and 1, unless their range says otherwise.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    # The orchard
    trees: int = Field(1500, ge=10, le=2_000_000, description="planting positions, roughly; gaps included")
    row_spacing: float = Field(5.5, gt=0, le=100, description="distance between rows", json_schema_extra=_METRES)
    spacing: float = Field(3.0, gt=0, le=100, description="distance between trees in a row", json_schema_extra=_METRES)
    curve: float = Field(
        0.0, ge=0, le=1000, description="bow of the rows, from the chord to the middle", json_schema_extra=_METRES
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
        description="a perfect lattice: straight rows in a rectangle, no planting error, gaps or holes, equal "
        "crowns and confidences; it has no unique truth",
    )

    # The crowns
    crown_cover: float = Field(
        0.35, gt=0, le=1, description="median crown area as a share of row spacing x spacing, at most 25 square metres"
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
        1.0, gt=0, le=10, description="factor on both spacings in the source's orchard where that is another one"
    )
