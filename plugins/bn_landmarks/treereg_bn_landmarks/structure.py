"""The structure of the network: its nodes, their states, and what depends on what."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from treereg_core.network import Network, Node

NETWORK = Network(
    (
        Node(
            "surroundings",
            "the mean confidence of the trees around, the heat map, by rank within the survey",
            ("low", "middle", "high"),
        ),
        Node(
            "agreement",
            "the share of the trees around that have a partner in the other survey",
            ("none", "poor", "fair", "good", "full"),
        ),
        Node("real", "whether the detection is a tree", ("no", "yes"), ("surroundings", "agreement"), hidden=True),
        Node(
            "landmark",
            "whether it is a tree that the other survey shows too",
            ("no", "yes"),
            ("real", "agreement"),
            hidden=True,
        ),
        Node("size", "its crown against those around", ("tiny", "small", "usual", "large"), ("real",)),
        Node(
            "confidence",
            "the detector's, by rank within the survey",
            ("lowest", "low", "middle", "high", "highest"),
            ("real", "surroundings", "size"),
        ),
        Node(
            "place",
            "how it stands to the trees one and two steps away along the planting: where both sides expect it (inside, "
            "or broken where some are missing), one side alone (end), a single tree (loose), none (off)",
            ("off", "loose", "end", "broken", "inside"),
            ("real", "agreement"),
        ),
        Node("row", "whether it stands in a detected row; unknown without rows", ("none", "in"), ("real", "place")),
        Node(
            "partner",
            "what stands there in the other survey under the present transform: a partner, with a crown of like size "
            "or not, close to where the partners around it say or apart; a tree that has a nearer partner itself "
            "(taken); one farther off, in a crown that reaches from one to the other, as where crowns were split or "
            "merged (within), or beside it; nothing; or ground that the other survey does not cover",
            (
                *("uncovered", "nothing", "beside", "within", "taken"),
                *("apart_unlike", "apart_like", "close_unlike", "close_like"),
            ),
            ("landmark", "agreement", "size"),
        ),
        Node(
            "their",
            "how much like a tree the partner looks, by its confidence and its place; none where nothing stands",
            ("none", "doubtful", "fair", "good"),
            ("landmark", "partner", "confidence"),
        ),
        Node(
            "earlier",
            "how many of the earlier surveys had a tree there; unknown where none covered the ground",
            ("never", "seldom", "sometimes", "often"),
            ("real", "landmark", "partner", "agreement"),
        ),
    )
)
"""All but the hidden nodes are evidence on one tree.

Evidence that depends on evidence has an arc too: confidence on the confidences around and on the crown's size, the
place on how well the surveys agree there, which says how noisy they are, being in a row on the place, the partner on
agreement and size, and what earlier surveys had there on agreement and on what stands there now.
"""

STATES: Mapping[str, tuple[str, ...]] = MappingProxyType({node.name: node.states for node in NETWORK.nodes})
PARENTS: Mapping[str, tuple[str, ...]] = MappingProxyType({node.name: node.parents for node in NETWORK.nodes})
EVIDENCE = tuple(node.name for node in NETWORK.nodes if not node.hidden)
OF_PARTNERS = ("partner", "their")
"""Evidence on what stands there in the other survey."""
OPTIONAL = ("row", "earlier", *OF_PARTNERS)
"""Evidence that may be unknown: then its index is the number of its states."""

shape = NETWORK.shape
