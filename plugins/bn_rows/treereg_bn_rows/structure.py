"""The structure of the network: what it says of two rows, and the signs that it sees of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from treereg_core.network import Network, Node

NETWORK = Network(
    (
        Node("same", "whether the two rows are the same", ("yes", "no"), hidden=True),
        Node(
            "offset",
            "distance between the rows across, in distances from row to row",
            ("under_0.1", "under_0.2", "under_0.35", "more"),
            ("same",),
        ),
        Node("direction", "angle between them, degrees", ("under_1", "under_3", "under_8", "more"), ("same",)),
        Node(
            "begin",
            "how far apart along they begin, in distances from tree to tree, once the source is shifted",
            ("under_0.7", "under_1.7", "under_4", "more"),
            ("same",),
        ),
        Node(
            "end",
            "how far apart along they end, likewise",
            ("under_0.7", "under_1.7", "under_4", "more"),
            ("same", "begin"),
        ),
        Node(
            "length",
            "difference of their lengths, in distances from tree to tree",
            ("under_1", "under_2.5", "under_6", "more"),
            ("same", "begin", "end"),
        ),
        Node(
            "trees",
            "difference of their numbers of trees, over the root of their sum",
            ("under_0.3", "under_0.8", "under_1.6", "more"),
            ("same", "length"),
        ),
        Node(
            "gaps",
            "trees that stand opposite a gap of the other row, where both rows run: how many more than usual under "
            "other placements, in standard deviations",
            ("under_-2", "under_-1", "under_0", "under_1", "more"),
            ("same", "trees"),
        ),
        Node(
            "field",
            "how much more all rows and trees together say for this placement than for any at another offset: log-odds",
            ("under_-20", "under_0", "under_20", "more"),
            ("same",),
        ),
        Node(
            "context",
            "mean probability, by the signs of two rows alone, that the rows to both sides are the same; none where "
            "there are none",
            ("under_0.2", "under_0.5", "under_0.8", "more", "none"),
            ("same", "field"),
        ),
    )
)
"""A value below the bound that a state names, and not below the one before, is in that state.

Rows that begin and end alike have the same length, whether they are the same or not; and rows of one length have as
many trees.
"""
SAME = NETWORK.nodes[0].states
STATES: Mapping[str, tuple[str, ...]] = MappingProxyType({n.name: n.states for n in NETWORK.nodes if not n.hidden})
"""The states of each sign."""
PARENTS: Mapping[str, tuple[str, ...]] = MappingProxyType({n.name: n.parents for n in NETWORK.nodes if not n.hidden})
"""On what each sign depends."""

shape = NETWORK.shape
