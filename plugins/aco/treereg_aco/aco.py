"""Planting rows by ant colony optimisation."""

from __future__ import annotations

from math import cos, radians
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from treereg_core.errors import NoRegistration
from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.method import Context, RowDetector
from treereg_core.pair import Rows
from treereg_core.transform import FloatArray

if TYPE_CHECKING:
    from treereg_aco.colony import Habits
    from treereg_aco.frames import Frames
    from treereg_aco.model import RowModel

# Fewer trees than this are not called rows.
LEAST_TREES = 6
# Rows are looked for among all trees, then among those left over, and once more: where some run another way.
LAYERS = 3
# Of rows that run another way so many trees belong to no other row.
STRANGE = 0.5
# A step this many times longer than the row's usual one sets the trees beyond it apart, up to so many.
WIDE, LOOSE = 1.4, 3
# So many standard deviations of what errors of planting and detection make of a straight row are a turn of the row; the
# sharpest turns that are always and ever allowed, degrees.
TURN = 4.0
TURNS = (30.0, 90.0)


class Aco(RowDetector):
    """Rows by ant colony optimisation (Simons 2020, section 3.2.2 of treereg's proposal)."""

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
        description="sharpest angle of a row at a tree, 180 being straight; without it chosen from the survey",
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
        trees = upright(features)
        rows, free, frames = self.search(trees, context.rng(self.name))
        rows = self.whole(rows, trees.xy, frames)
        for layer in range(1, LAYERS):
            loose = free.copy()
            for row in rows:
                first, after = without_loose_ends(row, trees.xy)
                loose[row[:first]] = loose[row[after:]] = True
            at = np.flatnonzero(loose)
            try:
                found, _, frames = self.search(trees.take(at), context.rng(self.name, layer))
            except NoRegistration:
                break
            found = self.whole(found, trees.xy[at], frames)
            # among strangers short rows are chance, and loose ends stand in line with each other
            found = [at[row] for row in found if len(row) >= LEAST_TREES and free[at[row]].mean() >= STRANGE]
            taken = np.isin(np.arange(len(trees)), np.concatenate([*found, np.zeros(0, dtype=np.int64)]))
            rows = [row for row in (row[~taken[row]] for row in rows) if len(row) > 1] + found
            free &= ~taken
        return Rows(tuple(trees.ids[row] for row in rows))

    def whole(self, rows: list[IntArray], xy: FloatArray, frames: Frames) -> list[IntArray]:
        """The rows with their pieces joined, and ended at paths."""
        from treereg_aco.paths import ended_at_paths
        from treereg_aco.stitching import stitched

        if not rows:
            return rows
        return ended_at_paths(stitched(rows, xy, frames, self.stitching_reach), xy, frames)

    def search(self, trees: FeatureSet, rng: np.random.Generator) -> tuple[list[IntArray], BoolArray, Frames]:
        """Rows as positions of trees in order, which trees are left over (n,), and the frames of the rows."""
        if len(trees) < LEAST_TREES or trees.spacing == 0:
            raise NoRegistration(f"{len(trees)} trees are too few, or too close together, to show rows")
        from treereg_aco.colony import search
        from treereg_aco.frames import row_frames
        from treereg_aco.ground import Ground, graph_of
        from treereg_aco.model import evidence, first_model, learned

        frames = row_frames(trees)
        model = first_model(trees, frames)
        ground = Ground(trees.xy, frames.along, frames.spacing, frames.near, np.zeros(len(trees)))
        graph = graph_of(ground, self.reach, 1.6 * model.half_width, model.across)
        habits = self.habits(model, frames)
        rows, left = search(ground, graph, model, habits, rng)
        # what the first search has shown of rows and strangers teaches the second
        model = learned(model, frames, rows, trees.xy)
        ground = ground._replace(evidence=evidence(trees, ~left))
        rows, left = search(ground, graph, model, habits, rng)
        if not rows:
            raise NoRegistration(f"the {len(trees)} trees stand in no rows that can be told from chance")
        return rows, left, frames

    def habits(self, model: RowModel, frames: Frames) -> Habits:
        """The ants' settings, the angle limit chosen from the survey where it is not given."""
        from treereg_aco.colony import Habits

        turn = TURN * np.degrees(np.sqrt(6) * model.across / np.median(frames.spacing))
        sharpest = float(np.clip(turn, *TURNS)) if self.angle_limit is None else 180 - self.angle_limit
        return Habits(
            ants=self.ants,
            iterations=self.iterations,
            elites=self.elites,
            neighbours=self.neighbours,
            pheromone_power=self.pheromone_power,
            heuristic_power=self.heuristic_power,
            evaporation=self.evaporation,
            window=self.deposit_window,
            distance_weight=self.distance_weight,
            angle_weight=self.angle_weight,
            turn=cos(radians(sharpest)),
        )


def upright(features: FeatureSet) -> FeatureSet:
    """The same trees about their centre, their longest extent along x, in the order of x.

    So neither the order of trees in their file matters to what is found, nor how the survey lies on the map.
    """
    centred = features.xy - features.xy.mean(axis=0)
    axis = np.linalg.svd(centred, full_matrices=False)[2][0]
    axis *= -1 if ((centred @ axis) ** 3).sum() < 0 else 1
    xy = centred @ np.array([[axis[0], -axis[1]], [axis[1], axis[0]]])
    return features.replace(xy=xy).take(np.lexsort((features.ids, xy[:, 1], xy[:, 0])))


def without_loose_ends(row: IntArray, xy: FloatArray) -> tuple[int, int]:
    """Where a row begins and where it has ended without the few trees at its ends that stand apart from the others.

    They may belong to rows across its end. A very short row may stand across others as a whole.
    """
    if len(row) <= LOOSE:
        return len(row), len(row)
    steps = np.hypot(*np.diff(xy[row], axis=0).T)
    wide = np.flatnonzero(steps > WIDE * np.median(steps))
    head, tail = wide[wide < LOOSE], wide[wide >= max(len(steps) - LOOSE, LOOSE)]
    return (int(head[-1]) + 1 if len(head) else 0), (int(tail[0]) + 1 if len(tail) else len(row))
