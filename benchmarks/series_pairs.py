"""Surveys of a simulated series as pairs: each beside the first, with its truth."""

from __future__ import annotations

from treereg_core.simulate import SeriesSimulation, Simulation, Trees


def pair_of(series: SeriesSimulation, survey: int) -> Simulation:
    """One survey of a series, by its number from 0, as the source of a pair whose reference is the first."""
    first, other = series.captures[0], series.captures[survey]
    orchard = series.lives.orchard
    return Simulation(
        scene=series.scene,
        seed=series.seed,
        reference=first.features,
        source=other.features,
        truth=other.reference_from_source,
        bend=0.0,
        trees=Trees(orchard.xy, orchard.area, orchard.row, orchard.column),
        reference_trees=first.trees,
        source_trees=other.trees,
        outline=orchard.outline,
    )
