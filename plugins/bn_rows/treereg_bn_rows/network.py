"""The network itself: its tables, and what it says for every combination of states."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from treereg_bn_rows.structure import NETWORK, PARENTS, SAME, STATES, shape
from treereg_core.features import IntArray
from treereg_core.transform import FloatArray

Tables = Mapping[str, FloatArray]
"""Counts or probabilities by sign: (parents' states..., states)."""


def network(tables: Tables) -> Any:
    """The network as a `DiscreteBayesianNetwork` of pgmpy. Pairs are as often the same as not: see `Posterior`."""
    models, factors = _pgmpy("pgmpy.models"), _pgmpy("pgmpy.factors.discrete")
    states = {node.name: list(node.states) for node in NETWORK.nodes}
    model = models.DiscreteBayesianNetwork([(parent, name) for name in PARENTS for parent in PARENTS[name]])
    model.add_cpds(factors.TabularCPD("same", len(SAME), [[0.5], [0.5]], state_names={"same": states["same"]}))
    for name, parents in PARENTS.items():
        counts = np.asarray(tables[name], dtype=np.float64)
        share = counts / counts.sum(axis=-1, keepdims=True)
        cpd = factors.TabularCPD(
            name,
            len(states[name]),
            share.reshape(-1, share.shape[-1]).T,
            list(parents),
            [len(states[parent]) for parent in parents],
            state_names={node: states[node] for node in (name, *parents)},
        )
        model.add_cpds(cpd)
    model.check_model()
    return model


def xmlbif(tables: Tables) -> str:
    """The network as XMLBIF, for other programs."""
    return str(_pgmpy("pgmpy.readwrite").XMLBIFWriter(network(tables)))


@dataclass(frozen=True, eq=False)
class Posterior:
    """The log-odds that two rows are the same for every combination of states, for even odds beforehand.

    Tables over the signs in the order of `STATES`: `alone` over those of the two rows by themselves, `beside` with the
    context, `full` with context and field.
    """

    alone: FloatArray
    beside: FloatArray
    full: FloatArray

    def log_odds(self, states: Mapping[str, IntArray]) -> FloatArray:
        """Log-odds of pairs (k,) by the signs whose states are given: with neither, with context, or with both."""
        table = self.full if "field" in states else self.beside if "context" in states else self.alone
        return np.asarray(table[tuple(states[name] for name in STATES if name in states)])


def posterior(tables: Tables) -> Posterior:
    """What the network says, by one query for all combinations at once; kept for the next call in this process."""
    return _tabulated(tuple(np.ascontiguousarray(tables[name], dtype=np.float64).tobytes() for name in PARENTS))


@lru_cache(maxsize=8)
def _tabulated(tables: tuple[bytes, ...]) -> Posterior:
    named = {name: np.frombuffer(table).reshape(shape(name)) for name, table in zip(PARENTS, tables, strict=True)}
    inference = _pgmpy("pgmpy.inference").VariableElimination(network(named))
    order = ["same", *STATES]
    joint = inference.query(order, show_progress=False)
    values = np.transpose(joint.values, [joint.variables.index(name) for name in order])
    beside = values.sum(axis=order.index("field"))
    return Posterior(*(np.log(table[0]) - np.log(table[1]) for table in (beside.sum(axis=-1), beside, values)))


def _pgmpy(module: str) -> Any:
    """A module of pgmpy, which takes seconds to import: only where a network runs."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "`pgmpy.estimators.StructureScore` is deprecated", FutureWarning)
        return importlib.import_module(module)
