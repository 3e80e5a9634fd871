"""Counts: what simulated surveys and earlier surveys of the orchard taught the network, and how both are mixed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from treereg_bn_rows.network import Tables
from treereg_bn_rows.structure import PARENTS, STATES, shape
from treereg_core.errors import InputError
from treereg_core.features import BoolArray, IntArray
from treereg_core.learning import State

VERSION = 1
STRENGTH = 100.0
"""What is known from simulation weighs as much as so many pairs of rows, the same or not, under each sign."""
KEPT = 0.8
"""What one more survey leaves of the counts of those before it."""
MOST = 1e9
"""No count is larger: more pairs than any orchard has."""


@cache
def prior() -> Tables:
    """The probabilities of each sign's states that were learned from simulated surveys, `prior.json`."""
    stored = json.loads(files("treereg_bn_rows").joinpath("prior.json").read_text(encoding="utf-8"))
    return {name: np.array(stored["tables"][name], dtype=np.float64).reshape(shape(name)) for name in PARENTS}


def counted(states: Mapping[str, IntArray], same: BoolArray) -> dict[str, np.ndarray]:
    """How often each combination of a sign and its parents occurs among pairs of rows (k,)."""
    value = {**states, "same": np.where(same, 0, 1)}
    tables = {}
    for name, parents in PARENTS.items():
        table = np.zeros(shape(name))
        np.add.at(table, tuple(value[node] for node in (*parents, name)), 1.0)
        tables[name] = table
    return tables


def mixed(state: State) -> Tables:
    """The tables for an orchard of which this is known: the Dirichlet mean of the prior and its own counts.

    The prior's weight is spread over each sign's combinations of parents as often as they occur by the prior.
    Raises `InputError` for a state that is damaged.
    """
    own = checked(state)
    return {name: STRENGTH * table / _mass(name, table) + own[name] for name, table in prior().items()}


def _mass(name: str, table: np.ndarray) -> np.ndarray:
    """What makes each class, the same or not, of a table sum to one."""
    return np.asarray(table.sum(axis=tuple(range(1, table.ndim)), keepdims=True))


def updated(state: State, fresh: Tables) -> State:
    """The state after one more survey with these counts."""
    own = checked(state)
    counts = {name: np.round(KEPT * own[name] + fresh[name], 6).tolist() for name in PARENTS}
    return {"version": VERSION, "surveys": int(state.get("surveys", 0)) + 1, "counts": counts}


def checked(state: State) -> Tables:
    """The counts of a state, zeros for an empty one. Raises `InputError` for one that is damaged or too new."""
    if not state:
        return {name: np.zeros(shape(name)) for name in PARENTS}
    if state.get("version") != VERSION:
        raise _damaged(f"it is of version {state.get('version')!r}, and this program knows version {VERSION}")
    surveys, counts = state.get("surveys"), state.get("counts")
    if not isinstance(surveys, int) or isinstance(surveys, bool) or surveys < 1:
        raise _damaged("it does not say from how many surveys it is")
    if not isinstance(counts, Mapping) or set(counts) != set(PARENTS):
        raise _damaged(f"it does not hold exactly the counts of {', '.join(PARENTS)}")
    return {name: _table(name, counts[name]) for name in PARENTS}


def _table(name: str, values: Any) -> np.ndarray:
    """The counts of one sign."""
    try:
        table = np.array(values)
    except ValueError:  # lists of unequal lengths
        table = np.empty(0)
    if table.shape != shape(name) or table.dtype.kind not in "iuf":
        size = " x ".join(map(str, shape(name)))
        raise _damaged(f"the counts of {name!r} are not {size} numbers, one for each of {', '.join(STATES[name])}")
    if not (np.isfinite(table).all() and (table >= 0).all() and (table <= MOST).all()):
        raise _damaged(f"a count of {name!r} is negative, too large or no number")
    return table.astype(np.float64)


def _damaged(what: str) -> InputError:
    return InputError(f"The memory of bn_rows is damaged: {what}; remove it, or give one that treereg wrote.")
