"""Crowns as they stand out of the ground: trees, and the bushes and weeds that a detector takes for trees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from treereg_core.features import FeatureSet, IntArray
from treereg_core.simulate.canopy import canopies
from treereg_core.simulate.flight import Flight
from treereg_core.simulate.grid import CELL, Grid
from treereg_core.simulate.texture import Picture, Texture
from treereg_core.transform import FloatArray

ANGLES = 64
"""Directions in which the outline of a crown is known."""
SKIRT = 0.35
"""How high a crown is at its edge, as a share of the tree's height."""
ROUND = 2.4
"""2 makes a crown half an ellipsoid, more makes it flatter on top and steeper at its edge."""
LUMPS = 0.11
"""Of the leaves on the surface of a crown, sd as a share of its radius."""
RAGGED = 0.06
"""Of a crown's edge, sd as a share of the radius."""
FALSE_KINDS = (0.45, 0.35)
"""Shares of false detections that are weeds and bushes; at the others there is nothing."""
WEED_M, BUSH_M = (0.1, 0.35), (0.5, 1.3)
"""How high they are."""


@dataclass(frozen=True, eq=False)
class Crowns:
    """All that stands out of the ground, in the coordinates of the survey, metres.

    - `xy` (n, 2) and `radius` (n, ANGLES): the middle and the outline, from the east counter-clockwise.
    - `base`, `height` (n,): the ground's elevation in the middle, and the height above it.
    - `look` (n, 2): two numbers, normal, that tell how its leaves differ from others': lighter, yellower.
    - `patch` (n, 2): where in the pattern of leaves its own lie.
    """

    xy: FloatArray
    radius: FloatArray
    base: FloatArray
    height: FloatArray
    look: FloatArray
    patch: FloatArray

    @classmethod
    def of(cls, flight: Flight, survey: FeatureSet, outlines: FloatArray, seeds: tuple[list[int], list[int]]) -> Crowns:
        """The crowns at the time of a flight; `outlines` (m, k, 2) are those of the survey's features.

        A tree that one feature shows whole has the outline of that, about the tree's own place; any other one of its
        own. `seeds` are of what lasts and of what is new in this flight.
        """
        lasting, passing = (np.random.default_rng(seed) for seed in seeds)
        n = len(flight.orchard.xy)
        look, patch = lasting.standard_normal((n, 2)), lasting.uniform(0, 100, (n, 2))
        area = flight.orchard.area * flight.visit.growth**2
        ring = canopies(FeatureSet.of(np.zeros((n, 2)), area=area), passing)
        whole = flight.trees[:, 1] < 0
        shown, count = np.unique(flight.trees[whole, 0], return_counts=True)
        once = whole & np.isin(flight.trees[:, 0], shown[(count == 1) & (shown >= 0)])
        ring[flight.trees[once, 0]] = outlines[once] - survey.xy[once, None]
        standing = np.flatnonzero(flight.visit.alive)
        xy = flight.orchard.xy[standing]
        trees = cls(
            xy=flight.displacement(xy),
            radius=_radius(ring[standing]),
            base=flight.ground(xy) - flight.ground.level,
            height=flight.height[standing],
            look=look[standing],
            patch=patch[standing],
        )
        return trees._and(_false(flight, survey, outlines, passing))

    def _and(self, others: Crowns) -> Crowns:
        return Crowns(*(np.concatenate([vars(self)[name], vars(others)[name]]) for name in vars(self)))

    def within(self, grid: Grid) -> IntArray:
        """Which of them reach into a grid."""
        reach = self.radius.max(axis=1)
        x, y = self.xy.T
        east, south = grid.west + grid.width * CELL, grid.north - grid.height * CELL
        inside = (x + reach > grid.west) & (x - reach < east) & (y + reach > south) & (y - reach < grid.north)
        return np.flatnonzero(inside)

    def raise_on(self, surface: Picture, grid: Grid, leaves: Texture, turn_deg: float) -> tuple[Picture, IntArray]:
        """Raise the elevations of a grid to the crowns, in place.

        Gives how high in its crown each pixel is, 0 at the edge and 1 at the top, and which crown it shows, -1: none.
        `turn_deg` is how far the survey is turned against the orchard, whose leaves keep their places.
        """
        depth = np.zeros(surface.shape, dtype=np.float32)
        shows = np.full(surface.shape, -1)
        cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        for i in self.within(grid):
            rows, columns = self._window(i, grid)
            dx = (grid.x[columns] - self.xy[i, 0]).astype(np.float32)[None, :]
            dy = (grid.y[rows] - self.xy[i, 1]).astype(np.float32)[:, None]
            leaf = leaves(
                cos * dx + sin * dy + np.float32(self.patch[i, 0]), cos * dy - sin * dx + np.float32(self.patch[i, 1])
            )
            size = float(self.radius[i].mean())
            direction = np.arctan2(dy, dx) * np.float32(ANGLES / (2 * np.pi))
            edge = np.interp(direction, np.arange(ANGLES), self.radius[i], period=ANGLES).astype(np.float32)
            share = np.hypot(dx, dy) / edge * (1 + np.float32(RAGGED) * leaf)
            dome = np.sqrt(np.maximum(1 - share ** np.float32(ROUND), 0))
            high = float(self.height[i])
            lumps = np.float32(LUMPS * min(high, 1.0) * size) * np.minimum(leaf, 1)
            top = np.float32(self.base[i]) + np.float32(high) * (SKIRT + (1 - SKIRT) * dome) + lumps
            here = (share < 1) & (top > surface[rows, columns])
            surface[rows, columns][here] = top[here]
            depth[rows, columns][here] = dome[here]
            shows[rows, columns][here] = i
        return depth, shows

    def _window(self, i: int, grid: Grid) -> tuple[slice, slice]:
        reach = self.radius[i].max() * (1 + 3 * RAGGED)
        row = (grid.north - self.xy[i, 1]) / CELL
        column = (self.xy[i, 0] - grid.west) / CELL
        pixels = reach / CELL
        return (
            slice(max(int(row - pixels), 0), max(min(int(row + pixels) + 1, grid.height), 0)),
            slice(max(int(column - pixels), 0), max(min(int(column + pixels) + 1, grid.width), 0)),
        )


