"""Planting rows by ant colony optimisation."""

from __future__ import annotations

from math import nan

from pydantic import Field

from treereg_aco.habits import Habits
from treereg_core.errors import NoRegistration
from treereg_core.features import FeatureSet
from treereg_core.method import Context, RowDetector
from treereg_core.pair import Rows

# Fewer trees than this are not called rows.
LEAST_TREES = 6


class Aco(RowDetector):
    """Rows by ant colony optimisation (Dorigo, Maniezzo & Colorni 1996, doi:10.1109/3477.484436; Simons 2020).

    T. Simons' honours project (University of Cape Town, 2020) lets ants walk over the graph of near trees: one goes
    from tree to tree one way, turns and goes the other; of the nearest trees ahead it considers those that none is
    both nearer and straighter than, and chooses by pheromone and by a heuristic of distance and angle. Good rows
    leave pheromone, it evaporates, and after some iterations the best rows are taken out, until no tree is left that
    a row can start from. Then pieces are stitched.

    Here the ants measure distance as the orchard does. The direction of the rows and both spacings are known at every
    tree from the waves that rows make (the peaks of the structure factor in small windows), so along a row is near
    and across it is far, on curves too. A row's quality is how much likelier its trees are a row than strangers, so
    dragging in a false detection does not pay, and a missing tree costs little. Each elite row is bettered by dynamic
    programming in its own corridor; what the rows of a first search show of trees and strangers (scatter, confidence,
    crown) guides a second one. Rows that run another way, such as headlands, are found among the trees left over.
    Rows end at paths, where gaps of many rows stand in line.

    Good for rows straight, curved or along contours, single or in pairs, also with a third of the trees missed and a
    third false; a square planting has no rows of its own, and gets those along its longer side. A forest is refused.
    Rows are good to some 0.98 of their steps; see docs/rows.md for figures.
    """

    name = "aco"

    neighbours: int = Field(4, ge=1, le=8, description="trees from which an ant chooses its next, the nearest (n_p)")
    ants: int = Field(15, ge=1, le=1000, description="ants in each iteration")
    iterations: int = Field(15, ge=1, le=1000, description="iterations before the best rows are taken out")
    elites: int = Field(5, ge=1, le=100, description="rows taken out at a time, the best of the elite set (m_e)")
    pheromone_power: float = Field(0.5, ge=0, le=5, description="weight of pheromones in an ant's choice (alpha)")
    heuristic_power: float = Field(0.5, ge=0, le=5, description="weight of the heuristic in an ant's choice (beta)")
    evaporation: float = Field(0.1, ge=0, lt=1, description="share of pheromones lost in each iteration (p)")
    deposit_window: int = Field(5, ge=1, le=99, description="steps of a row over which deposits are averaged (q)")
    distance_weight: float = Field(1.0, ge=0, le=10, description="weight of nearness in the heuristic (w1)")
    angle_weight: float = Field(0.0, ge=0, le=10, description="weight of straightness in the heuristic (w2)")
    angle_limit: float | None = Field(
        None,
        ge=90,
        le=180,
        description="sharpest angle of an ant's way at a tree, 180 being straight; without it chosen from the survey",
        json_schema_extra={"unit": "deg"},
    )
    reach: float = Field(
        3.4, gt=1, le=4.5, description="longest step of an ant", json_schema_extra={"unit": "in-row spacings"}
    )
    stitching_reach: float = Field(
        10.0,
        ge=0,
        le=100,
        description="longest gap over which two pieces of a row are joined",
        json_schema_extra={"unit": "in-row spacings"},
    )

    def detect(self, features: FeatureSet, context: Context) -> Rows:
        """The rows of one survey. Raises `NoRegistration` where its trees stand in no rows."""
        if len(features) < LEAST_TREES or features.spacing == 0:
            raise NoRegistration(f"{len(features)} trees are too few, or too close together, to show rows")
        from treereg_aco.compiled import is_compiled
        from treereg_aco.layers import all_rows

        if not is_compiled():
            context.progress("aco: compiling, once; this takes a quarter of a minute")
        habits = Habits(**self.model_dump())
        if self.angle_limit is None:
            habits = habits._replace(angle_limit=nan)
        return Rows(tuple(all_rows(features, habits, lambda layer: context.rng(self.name, layer))))
