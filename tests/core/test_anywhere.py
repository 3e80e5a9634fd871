"""The whole command on surveys anywhere on earth, in any CRS: accepted where they belong, or refused in a sentence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from earth import WGS84, Drawn, Place, drawn, ran, rms
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from treereg_core.simulate import Scene, Simulation, simulate

TOLERANCE_M = 0.03
"""The error near Ceres is 0.016 m, expected 0.025 m."""
CLEAR = Scene(trees=250, jitter=0.15, rotation="any", shift_sd=15.0)
LATITUDES = (90.0, 89.9999, 89.99, 84.0001, 84.0, 83.9995, 60.0, 0.0001, 0.0, -0.0001, -79.9995, -80.0, -89.9999, -90.0)
LONGITUDES = (0.0, 5.9999, 6.0, 179.9999, 180.0, -179.9999, -180.0, -77.0)
ELSEWHERE = (
    (19.3, -33.4, "EPSG:32734", "EPSG:2048", "EPSG:4148", "EPSG:3857"),
    (146.0, -36.0, "EPSG:28355", "EPSG:3112"),
    (175.0, -39.0, "EPSG:2193", "EPSG:27200"),
    (-47.0, -22.0, "EPSG:31983", "EPSG:5880"),
    (-121.5, 38.5, "EPSG:2226", "EPSG:26910", "EPSG:4269"),
    (-0.0002, 51.5, "EPSG:27700", "EPSG:32631", "EPSG:32630"),
    (2.35, 48.85, "EPSG:2154", "EPSG:4807"),
    (14.5, 50.1, "EPSG:5514", "EPSG:5513"),
    (179.9999, -17.0, "EPSG:32760", "EPSG:32701", "EPSG:3460", "EPSG:3832"),
    (180.0, 70.0, "EPSG:32601", "EPSG:3576"),
    (100.0, -89.99, "EPSG:3031", "EPSG:32761", "EPSG:5042"),
    (-60.0, 89.99, "EPSG:3413", "EPSG:32661", "EPSG:5041"),
)
"""Longitude, latitude, and CRSs in use there: of the south, in feet, in grads, counting westwards, of the poles."""


@cache
def orchard() -> tuple[Simulation, tuple[Drawn, Drawn]]:
    simulation = simulate(CLEAR, 1)
    return simulation, drawn(simulation)


def require_right(place: Place, crs: tuple[str, str] = (WGS84, WGS84)) -> None:
    """Accepted, and right: the transform, and the moved file."""
    simulation, surveys = orchard()
    assert simulation.truth is not None
    found = ran(surveys, place, crs)
    assert found.verdict == "accepted"
    assert rms(found.moved(simulation.source.xy, place), simulation.truth(simulation.source.xy)) < TOLERANCE_M
    assert found.registered
    rings = np.array([feature["geometry"]["coordinates"][0][:-1] for feature in found.registered["features"]])
    meant = simulation.truth(surveys[1].rings.reshape(-1, 2))
    assert rms(place.at(rings.reshape(-1, 2)), meant) < TOLERANCE_M


@settings(max_examples=25, suppress_health_check=list(HealthCheck))
@given(
    longitude=st.sampled_from(LONGITUDES) | st.floats(-180, 180),
    latitude=st.sampled_from(LATITUDES) | st.floats(-90, 90),
    turn_deg=st.floats(-180, 180),
)
@example(longitude=180.0, latitude=-17.0, turn_deg=10.0)
@example(longitude=6.0, latitude=0.0, turn_deg=0.0)
@example(longitude=0.0, latitude=90.0, turn_deg=0.0)
@example(longitude=0.0, latitude=-90.0, turn_deg=0.0)
def test_degrees_anywhere_on_earth(longitude: float, latitude: float, turn_deg: float) -> None:
    require_right(Place(longitude, latitude, turn_deg))


@pytest.mark.parametrize(
    ("place", "crs"),
    [
        (Place(longitude, latitude, -40.0), pair)
        for longitude, latitude, *systems in ELSEWHERE
        for pair in zip([WGS84, *systems], [*systems, WGS84], strict=True)
    ],
)
def test_surveys_in_different_reference_systems(place: Place, crs: tuple[str, str]) -> None:
    require_right(place, crs)
