"""Light: where the sun stands and what colours a season has, and what they make of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from treereg_core.simulate.grid import CELL
from treereg_core.simulate.texture import Picture

Colour = tuple[float, float, float]
"""Red, green and blue, as a share of the light."""
STEP = 2
"""Pixels from one sample to the next on the way to the sun."""
BLUR = 0.55
"""Of the camera, pixels."""


@dataclass(frozen=True)
class Light:
    """A season and a time of day.

    The sun stands in `direction_deg`, from the east counter-clockwise, and `above_deg` above the horizon. All colours
    but those of sun and sky are what a thing reflects.
    """

    direction_deg: float
    above_deg: float
    sun: Colour
    sky: Colour
    haze: float
    soil: Colour
    track: Colour
    grass: Colour
    leaves: Colour

    @property
    def slope(self) -> float:
        """Metres up for each metre towards the sun."""
        return float(np.tan(np.radians(self.above_deg)))


SEASONS = (
    Light(48, 50, (1.0, 0.95, 0.86), (0.3, 0.34, 0.42), 0.015, (0.27, 0.185, 0.12), (0.36, 0.27, 0.185),
          (0.16, 0.21, 0.075), (0.062, 0.108, 0.034)),
    Light(141, 41, (1.04, 0.91, 0.74), (0.27, 0.32, 0.43), 0.03, (0.33, 0.245, 0.165), (0.42, 0.335, 0.24),
          (0.3, 0.275, 0.13), (0.07, 0.1, 0.036)),
)  # fmt: skip
"""Late in the morning in spring, and an afternoon after a dry summer."""


def shadows(surface: Picture, light: Light, turn_deg: float, halo: int) -> Picture:
    """How much of the sun each pixel gets, 0 to 1, for those `halo` pixels or more inside."""
    angle = np.radians(light.direction_deg + turn_deg)
    inner = surface[halo:-halo, halo:-halo]
    horizon = np.full_like(inner, -np.inf)
    for far in range(STEP, halo, STEP):
        right, up = round(far * np.cos(angle)), round(far * np.sin(angle))
        between = surface[halo - up : surface.shape[0] - halo - up, halo + right : surface.shape[1] - halo + right]
        np.maximum(horizon, between - np.float32(far * CELL * light.slope), out=horizon)
    hidden = np.clip((horizon - inner) / np.float32(0.18), 0, 1)
    return np.asarray(1 - gaussian_filter(hidden, 0.8))


def facing(surface: Picture, light: Light, turn_deg: float) -> Picture:
    """The cosine between the surface and the sun, over that of level ground; at least 0."""
    up, right = np.gradient(gaussian_filter(surface, 0.7), np.float32(CELL))
    angle, above = np.radians(light.direction_deg + turn_deg), np.radians(light.above_deg)
    toward = np.float32(np.cos(above) * np.cos(angle)) * right - np.float32(np.cos(above) * np.sin(angle)) * up
    level = np.float32(np.sin(above))
    return np.asarray(np.maximum(level - toward, 0) / (level * np.sqrt(1 + right**2 + up**2)))


def openness(surface: Picture) -> Picture:
    """How much of the sky a pixel sees, roughly: less in the depth between crowns."""
    around = uniform_filter(surface, 17)
    return np.asarray(np.clip(1 - (around - surface) / np.float32(3.2), 0.42, 1.12))


def photograph(reflectance: list[Picture], lit: Picture, sky: Picture, light: Light) -> list[Picture]:
    """Red, green and blue, 0 to 1, as a camera gives them: of what reflects, lit by the sun and by the sky."""
    bands = []
    for colour, sun, blue, haze in zip(reflectance, light.sun, light.sky, (0.9, 1.0, 1.15), strict=True):
        seen = colour * (np.float32(sun) * lit + np.float32(blue) * sky) + np.float32(light.haze * haze)
        bands.append(gaussian_filter(np.sqrt(np.clip(seen * np.float32(1.3), 0, 1)), BLUR))
    return bands
