"""Learns what `bn_rows` knows beforehand from simulated surveys, and writes `treereg_bn_rows/prior.json`.

    uv run python plugins/bn_rows/learn_prior.py --seeds 10

Rows are those that the detector finds in both surveys; which trees are the same is the simulation's truth. In
several rounds: the context and the field of each are what the network of the one before says.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from treereg_bn_rows.counts import counted
from treereg_bn_rows.lessons import lessons
from treereg_bn_rows.looks import Look, looks
from treereg_bn_rows.network import posterior
from treereg_bn_rows.ranking import ranked
from treereg_bn_rows.structure import PARENTS, STATES, shape

from treereg_core.detection import RowOptions, carry_out, row_plan
from treereg_core.features import IntArray
from treereg_core.method import Context
from treereg_core.pair import MatchedRows
from treereg_core.registry import installed
from treereg_core.simulate import simulate_family
from treereg_core.testing.scenes import off
from treereg_core.transform import FloatArray

FAMILIES = (
    *("rotation_any", "shift_3", "noisy", "curved", "bare_rectangle", "overlap_60", "overlap_50", "distortion_035"),
    *("small_150", "dense", "paths", "contour", "double_hedgerow", "heavy_noise", "square_any"),
)
OFFSETS = 3.0
"""As in `BnRows`."""
MOST_OFF = 2.0
"""Starts are off by up to so many in-row spacings along, and so many row distances across."""
PAIRS, FLOOR = 1000.0, 2.0
"""The tables are given as of so many pairs of rows, the same and not, and as many more spread evenly over the states of
each combination of parents, so that nothing is impossible that was not seen."""
ALONE = 0.01
"""Share of rows without others beside them, for any state of the parents: it says nothing."""
ROUNDS = 3
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
ABOUT = (
    "How often the states of each sign occur among 1000 pairs of rows that are the same, and among 1000 that are not. "
    "Each table has the states of the sign's parents first, then its own; see structure.py."
)

Shown = tuple[list[Look], MatchedRows, IntArray]


def main() -> int:
    """Learn, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="simulations of each family (default 10)")
    parser.add_argument("--first-seed", type=int, default=90_000, metavar="K", help="seeds from here on")
    options = parser.parse_args()
    shown: list[Shown] = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        shown += [look_at(family, seed) for family in FAMILIES]
        print(f"seed {seed}", file=sys.stderr, flush=True)
    tables: dict[str, FloatArray] = {name: np.ones(shape(name)) for name in PARENTS}
    for _ in range(ROUNDS):
        known = posterior(tables)
        learned = [lessons(ranked(looked, known), rows, matches) for looked, rows, matches in shown]
        counts = [counted(lesson.states, lesson.same) for lesson in learned]
        tables = {name: scaled(name, np.sum([count[name] for count in counts], axis=0)) for name in PARENTS}
    same = sum(int(lesson.same.sum()) for lesson in learned)
    pairs = {"same": same, "not_same": sum(len(lesson.same) for lesson in learned) - same}
    seeds = {"first_seed": options.first_seed, "seeds": options.seeds}
    write(tables, {"families": list(FAMILIES), **seeds, "pairs": pairs})
    return 0


def look_at(family: str, seed: int) -> Shown:
    """Both surveys of a simulation from a start that is off, with the rows detected in them and the true matches."""
    simulation = simulate_family(family, seed)
    plan = row_plan(RowOptions(method="aco", threads=1), installed())
    rows = MatchedRows(carry_out(plan, simulation.reference), carry_out(plan, simulation.source), NO_MATCHES)
    start = off(simulation, *np.random.default_rng(seed).uniform(-MOST_OFF, MOST_OFF, 2))
    pairs = simulation.true_pairs()
    matches = np.column_stack([simulation.reference.ids[pairs[:, 0]], simulation.source.ids[pairs[:, 1]]])
    return looks(replace(start, rows=rows), OFFSETS, Context(seed=seed)), rows, matches


def scaled(name: str, counts: FloatArray) -> FloatArray:
    """Counts as of 1000 pairs that are the same, and as many that are not."""
    share = counts / counts.sum(axis=tuple(range(1, counts.ndim)), keepdims=True)
    table = PAIRS * share + FLOOR / len(STATES[name])
    if name == "context":
        none = STATES[name].index("none")
        table[..., none] = ALONE * np.delete(table, none, axis=-1).sum(axis=-1)
    return np.asarray(np.round(table, 3))


def write(tables: dict[str, FloatArray], learned_from: dict[str, Any]) -> None:
    """The file: a line for each table."""
    lines = [f'  "{name}": {json.dumps(tables[name].tolist())}' for name in PARENTS]
    head = f' "about": {json.dumps(ABOUT)},\n "learned_from": {json.dumps(learned_from)},\n'
    text = "{\n" + head + ' "tables": {\n' + ",\n".join(lines) + "\n }\n}\n"
    path = Path(__file__).parent / "treereg_bn_rows" / "prior.json"
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
