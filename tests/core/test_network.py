"""The structure of a network: what it takes, and what it refuses."""

from __future__ import annotations

import pytest

from treereg_core.network import Network, Node

RAIN = Node("rain", "whether it rains", ("no", "yes"))
GRASS = Node("grass", "how the grass is", ("dry", "damp", "wet"), ("rain",))


def test_a_table_has_the_parents_states_first() -> None:
    network = Network((RAIN, GRASS, Node("shoes", "the shoes", ("dry", "wet"), ("grass", "rain"))))
    assert network.shape("rain") == (2,)
    assert network.shape("shoes") == (3, 2, 2)


@pytest.mark.parametrize("states", [(), ("yes",), ("yes", "yes")])
def test_a_node_has_two_states_or_more_all_different(states: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=r"node 'rain' has the states .* two or more"):
        Node("rain", "whether it rains", states)


def test_a_parent_counts_once() -> None:
    with pytest.raises(ValueError, match="name each once"):
        Node("grass", "how the grass is", ("dry", "wet"), ("rain", "rain"))


@pytest.mark.parametrize(
    ("nodes", "sentence"),
    [
        ((), "one node at least"),
        ((RAIN, RAIN), "two nodes 'rain'"),
        ((GRASS,), "node 'grass' depends on 'rain', which is no node before it"),
        ((GRASS, RAIN), "which is no node before it"),
        ((Node("rain", "whether it rains", ("no", "yes"), ("rain",)),), "which is no node before it"),
    ],
)
def test_nodes_have_names_of_their_own_and_come_after_their_parents(nodes: tuple[Node, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Network(nodes)
