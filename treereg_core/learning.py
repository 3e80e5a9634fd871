"""What a method that learns from surveys is told, and what it keeps of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from treereg_core.features import IntArray, frozen_array
from treereg_core.pair import Pair
from treereg_core.transform import Affine

State = Mapping[str, Any]
"""What a method knows, as JSON has it: mappings with text keys, lists, numbers, texts, truth values, None."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """An accepted registration, as the methods that took part in it learn from it.

    - `pair`: all usable trees of both surveys, at the accepted placement. Its `rows` are those of the stages that led
      to it, as the row matcher gave them, before later filters; None without a row matcher.
    - `matches` (k, 2): ids (reference, source) of the trees that the judge found to be the same.
    - `home_from_reference`: takes the reference's working coordinates to the frame in which the memory keeps single
      trees, the full coordinates of the orchard's first reference; None where that is not known. It may be known here
      though it was not in the context of the run: where the source's place was known, and now the reference's is.
    """

    pair: Pair
    matches: IntArray
    home_from_reference: Affine | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "matches", frozen_array(self.matches, np.int64).reshape(-1, 2))


class Learner(ABC):
    """Mixed in by a method that learns. What it knows comes back to it in `context.memory[name]`."""

    @abstractmethod
    def learn(self, outcome: Outcome, state: State) -> State:
        """What the next registration of this orchard will know: the state so far (empty at first), and this outcome.

        Called only after an accepted registration. Returns a new state, and changes nothing; old surveys should count
        less in it than new ones. The state has to survive JSON, and a state of an earlier version of the method must
        still be understood. An error costs nothing but the lesson: the old state stays.
        """

    def export(self, state: State) -> Mapping[str, str]:
        """Files for other programs, text by name, that say what is known; none unless a method has some.

        They are written beside the memory, under names that begin with the method's, and never read again.
        """
        return {}
