"""Learns what `bn_rows` knows beforehand from simulated surveys, and writes `treereg_bn_rows/prior.json`.

    uv run python plugins/bn_rows/learn_prior.py --seeds 12

Rows are those that the detector finds in both surveys; which trees are the same is the simulation's truth. Two rounds:
the context of the second is what the network of the first says.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from treereg_bn_rows.counts import counted
from treereg_bn_rows.evidence import STATES
from treereg_bn_rows.lessons import lessons
from treereg_bn_rows.looks import looks
from treereg_bn_rows.network import PARENTS, posterior, shape
from treereg_bn_rows.ranking import ranked
from treereg_core.detection import RowOptions, carry_out, row_plan
from treereg_core.method import Context
from treereg_core.pair import MatchedRows, Pair
from treereg_core.registry import installed
from treereg_core.simulate import simulate_family
from treereg_core.testing.scenes import off

FAMILIES = (
    *("rotation_any", "shift_3", "noisy", "curved", "bare_rectangle", "overlap_60", "overlap_50", "distortion_035"),
    *("small_150", "dense", "paths", "contour", "double_hedgerow", "heavy_noise", "square_any"),
)
OFFSETS = 3.0
FLOOR = 2.0
"""Pairs of rows that are taken as seen in addition, spread evenly over the states of each combination of parents."""
PER_CLASS, NONE = 1000, 0.01


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="simulations of each family (default 12)")
    parser.add_argument("--first-seed", type=int, default=90_000, metavar="K", help="seeds from here on")
    options = parser.parse_args()
    plan = row_plan(RowOptions(method="aco", threads=1), installed())
    seen = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for family in FAMILIES:
            simulation = simulate_family(family, seed)
            rng = np.random.default_rng(seed)
            start = off(simulation, rng.uniform(-2, 2), rng.uniform(-2, 2)).reference_from_source
            rows = MatchedRows(carry_out(plan, simulation.reference), carry_out(plan, simulation.source), np.empty((0, 2), int))
            pair = Pair(simulation.reference, simulation.source, start, rows)
            pairs = simulation.true_pairs()
            matches = np.column_stack([simulation.reference.ids[pairs[:, 0]], simulation.source.ids[pairs[:, 1]]])
            try:
                seen.append((looks(pair, OFFSETS, Context(seed=seed)), rows, matches))
            except Exception as e:
                print(family, seed, repr(e))
        print(seed, file=sys.stderr, flush=True)
    tables = {name: np.ones(shape(name)) for name in PARENTS}
    for _ in range(3):
        known = posterior(tables)
        fresh = {name: np.zeros(shape(name)) for name in PARENTS}
        for looked, rows, matches in seen:
            lesson = lessons(ranked(looked, known), rows, matches)
            for name, table in counted(lesson.states, lesson.same).items():
                fresh[name] += table
        tables = fresh_tables(fresh)
    total = {word: int(fresh["offset"][k].sum()) for k, word in enumerate(("same", "not same"))}
    write(tables, total, options)
    return 0


def fresh_tables(fresh):
    """Counts per 1000 pairs of each class, none of them zero."""
    tables = {}
    for name, table in fresh.items():
        mass = table.sum(axis=tuple(range(1, table.ndim)), keepdims=True)
        tables[name] = np.round(PER_CLASS * table / mass + FLOOR / len(STATES[name]), 3)
    none = STATES["context"].index("none")  # a row alone says nothing
    tables["context"][..., none] = np.round(NONE * np.delete(tables["context"], none, axis=-1).sum(axis=-1), 3)
    return tables


def write(tables, total, options) -> None:
    """The file, one table to a line for each combination of the first parents."""
    about = {
        "what": "how often the states of each sign occur among 1000 pairs of rows that are the same, and 1000 that are not; the order of states is that of network.PARENTS and evidence.STATES",
        "learned_from": {"families": list(FAMILIES), "first_seed": options.first_seed, "seeds": options.seeds, "pairs": total},
    }
    lines = []
    for name in PARENTS:
        table = tables[name]
        rows = json.dumps(table.tolist())
        lines.append(f'  "{name}": {rows}')
    head = json.dumps(about, indent=1)[:-2]
    text = head + ',\n "tables": {\n' + ",\n".join(lines) + "\n }\n}\n"
    json.loads(text)
    (Path(__file__).parent / "treereg_bn_rows" / "prior.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
