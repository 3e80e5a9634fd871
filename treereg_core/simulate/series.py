"""`simulate_series`: one orchard surveyed again and again while trees grow, die and are planted anew, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from treereg_core.errors import UsageError
from treereg_core.features import BoolArray, FeatureSet, IntArray, frozen_array
from treereg_core.simulate.detect import Visit, detect
from treereg_core.simulate.orchard import Orchard, plant
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.simulation import misplacement
from treereg_core.simulate.view import View
from treereg_core.transform import FloatArray, Rigid

YOUNG = 0.35
"""Crown width of a tree in its first survey, as a share of a grown one's, when it was planted during the series."""
YOUNG_GROWTH = 1.3
"""Factor on that from each survey to the next, until it is grown."""
WAIT = 2
"""A dead tree is replaced before the next survey or before the one after it."""


class Seasons(BaseModel):
    """What happens to an orchard over a series of surveys, besides what its scene says.

    Of the scene, `dead` is the share of trees that die from each survey to the next, `growth` the factor on crown width
    over the whole series; its `overlap`, `distortion` and `same_orchard` are left aside.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    surveys: int = Field(6, ge=2, le=100, description="how many surveys")
    replanted: float = Field(0.5, ge=0, le=1, description="share of the dead trees that are replaced")
    late: float = Field(0.02, ge=0, le=1, description="share of the trees that are planted after the first survey")
    seen: float = Field(1.0, gt=0, le=1, description="share of the orchard that each survey but the first sees")
    persistence: float = Field(
        0.0, ge=0, lt=1, description="how much likelier a tree that was missed is missed again; 0: not at all"
    )


@dataclass(frozen=True, eq=False)
class Lives:
    """The trees that ever stood (n,), ordered by row and along it.

    `spot` is the planting position, which a tree shares with the one that replaces it. `born` and `died` number the
    first survey in which it stands and the first in which it does no more.
    """

    orchard: Orchard
    spot: IntArray
    born: IntArray
    died: IntArray

    def alive(self, survey: int) -> BoolArray:
        """Which trees (n,) stand at the time of a survey."""
        return np.asarray((self.born <= survey) & (survey < self.died))

    def at(self, survey: int) -> Orchard:
        """The orchard with the young trees as small as they are at the time of a survey."""
        age = np.maximum(survey - self.born, 0)
        young = np.where(self.born > 0, np.minimum(YOUNG * YOUNG_GROWTH**age, 1.0), 1.0)
        return replace(self.orchard, area=self.orchard.area * young**2)


@dataclass(frozen=True, eq=False)
class Capture:
    """One survey of a series with its truth.

    - `reference_from_source`: takes it to the first survey; the identity for that.
    - `trees` (n, 2): for each feature the trees that it shows, as positions in the lives, -1 for none.
    - `alive`, `covered` (m,): which of all trees stand at its time, and which it has in view.
    """

    features: FeatureSet
    reference_from_source: Rigid
    trees: IntArray
    alive: BoolArray
    covered: BoolArray


@dataclass(frozen=True, eq=False)
class SeriesSimulation:
    """A simulated series; the frame of the truth is that of the first survey, about a local origin."""

    scene: Scene
    seasons: Seasons
    seed: int
    lives: Lives
    captures: tuple[Capture, ...]


def simulate_series(scene: Scene, seed: int, seasons: Seasons | None = None) -> SeriesSimulation:
    """Surveys of one orchard over time; the same arguments give the same surveys.

    Raises `UsageError` when the scene leaves fewer than 3 trees, or is one that has no truth.
    """
    if scene.periodic:
        raise UsageError("A series of a periodic orchard has no truth: ask for another scene.")
    seasons = seasons or Seasons()
    planting, living, *visits = np.random.default_rng(seed).spawn(2 + seasons.surveys)
    lives = _lives(plant(scene, planting), scene, seasons, living)
    missed = _missed(scene, seasons, len(lives.spot), living)
    captures = []
    for survey, rng in zip(count(), visits):
        view = _view(lives.orchard, seasons.seen if survey else 1.0, rng)
        growth = scene.growth ** (survey / (seasons.surveys - 1))
        found = detect(lives.at(survey), scene, Visit(view, lives.alive(survey), growth, missed), rng)
        misplaced = misplacement(scene, rng) if survey else Rigid.identity()
        features = found.features()
        captures.append(
            Capture(
                features=features.replace(xy=misplaced(features.xy)),
                reference_from_source=misplaced.inverse(),
                trees=frozen_array(found.trees, np.int64),
                alive=lives.alive(survey),
                covered=view.sees(lives.orchard.xy),
            )
        )
    return SeriesSimulation(scene, seasons, seed, lives, tuple(captures))


def _lives(orchard: Orchard, scene: Scene, seasons: Seasons, rng: np.random.Generator) -> Lives:
    n, surveys = len(orchard.xy), seasons.surveys
    late = rng.random(n) < seasons.late
    born = np.where(late, rng.integers(1, surveys, n), 0)
    age = rng.geometric(scene.dead, n) if scene.dead > 0 else np.full(n, surveys)
    died = np.minimum(born + age, surveys)
    again = died + rng.integers(0, WAIT, n)
    replaced = np.flatnonzero((rng.random(n) < seasons.replanted) & (again < surveys))
    which = np.concatenate([np.arange(n), replaced])
    xy = orchard.xy[which]
    xy[n:] += np.sqrt(2) * scene.planting_jitter * rng.standard_normal((len(replaced), 2))
    plainness = np.concatenate([orchard.plainness, rng.standard_normal(len(replaced))])
    born = np.concatenate([born, again[replaced]])
    died = np.concatenate([died, np.full(len(replaced), surveys)])
    order = np.lexsort((born, orchard.column[which], orchard.row[which]))
    which = which[order]
    together = replace(
        orchard,
        xy=xy[order],
        row=orchard.row[which],
        column=orchard.column[which],
        area=orchard.area[which],
        plainness=plainness[order],
    )
    return Lives(together, which, born[order], died[order])


def _missed(scene: Scene, seasons: Seasons, n: int, rng: np.random.Generator) -> FloatArray:
    """How likely each tree is missed: the scene's share on average, the same trees more often than others."""
    share, kept = scene.missed, seasons.persistence
    if kept == 0 or share in (0, 1):
        return np.full(n, share)
    return rng.beta(share * (1 - kept) / kept, (1 - share) * (1 - kept) / kept, n)


def _view(orchard: Orchard, seen: float, rng: np.random.Generator) -> View:
    """A strip of this share of the orchard, cut across a random direction."""
    angle, begin = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1 - seen)
    if seen == 1:
        return View.everything()
    direction = np.array([[np.cos(angle), np.sin(angle)]])
    low, high = np.quantile(orchard.positions @ direction[0], [begin, begin + seen])
    return View(direction, np.array([low]), np.array([high]))
