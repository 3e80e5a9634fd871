"""The structure of the network: its nodes, their states, and what depends on what."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

STATES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "surroundings": ("low", "middle", "high"),
        "agreement": ("none", "poor", "fair", "good", "full"),
        "real": ("no", "yes"),
        "landmark": ("no", "yes"),
        "size": ("tiny", "small", "usual", "large"),
        "confidence": ("lowest", "low", "middle", "high", "highest"),
        "place": ("off", "loose", "end", "broken", "inside"),
        "row": ("none", "in"),
        "earlier": ("no", "sometimes", "yes"),
        "partner": ("uncovered", "nothing", "taken", "apart_unlike", "apart_like", "close_unlike", "close_like"),
        "their": ("none", "doubtful", "fair", "good"),
    }
)
"""States of each node.

Hidden are `real`, whether the detection is a tree, and `landmark`, whether it is and the other survey shows it too. The
others are evidence on one tree:

- `surroundings`: the mean confidence of its neighbours, the heat map, by rank within the survey.
- `agreement`: the share of trees around it that have a partner in the other survey.
- `size`: its crown against its neighbours'.
- `confidence`: the detector's, by rank within the survey.
- `place`: how it stands to the trees one and two steps away along the planting: where both sides expect it (`inside`,
  or `broken` where some are missing), one side alone (`end`), a single tree (`loose`), none (`off`).
- `row`: whether it stands in a row; unknown where no rows were detected.
- `earlier`: whether earlier surveys had a tree there; unknown where none was remembered.
- `partner`: what stands there in the other survey under the present transform: a partner, with a crown of like size or
  not, close to where partners around it say or apart; something that has a nearer partner itself (`taken`); nothing; or
  ground that the other survey does not cover.
- `their`: how much like a tree that looks in its own survey, by its confidence and its place.
"""

PARENTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "surroundings": (),
        "agreement": (),
        "real": ("surroundings", "agreement"),
        "landmark": ("real", "agreement"),
        "size": ("real",),
        "confidence": ("real", "surroundings", "size"),
        "place": ("real", "agreement"),
        "row": ("real", "place"),
        "earlier": ("real", "landmark", "partner"),
        "partner": ("landmark", "agreement", "size"),
        "their": ("landmark", "partner", "confidence"),
    }
)
"""What each node depends on. Evidence that depends on evidence has an arc too: confidence on the confidences around and
on the crown's size, the place on how well the surveys agree there, which says how noisy they are, being in a row on the
place, the partner on agreement and size, and what earlier surveys had there on what stands there now."""

HIDDEN = ("real", "landmark")
EVIDENCE = tuple(node for node in STATES if node not in HIDDEN)
OPTIONAL = ("row", "earlier")
"""Evidence that may be unknown: then its index is the number of its states."""


def shape(node: str) -> tuple[int, ...]:
    """Of a node's table of counts or probabilities: its parents' numbers of states, then its own."""
    return tuple(len(STATES[name]) for name in (*PARENTS[node], node))
