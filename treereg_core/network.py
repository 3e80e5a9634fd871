"""A Bayesian network, as a method says that it has one: its nodes, their states, and what depends on what."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Node:
    """One variable of a network. Raises `ValueError` for fewer than two states, or one state or parent given twice.

    - `about`: one line for people on what it is.
    - `parents`: the nodes that it depends on, in the order of the axes of its table.
    - `hidden`: whether it is never seen and the network is asked for it; the others are evidence.
    """

    name: str
    about: str
    states: tuple[str, ...]
    parents: tuple[str, ...] = ()
    hidden: bool = False

    def __post_init__(self) -> None:
        if len(self.states) < 2 or len(set(self.states)) < len(self.states):
            raise ValueError(f"node {self.name!r} has the states {self.states}; give two or more, all different")
        if len(set(self.parents)) < len(self.parents):
            raise ValueError(f"node {self.name!r} has the parents {self.parents}; name each once")


@dataclass(frozen=True)
class Network:
    """The structure of a network: nodes of different names, each after its parents.

    Raises `ValueError` where they are not, and for no node at all.
    """

    nodes: tuple[Node, ...]

    def __post_init__(self) -> None:
        if not self.nodes:
            raise ValueError("a network has one node at least")
        known: set[str] = set()
        for node in self.nodes:
            if node.name in known:
                raise ValueError(f"there are two nodes {node.name!r}; give each a name of its own")
            for parent in node.parents:
                if parent not in known:
                    raise ValueError(f"node {node.name!r} depends on {parent!r}, which is no node before it")
            known.add(node.name)

    def shape(self, name: str) -> tuple[int, ...]:
        """Of a node's table of counts or probabilities: its parents' numbers of states, then its own."""
        states = {node.name: node.states for node in self.nodes}
        parents = next(node.parents for node in self.nodes if node.name == name)
        return tuple(len(states[each]) for each in (*parents, name))
