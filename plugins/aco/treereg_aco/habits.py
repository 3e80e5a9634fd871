"""How the ants behave."""

from __future__ import annotations

from typing import NamedTuple


class Habits(NamedTuple):
    """The method's settings as compiled code takes them; `angle_limit` in degrees, NaN: chosen from the survey."""

    neighbours: int
    ants: int
    iterations: int
    elites: int
    pheromone_power: float
    heuristic_power: float
    evaporation: float
    deposit_window: int
    distance_weight: float
    angle_weight: float
    angle_limit: float
    reach: float
    stitching_reach: float
