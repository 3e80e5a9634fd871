"""Orchards and pairs of surveys made up with their truth.

`simulate(Scene(missed=0.2), seed=0)` gives two surveys, `simulate_series` a series of them; `FAMILIES` names the
conditions that tests and benchmarks use; `write_simulation` and `write_series` make survey folders of them.
"""

from treereg_core.simulate.families import FAMILIES, Family, family_scene, simulate_family
from treereg_core.simulate.files import write_series, write_simulation
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.series import Seasons, SeriesSimulation, simulate_series
from treereg_core.simulate.simulation import Simulation, Trees, simulate

__all__ = [
    "FAMILIES",
    "Family",
    "Scene",
    "Seasons",
    "SeriesSimulation",
    "Simulation",
    "Trees",
    "family_scene",
    "simulate",
    "simulate_family",
    "simulate_series",
    "write_series",
    "write_simulation",
]
