"""Landmarks: whether the chosen trees are in both surveys, whether the probabilities are true, and what they take.

    python -m benchmarks.landmarks --seeds 50
    python -m benchmarks.landmarks --learn plugins/bn_landmarks/treereg_bn_landmarks/prior.json

The second line makes the network's prior again: counts from simulated surveys, on other seeds than the first looks at.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from treereg_bn_landmarks import Landmarks, network
from treereg_bn_landmarks.counting import count
from treereg_bn_landmarks.evidence import footprint
from treereg_bn_landmarks.landmarks import evidence_of, probabilities
from treereg_bn_landmarks.memory import Memory
from treereg_bn_landmarks.planting import Planting
from treereg_bn_landmarks.structure import STATES

from benchmarks.row_trial import timed
from benchmarks.series_pairs import pair_of
from benchmarks.table import percent, table
from treereg_core.features import BoolArray, FeatureSet
from treereg_core.method import Context, FeatureFilter
from treereg_core.pair import MatchedRows, Pair
from treereg_core.registry import installed
from treereg_core.simulate import Scene, Seasons, Simulation, family_scene, simulate, simulate_family, simulate_series
from treereg_core.statistics import wilson
from treereg_core.testing.scenes import near
from treereg_core.transform import FloatArray, Rigid

SHOWN = ("noisy", "shift_3", "rotation_any", "curved", "overlap_60", "dense", "small_150", "square_any", "heavy_noise")
LEARNED_FROM = (
    *("shift_3", "rotation_any", "noisy", "noisy", "curved", "bare_rectangle", "overlap_60", "distortion_035"),
    *("small_150", "square_any", "paths", "contour", "headlands", "double_hedgerow", "dense", "dense", "heavy_noise"),
    *("heavy_noise", "overlap_50", "silent_areas"),
)
SEEDS_TO_LEARN = 12
NO_MATCHES = np.empty((0, 2), dtype=np.int64)
BINS = 10
REPEATS = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures, or write the prior."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.landmarks", description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--families", nargs="+", default=SHOWN)
    parser.add_argument("--share", type=float, default=0.2)
    parser.add_argument("--sizes", type=int, nargs="*", default=(20_000, 53_000, 106_000))
    parser.add_argument("--learn", type=Path, metavar="FILE", help="write the prior's counts instead")
    options = parser.parse_args(arguments)
    if options.learn:
        options.learn.write_text(as_text(learned(SEEDS_TO_LEARN)), encoding="utf-8")
        return 0
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    print(precision(options.families, seeds, options.share), end="\n\n", flush=True)
    if options.sizes:
        print(sizes(options.sizes))
    return 0


def true_landmarks(simulation: Simulation) -> tuple[BoolArray, BoolArray]:
    """Which features of both surveys show a tree that the other survey shows as well, (n,) and (m,)."""
    shown = simulation.reference_trees, simulation.source_trees
    both = np.intersect1d(shown[0][shown[0] >= 0], shown[1][shown[1] >= 0])
    return np.asarray(np.isin(shown[0], both).any(axis=1)), np.asarray(np.isin(shown[1], both).any(axis=1))


@dataclass(frozen=True, eq=False)
class Found:
    """One simulation: the truth and the probabilities of all trees, and which of both surveys a filter chose."""

    truth: BoolArray
    probability: FloatArray
    chosen: BoolArray
    plain: BoolArray


def found(simulation: Simulation, share: float) -> Found:
    """The landmarks of a simulation whose pair begins near the truth, and what the confidence filter chooses."""
    pair = near(simulation, simulation.seed)
    return Found(
        np.concatenate(true_landmarks(simulation)),
        np.concatenate(probabilities(pair, Context())),
        chosen(Landmarks(share=share), pair),
        chosen(confidence_filter(share), pair),
    )


def chosen(method: FeatureFilter, pair: Pair, context: Context | None = None) -> BoolArray:
    """Which trees of reference and source, one after the other, a filter keeps."""
    kept = method.select(pair, context or Context())
    return np.concatenate([np.isin(pair.reference.ids, kept.reference.ids), np.isin(pair.source.ids, kept.source.ids)])


def confidence_filter(share: float) -> FeatureFilter:
    """The plain filter that keeps the same share by confidence alone."""
    offer = next(entry.offer for entry in installed().entries if entry.name == "confidence")
    assert isinstance(offer, type)
    assert issubclass(offer, FeatureFilter)
    return offer.model_validate({"share": share})


def calibration_error(probability: FloatArray, truth: BoolArray) -> float:
    """The expected calibration error over ten equal bins (Naeini et al. 2015, doi:10.1609/aaai.v29i1.9602)."""
    at = np.minimum((probability * BINS).astype(int), BINS - 1)
    gap = np.bincount(at, probability, BINS) - np.bincount(at, truth, BINS)
    return float(np.abs(gap).sum() / len(truth))


def precision(families: Sequence[str], seeds: range, share: float) -> str:
    """The table of families: base rate, precision of both filters with its interval, and calibration."""
    lines = []
    for family in families:
        every = [found(simulate_family(family, seed), share) for seed in seeds]
        truth = np.concatenate([f.truth for f in every])
        probability = np.concatenate([f.probability for f in every])
        right, of = _right([(f.truth, f.chosen) for f in every])
        low, high = wilson(right, of)
        by_scene = sorted(float(f.truth[f.chosen].mean()) for f in every)
        lines.append(
            (
                family,
                percent(truth.sum(), len(truth)),
                percent(*_right([(f.truth, f.plain) for f in every])),
                percent(right, of),
                f"{100 * low:.1f}-{100 * high:.1f}",
                f"{100 * by_scene[0]:.1f} %",
                f"{calibration_error(probability, truth):.3f}",
                f"{statistics.median(calibration_error(f.probability, f.truth) for f in every):.3f}",
            )
        )
    header = ("family", "in both", "confidence", "landmarks", "95 %", "worst", "ECE", "ECE of one")
    return table(header, lines)


def _right(cases: Sequence[tuple[BoolArray, BoolArray]]) -> tuple[int, int]:
    return sum(int(truth[kept].sum()) for truth, kept in cases), sum(int(kept.sum()) for _, kept in cases)


def sizes(trees: Sequence[int]) -> str:
    """Seconds for all probabilities and for the whole filter over sizes, on one thread, once the network is tabulated:
    the fastest of several."""
    network.posterior(network.none())
    lines = []
    for size in trees:
        pair = near(simulate(Scene(trees=size, rotation="any"), seed=0))
        seconds = [
            min(timed_once(work, pair) for _ in range(REPEATS))
            for work in (lambda pair: probabilities(pair, Context()), lambda pair: Landmarks().select(pair, Context()))
        ]
        together = len(pair.reference) + len(pair.source)
        lines.append((f"{together:,}", f"{seconds[0]:.2f} s", f"{seconds[1]:.2f} s"))
    return table(("trees of both surveys", "probabilities", "filter"), lines)


def timed_once(work: Callable[[Pair], object], pair: Pair) -> float:
    """Seconds on new copies of the surveys, of which nothing was worked out before."""
    fresh = Pair(pair.reference.replace(), pair.source.replace(), pair.reference_from_source)
    begin = time.perf_counter()
    work(fresh)
    return time.perf_counter() - begin


def learned(seeds: int) -> dict[str, FloatArray]:
    """Counts over simulated surveys whose truth is known; the same seeds give the same counts."""
    total = network.none()
    for seed in range(seeds):
        for place, family in enumerate(LEARNED_FROM):
            rng = np.random.default_rng([place, seed])
            simulation, state = remembered(family, 1000 * place + seed, rng)
            pair = begun(simulation, rng)
            truths = true_landmarks(simulation)
            shown = simulation.reference_trees, simulation.source_trees
            for seen, trees, landmark in zip(evidence_of(pair, state, Rigid.identity()), shown, truths, strict=True):
                more = count(seen, (trees[:, 0] >= 0).astype(float), landmark.astype(float))
                total = {node: total[node] + more[node] for node in STATES}
        print(f"{seed + 1} of {seeds}", file=sys.stderr, flush=True)
    return total


def begun(simulation: Simulation, rng: np.random.Generator) -> Pair:
    """A pair at one of the starts that a filter is made for: the truth, or near it; some with rows.

    From starts astray it would learn that landmarks often have nothing at their place, and doubt all others.
    """
    assert simulation.truth is not None
    close, rows = rng.random() < 0.5, rng.random() < 0.4
    pair = Pair(simulation.reference, simulation.source, simulation.truth)
    if close:
        pair = near(simulation, int(rng.integers(1000)))
    if rows:
        detected = [timed("aco", features)[0] for features in (pair.reference, pair.source)]
        pair = replace(pair, rows=MatchedRows(detected[0], detected[1], NO_MATCHES))
    return pair


def remembered(family: str, seed: int, rng: np.random.Generator) -> tuple[Simulation, dict[str, object]]:
    """Two surveys, and what earlier ones of the same orchard left in a memory: none in half of the cases, else one to
    five between the two."""
    if rng.random() < 0.5:
        return simulate_family(family, seed), {}
    scene = family_scene(family, seed)
    seasons = Seasons(surveys=int(rng.integers(3, 8)), seen=scene.overlap, persistence=rng.uniform(0, 0.4))
    series = simulate_series(scene, seed, seasons)
    memory = Memory()
    for capture in series.captures[1:-1]:
        xy = capture.reference_from_source(capture.features.xy)
        memory = memory.with_trees(xy, *shown_by(capture.features.replace(xy=xy)))
    return pair_of(series, seasons.surveys - 1), memory.state()


def shown_by(features: FeatureSet) -> tuple[float, Callable[[FloatArray], BoolArray]]:
    """The in-row step of a survey and which points it covers."""
    step = Planting.of(features).step
    return step, footprint(features.xy, step).covers


def as_text(counts: dict[str, FloatArray]) -> str:
    """The prior's file: a line for each state of a node's parents."""
    about = "counts of simulated trees by the states of the node's parents, then its own; see structure.py"
    tables = [f'  "{node}": {nested(np.rint(counts[node]).astype(int).tolist(), 4)}' for node in STATES]
    return f'{{\n "about": {json.dumps(about)},\n "counts": {{\n' + ",\n".join(tables) + "\n }\n}\n"


def nested(values: list[Any], indent: int) -> str:
    """Nested lists as JSON, each innermost one on a line."""
    if not isinstance(values[0], list):
        return json.dumps(values)
    inner = f",\n{' ' * indent}".join(nested(value, indent + 1) for value in values)
    return f"[\n{' ' * indent}{inner}]"


if __name__ == "__main__":
    sys.exit(main())