def _false(flight: Flight, survey: FeatureSet, outlines: FloatArray, rng: np.random.Generator) -> Crowns:
    """The weeds and bushes that false detections show."""
    false = np.flatnonzero(flight.trees[:, 0] < 0)
    kind = rng.random(len(false))
    weeds, bushes = kind < FALSE_KINDS[0], kind > 1 - FALSE_KINDS[1]
    height = np.where(weeds, rng.uniform(*WEED_M, len(false)), rng.uniform(*BUSH_M, len(false)))
    look, patch = rng.normal([0.8, 1.0], 1.0, (len(false), 2)), rng.uniform(0, 100, (len(false), 2))
    there = weeds | bushes
    xy = survey.xy[false]
    return Crowns(
        xy=xy[there],
        radius=_radius(outlines[false] - xy[:, None])[there],
        base=(flight.ground(flight.displacement.inverse(xy)) - flight.ground.level)[there],
        height=height[there],
        look=look[there],
        patch=patch[there],
    )


def _radius(rings: FloatArray) -> FloatArray:
    """Of outlines about (0, 0), (n, k, 2): their distances in each direction, (n, ANGLES)."""
    direction = np.arctan2(rings[..., 1], rings[..., 0]) % (2 * np.pi)
    distance = np.hypot(rings[..., 0], rings[..., 1])
    asked = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    radius = [np.interp(asked, a, d, period=2 * np.pi) for a, d in zip(direction, distance, strict=True)]
    return np.array(radius).reshape(-1, ANGLES)
