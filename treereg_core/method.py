"""The roles that methods play, one verb each, and the records they return.

A method is a frozen pydantic record of its settings and its verb. Each setting is a field with a default, a range, a
description and, where it has one, a unit: `Field(1.0, gt=0, description="...", json_schema_extra={"unit": "m"})`.
The first line of the class's docstring says what it is and names its source.
"""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from treereg_core.features import FeatureSet, IntArray, frozen_array
from treereg_core.learning import State
from treereg_core.network import Network
from treereg_core.pair import Pair, Rows
from treereg_core.transform import Affine, FloatArray, Model

Described = tuple[Mapping[str, FloatArray], Mapping[str, FloatArray]]
"""What is known of the trees of the reference and of the source: arrays with a number for each tree, by name."""


def silent(message: str) -> None:
    """Progress that nobody reads."""


@dataclass(frozen=True)
class Context:
    """What a stage may know besides the pair; nothing else is global.

    - `model`: the kind of transform to fit; `context.model.fit(source, reference, weights)`.
    - `seed`: everything random derives from it, through `rng`.
    - `threads`: how many a stage may use; results must not depend on it.
    - `memory`: what earlier registrations of this orchard taught each method that learns, by its name; empty at first.
    - `home_from_reference`: takes the reference's working coordinates to those in which the memory keeps single trees;
      None when that is not known.
    - `georeference_sd`: how far the files' own georeference may be off, metres, 1 sd per axis; None: unknown.
    - `progress`: takes a short sentence on what is being done.
    """

    model: Model = Model.RIGID
    seed: int = 0
    threads: int = 1
    georeference_sd: float | None = None
    progress: Callable[[str], None] = silent
    memory: Mapping[str, State] = field(default_factory=dict)
    home_from_reference: Affine | None = None

    def rng(self, *key: str | int) -> np.random.Generator:
        """A generator of its own for this key: results do not depend on the order of calls."""
        digest = hashlib.blake2b(repr((self.seed, key)).encode(), digest_size=16).digest()
        return np.random.default_rng(int.from_bytes(digest, "little"))


@dataclass(frozen=True, eq=False)
class Registration:
    """The correspondences and the transform fitted to them.

    `pairs` (n, 2) holds ids (reference, source), `weights` (n,) what each counted in the fit.
    """

    transform: Affine
    pairs: IntArray
    weights: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "pairs", frozen_array(self.pairs, np.int64).reshape(-1, 2))
        object.__setattr__(self, "weights", frozen_array(self.weights))
        if len(self.weights) != len(self.pairs):
            raise ValueError("a registration has one weight for each pair")


class Method(BaseModel, ABC):
    """Base of the roles: a frozen record of settings; an unknown one is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str]
    """What a user types in an expression: lower-case letters, digits and underscores, starting with a letter."""
    role: ClassVar[str]
    """The role's name, as `treereg methods` prints it."""
    models: ClassVar[frozenset[Model]] = frozenset(Model)
    """The transforms that the method can work with; any other is refused before work begins."""
    network: ClassVar[Network | None] = None
    """The structure of the Bayesian network that the method reasons with, for `treereg methods`; None without one."""


class FeatureFilter(Method):
    """Decides which trees, and with which weights, the stages after it see."""

    role = "feature filter"
    needs_pair: ClassVar[bool] = True
    """Whether it looks at both surveys at once; one that does not can also serve a single survey."""

    @abstractmethod
    def select(self, pair: Pair, context: Context) -> Pair:
        """The same pair with fewer trees or other weights (`pair.narrow`); never invents a tree or moves one.

        An attribute that it adds to both surveys is evidence for the placement in all that comes after, so it must not
        depend on the placement. What does is for `describe`.
        """

    def describe(self, pair: Pair, context: Context) -> Described:
        """What it knows of every tree of the reference (n,) and of the source (m,) at this placement, by name.

        For people to see, never evidence: asked once, of all usable trees at the judged placement, and written beside
        the registered trees. Rows are there where they were detected among all trees. A name is of lower-case letters,
        digits and underscores, and says what the number is. Nothing, unless a filter has something to say; raises
        `NoRegistration` where it has nothing to say of these trees.
        """
        return {}, {}


class CoarseAligner(Method):
    """Finds where the source lies without being told where to begin."""

    role = "coarse aligner"

    @abstractmethod
    def propose(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """A few distinct placements (`pair.at`), best first. Raises `NoRegistration` when nothing can be found."""


class RowDetector(Method):
    """Finds the planting rows of one survey.

    Those of two large surveys are looked for at the same time, in two threads, where a run has several.
    """

    role = "row detector"

    @abstractmethod
    def detect(self, features: FeatureSet, context: Context) -> Rows:
        """The rows, each of two trees or more; a tree stands in at most one."""


class RowMatcher(Method):
    """Says which rows of the two surveys are the same."""

    role = "row matcher"

    @abstractmethod
    def match(self, pair: Pair, context: Context) -> tuple[Pair, ...]:
        """The pair with matched rows and the transform they give, best first; several when the rows allow it."""


class PointMatcher(Method):
    """Finds corresponding trees near the current transform and fits the model to them."""

    role = "point matcher"

    @abstractmethod
    def register(self, pair: Pair, context: Context) -> Registration:
        """The correspondences and their fit. Raises `NoRegistration` when there are too few."""
