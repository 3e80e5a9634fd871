"""The network itself: from counts to probabilities, to the posterior of every evidence, and to XMLBIF."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from treereg_bn_landmarks.structure import EVIDENCE, OF_PARTNERS, OPTIONAL, PARENTS, STATES, shape
from treereg_core.features import IntArray, frozen_array
from treereg_core.transform import FloatArray

Counts = Mapping[str, FloatArray]
"""For each node how often its states were seen under those of its parents, shaped as `structure.shape` says."""

PRIOR_TREES = 4000
"""The prior from simulation counts like so many trees of the orchard itself."""
SMOOTHING = 2.0
"""Each line of a table of simulated counts gets so many trees more, spread as the node's states are on the whole."""


@cache
def prior() -> Counts:
    """The counts that every orchard begins with, from simulated surveys: `python -m benchmarks.landmarks --learn`.

    Smoothed, so that nothing is impossible but a landmark that is not a real tree.
    """
    text = files(__package__).joinpath("prior.json").read_text(encoding="utf-8")
    counts = {}
    for node, values in json.loads(text)["counts"].items():
        table = np.asarray(values, dtype=np.float64)
        overall = table.reshape(-1, table.shape[-1]).sum(axis=0)
        smoothed = table + SMOOTHING * overall / overall.sum()
        if node == "landmark":
            smoothed[STATES["real"].index("no")] = table[STATES["real"].index("no")]
        counts[node] = frozen_array(smoothed * (PRIOR_TREES / table.sum()))
    return counts


def none() -> dict[str, FloatArray]:
    """Counts of nothing."""
    return {node: np.zeros(shape(node)) for node in STATES}


def together(learned: Counts) -> dict[str, FloatArray]:
    """The tables of conditional probabilities that the prior and what was learned give together."""
    tables = {node: prior()[node] + learned[node] for node in STATES}
    return {node: table / table.sum(axis=-1, keepdims=True) for node, table in tables.items()}


def posterior(learned: Counts) -> FloatArray:
    """P(real) and P(landmark) for all evidence: last axis of an array with one axis for each node of `EVIDENCE`.

    Optional evidence has one place more, for unknown. Prior and learned counts together make the network; the result
    is tabulated once in a process.
    """
    tables = together(learned)
    return _tabulated(b"".join(tables[node].tobytes() for node in STATES))


@lru_cache(maxsize=4)
def _tabulated(probabilities: bytes) -> FloatArray:
    from_bytes, tables, at = np.frombuffer(probabilities), {}, 0
    for node in STATES:
        size = math.prod(shape(node))
        tables[node] = from_bytes[at : at + size].reshape(shape(node))
        at += size
    with _pgmpy() as pgmpy:
        network = _network(pgmpy, tables)
        query = pgmpy["VariableElimination"](network).query([*EVIDENCE, "real", "landmark"], show_progress=False)
    order = [query.variables.index(node) for node in (*EVIDENCE, "real", "landmark")]
    joint = np.transpose(query.values, order)
    for node in OPTIONAL:
        axis = EVIDENCE.index(node)
        joint = np.concatenate([joint, joint.sum(axis=axis, keepdims=True)], axis=axis)
    real, landmark = joint[..., 1, :].sum(axis=-1), joint[..., 1].sum(axis=-1)
    return frozen_array(np.stack([real, landmark], axis=-1) / joint.sum(axis=(-1, -2))[..., None])


def look_up(table: FloatArray, evidence: IntArray) -> FloatArray:
    """P(real) and P(landmark) (n, 2) of trees with this evidence (n, nodes), in a table from `posterior`."""
    return np.asarray(table[tuple(evidence.T)])


def partners_unknown(evidence: IntArray) -> IntArray:
    """The same evidence (n, nodes), less what stands there in the other survey."""
    less = evidence.copy()
    for node in OF_PARTNERS:
        less[:, EVIDENCE.index(node)] = len(STATES[node])
    return less


def xmlbif(learned: Counts) -> str:
    """The network in the XML Bayesian interchange format, for other programs."""
    with _pgmpy() as pgmpy:
        return str(pgmpy["XMLBIFWriter"](_network(pgmpy, together(learned))))


def _network(pgmpy: Mapping[str, Any], tables: Mapping[str, FloatArray]) -> Any:
    network = pgmpy["DiscreteBayesianNetwork"]([(parent, node) for node in STATES for parent in PARENTS[node]])
    for node, table in tables.items():
        names = (node, *PARENTS[node])
        network.add_cpds(
            pgmpy["TabularCPD"](
                node,
                len(STATES[node]),
                table.reshape(-1, len(STATES[node])).T,
                evidence=list(PARENTS[node]) or None,
                evidence_card=[len(STATES[parent]) for parent in PARENTS[node]] or None,
                state_names={name: list(STATES[name]) for name in names},
            )
        )
    network.check_model()
    return network


@contextmanager
def _pgmpy() -> Iterator[Mapping[str, Any]]:
    """The parts of pgmpy that are used here; it takes seconds to import, so only where a network runs."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`pgmpy\.estimators\.StructureScore` is deprecated", FutureWarning)
        from pgmpy.factors.discrete import TabularCPD  # type: ignore[import-untyped]
        from pgmpy.inference import VariableElimination  # type: ignore[import-untyped]
        from pgmpy.models import DiscreteBayesianNetwork  # type: ignore[import-untyped]
        from pgmpy.readwrite import XMLBIFWriter  # type: ignore[import-untyped]

        yield {part.__name__: part for part in (TabularCPD, VariableElimination, DiscreteBayesianNetwork, XMLBIFWriter)}
