"""`simulate`: two surveys of a scene, and the truth about them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from treereg_core.features import FeatureSet, IntArray, frozen_array
from treereg_core.simulate.detect import Visit, detect
from treereg_core.simulate.displacement import Displacement
from treereg_core.simulate.flight import Flight, flights_of
from treereg_core.simulate.orchard import Orchard, plant
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.view import views
from treereg_core.transform import Affine, FloatArray, Model, Rigid, Transform

_PERIODIC = {
    "outline": "rectangle",
    "curve": 0.0,
    "contour": 0.0,
    "paths": 0,
    "headlands": 0,
    "hedgerow": 0.0,
    "planting_jitter": 0.0,
    "gaps": 0.0,
    "holes": 0,
    "vigour": 0.0,
    "area_variation": 0.0,
    "confidence_variation": 0.0,
    "height_variation": 0.0,
}


@dataclass(frozen=True, eq=False)
class Trees:
    """The true trees in the reference's frame, ordered by row and along it.

    `xy` (n, 2) metres, `area` (n,) square metres at the time of the reference, `row` (n,) from 0 across the field,
    headland rows last, `column` (n,): the planting position in the row; a number left out is a gap. Both sides of a
    path are rows of their own, and so are both rows of a double row. Where the source shows another orchard, its trees
    follow those of the reference's, with rows of their own.
    """

    xy: FloatArray
    area: FloatArray
    row: IntArray
    column: IntArray

    def __post_init__(self) -> None:
        for name, kind in (("xy", np.float64), ("area", np.float64), ("row", np.int64), ("column", np.int64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), kind))

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True, eq=False)
class Simulation:
    """Two simulated surveys with their truth, about a local origin in the orchard's centre.

    - `truth`: reference_from_source; with distortion the best rigid one over all trees; None where there is none to be
      found: different orchards, or a periodic one.
    - `bend`: RMS metres that the truth leaves over the true trees, because no rigid transform can undo a smooth
      distortion; 0 without one.
    - `reference_trees`, `source_trees` (n, 2): for each feature its trees, as positions in `trees`: -1, -1 for a false
      detection, one tree and -1, or two for a merged canopy. A tree that was split stands behind two features.
    - `outline` (k, 2): points along the edge of the reference's orchard in its frame, metres, counter-clockwise.
    - `flights`: what else is true of reference and source, for images of them; empty where nobody made it.
    """

    scene: Scene
    seed: int
    reference: FeatureSet
    source: FeatureSet
    truth: Rigid | None
    bend: float
    trees: Trees
    reference_trees: IntArray
    source_trees: IntArray
    outline: FloatArray
    flights: tuple[Flight, ...] = ()

    def true_pairs(self) -> IntArray:
        """Positions (reference, source), (k, 2), of features that both show the same single tree, whole.

        Empty where there is no truth.
        """
        if self.truth is None:
            return np.zeros((0, 2), dtype=np.int64)
        reference = _feature_of_tree(self.reference_trees, len(self.trees))
        source = _feature_of_tree(self.source_trees, len(self.trees))
        both = (reference >= 0) & (source >= 0)
        return np.column_stack([reference[both], source[both]])

    def heights(self) -> FloatArray:
        """Of each of the `trees` at the time of reference and source, (n, 2) metres; NaN where it does not stand."""
        heights = np.full((len(self.trees), 2), np.nan)
        for when, flight in enumerate(self.flights):
            begin = 0 if flight.orchard is self.flights[0].orchard else len(self.trees) - len(flight.height)
            standing = np.flatnonzero(flight.visit.alive)
            heights[begin + standing, when] = flight.height[standing]
        return heights

    def vertical_offset(self) -> float | None:
        """What the source's elevations lack against the reference's, metres; None where there is no truth."""
        return self.flights[0].datum - self.flights[1].datum if self.truth and self.flights else None

    def true_fit(self) -> Affine:
        """The rigid least-squares fit on the true pairs: what the best method could reach.

        Raises `ValueError` when there are fewer than two true pairs.
        """
        pairs = self.true_pairs()
        return Model.RIGID.fit(self.source.xy[pairs[:, 1]], self.reference.xy[pairs[:, 0]])

    def error(self, reference_from_source: Transform) -> float:
        """RMS distance, metres, between where a transform and the truth put the source's detections of true trees.

        Raises `ValueError` where there is no truth.
        """
        if self.truth is None:
            raise ValueError("this simulation has no true transform")
        xy = self.source.xy[self.source_trees[:, 0] >= 0]
        return _rms(reference_from_source(xy) - self.truth(xy))


def simulate(scene: Scene, seed: int) -> Simulation:
    """Two surveys of a scene; the same scene and seed give the same surveys.

    Orchard, views, both surveys and the misplacement have random streams of their own: another `missed`, for example,
    leaves the orchard as it is. Raises `UsageError` when the scene leaves fewer than 3 trees.
    """
    if scene.periodic:
        scene = scene.model_copy(update=_PERIODIC)
    planting, viewing, first, second, moving, elsewhere = np.random.default_rng(seed).spawn(6)
    orchard = plant(scene, planting)
    reference_view, source_view = views(scene, orchard, viewing)
    first_visit = Visit(reference_view, np.ones(len(orchard.xy), dtype=bool), 1.0)
    reference = detect(orchard, scene, first_visit, first)

    surveyed, surveyed_scene = orchard, scene
    if not scene.same_orchard:
        scaled = {name: scene.other_scale * getattr(scene, name) for name in ("row_spacing", "spacing", "hedgerow")}
        surveyed_scene = scene.model_copy(update=scaled)
        surveyed = plant(surveyed_scene, elsewhere)
        _, source_view = views(scene, surveyed, elsewhere)
    alive = second.random(len(surveyed.xy)) >= scene.dead
    second_visit = Visit(source_view, alive, scene.growth)
    source = detect(surveyed, surveyed_scene, second_visit, second)
    misplaced = misplacement(scene, moving)
    displaced = Displacement.drawn(scene, misplaced, surveyed.positions, moving)

    surveys = (first_visit, reference), (second_visit, source)
    truth: Rigid | None = misplaced.inverse()
    bend = 0.0
    if not scene.same_orchard or scene.periodic:
        truth = None
    elif scene.distortion > 0:
        shown = displaced(orchard.xy)
        truth = Rigid.from_matrix(Model.RIGID.fit(shown, orchard.xy).matrix)
        bend = _rms(truth(shown) - orchard.xy)
    trees = _trees(orchard) if surveyed is orchard else _joined(_trees(orchard), _trees(surveyed))
    offset = len(trees) - len(surveyed.xy)
    return Simulation(
        scene=scene,
        seed=seed,
        reference=reference.features(),
        source=source.features().replace(xy=displaced(source.xy)),
        truth=truth,
        bend=bend,
        trees=trees,
        reference_trees=frozen_array(reference.trees, np.int64),
        source_trees=frozen_array(np.where(source.trees >= 0, source.trees + offset, -1), np.int64),
        outline=frozen_array(orchard.outline),
        flights=flights_of(scene, seed, (orchard, surveyed), surveys, displaced),
    )


def misplacement(scene: Scene, rng: np.random.Generator) -> Rigid:
    """How a source's coordinates are wrong: a turn about the orchard's centre, then a shift."""
    normal, uniform = rng.standard_normal(3), rng.uniform(-180, 180)
    if scene.rotation == "any":
        rotation_deg = uniform
    else:
        rotation_deg = scene.rotation_sd * normal[0] if scene.rotation is None else scene.rotation
    return Rigid.turn(rotation_deg, shift=scene.shift_sd * normal[1:] if scene.shift is None else scene.shift)


def _rms(vectors: FloatArray) -> float:
    """Root mean square length of vectors (n, 2)."""
    return math.sqrt(float(np.mean((vectors**2).sum(axis=1))))


def _trees(orchard: Orchard) -> Trees:
    return Trees(orchard.xy, orchard.area, orchard.row, orchard.column)


def _joined(first: Trees, second: Trees) -> Trees:
    return Trees(
        np.concatenate([first.xy, second.xy]),
        np.concatenate([first.area, second.area]),
        np.concatenate([first.row, second.row + first.row.max() + 1]),
        np.concatenate([first.column, second.column]),
    )


def _feature_of_tree(trees: IntArray, count: int) -> IntArray:
    """For each true tree the feature that shows it alone and whole, -1 where none does."""
    alone = np.flatnonzero((trees[:, 0] >= 0) & (trees[:, 1] < 0))
    shown = trees[alone, 0]
    feature = np.full(count, -1, dtype=np.int64)
    feature[shown] = alone
    feature[np.bincount(shown, minlength=count) != 1] = -1
    return feature
