"""Scenery: what a flight over a simulated orchard shows, pixel by pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from treereg_core.features import BoolArray, FeatureSet
from treereg_core.simulate.crowns import Crowns
from treereg_core.simulate.flight import Flight
from treereg_core.simulate.grid import CELL, Grid, Nodes
from treereg_core.simulate.light import SEASONS, Light, facing, openness, photograph, shadows
from treereg_core.simulate.texture import Picture, Texture
from treereg_core.simulate.view import View
from treereg_core.transform import FloatArray

MARGIN_M = 9.0
"""How far a flight reaches beyond the orchard."""
BEYOND_VIEW_M = 4.0
"""How far it reaches beyond the part that its detections are from."""
TRACKS_M = 0.8
"""The wheels of a tractor, from the middle of an alley."""
BARE_M = 0.95
"""Beside a row the soil is kept bare, to about this distance from its line."""
NOISE_M = 0.03
"""Of its elevations."""

_LASTING, _PASSING, _CROWNS = 3, 4, 5
"""Random streams of the images; those below are of the simulation."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """All that the images of one flight are made from. `turn_deg`: of the survey against the orchard."""

    flight: Flight
    crowns: Crowns
    light: Light
    leaves: Texture
    soil: Texture
    grain: Texture
    seed: list[int]

    @classmethod
    def of(cls, flight: Flight, survey: FeatureSet, outlines: FloatArray, seed: int, which: int) -> Scenery:
        """The scenery of a survey whose features have these outlines; `which` is 0 for the reference, 1 for the source.

        Soil and leaves are the same in both, where both show one orchard.
        """
        lasting = np.random.default_rng([seed, _LASTING])
        return cls(
            flight=flight,
            crowns=Crowns.of(flight, survey, outlines, ([seed, _CROWNS], [seed, _CROWNS, which])),
            light=SEASONS[which],
            leaves=Texture.drawn((0.16, 0.8), 0.05, lasting),
            soil=Texture.drawn((0.4, 45.0), 0.2, lasting),
            grain=Texture.drawn((0.12, 1.0), 0.05, lasting),
            seed=[seed, _PASSING, which],
        )

    @property
    def extent(self) -> FloatArray:
        """Points of the survey (k, 2), metres, around all that its images show."""
        positions = self.flight.orchard.positions
        seen = self._flown().sees(positions)
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * MARGIN_M
        points = positions[seen] if seen.any() else positions
        return np.concatenate([self.flight.displacement(points + step) for step in around])

    def paint(self, grid: Grid) -> tuple[NDArray[np.uint8], Picture, BoolArray]:
        """Red, green and blue (3, h, w), 1 to 255; elevations (h, w), metres; and which pixels were flown over."""
        halo = 2 + math.ceil(float(self.crowns.height.max(initial=1)) / self.light.slope / CELL)
        wide = grid.part(-halo, -halo, grid.height + 2 * halo, grid.width + 2 * halo)
        place = _Place.of(self.flight, wide)
        x, y = place.x, place.y
        grass, bare, worn = self._cover(place)
        grain = self.grain(x, y)
        surface = place.ground + grass * (np.float32(0.07) + np.float32(0.03) * grain) - np.float32(0.05) * worn
        turn_deg = self.flight.displacement.misplaced.rotation_deg
        depth, shows = self.crowns.raise_on(surface, wide, self.leaves, turn_deg)

        inner = slice(halo, -halo), slice(halo, -halo)
        lit = shadows(surface, self.light, turn_deg, halo)
        lit *= facing(surface, self.light, turn_deg)[inner]
        sky = openness(surface)[inner]
        soil = self._colours(grass, bare, worn, grain, self.soil(x, y))
        depth += np.float32(0.3) * grain
        colours = self._with_crowns([band[inner] for band in soil], depth[inner], shows[inner])
        rng = np.random.default_rng([*self.seed, *(round(at / CELL) % 2**32 for at in (grid.west, grid.north))])
        noise = np.float32(0.011) * rng.standard_normal(lit.shape, dtype=np.float32)
        bands = [band + noise for band in photograph(colours, lit, sky, self.light)]
        rgb = np.stack([np.clip(np.rint(band * 255), 1, 255).astype(np.uint8) for band in bands])

        rough = gaussian_filter(rng.standard_normal(lit.shape, dtype=np.float32), 1.5) * np.float32(5.3 * NOISE_M)
        elevation = (
            gaussian_filter(surface, 0.9)[inner] + rough + np.float32(self.flight.ground.level + self.flight.datum)
        )
        flown = self._inside(np.column_stack([x[inner].ravel(), y[inner].ravel()])).reshape(lit.shape)
        return rgb, elevation, flown

    def _cover(self, place: _Place) -> tuple[Picture, Picture, Picture]:
        """Of each pixel: how much of it is grass, bare kept soil, and worn by wheels; 0 to 1."""
        rows = self.flight.orchard.rows
        half = np.float32(rows.apart / 2)
        patch = self.soil(place.x, place.y)
        turns = (place.across - np.float32(rows.first)) / (2 * half)
        from_row = 2 * half * np.abs(turns - np.rint(turns))
        bare = min(BARE_M, 0.42 * rows.apart / 2 + 0.2)
        tracks = min(TRACKS_M, 0.45 * rows.apart / 2)
        inside = _ramp(np.float32(1.0 * rows.apart) - place.edge, 0.8)
        strip = inside * _ramp(np.float32(bare) - from_row + np.float32(0.12) * patch, 0.3)
        alley = np.exp(-(((half - from_row - np.float32(tracks)) / np.float32(0.2)) ** 2))
        worn = inside * alley * np.clip(np.float32(0.75) + np.float32(0.3) * patch, 0, 1)
        lane = np.exp(-np.square(np.square((place.edge - np.float32(rows.apart + 2.2)) / np.float32(1.3))))
        worn = np.maximum(worn, lane * np.clip(np.float32(0.85) + np.float32(0.15) * patch, 0, 1))
        thick = np.float32(0.9) + np.float32(0.55) * patch + np.float32(0.25) * self.grain(place.x, place.y)
        grass = (1 - strip) * (1 - np.float32(0.85) * worn) * _ramp(thick, 2.2)
        return grass, strip, worn

    def _colours(self, grass: Picture, bare: Picture, worn: Picture, grain: Picture, patch: Picture) -> list[Picture]:
        """What the ground reflects, by colour."""
        tone = 1 + np.float32(0.1) * grain + np.float32(0.07) * patch
        blade = 1 + np.float32(0.17) * grain - np.float32(0.1) * patch
        bands = []
        for soil, track, green in zip(self.light.soil, self.light.track, self.light.grass, strict=True):
            earth = np.float32(soil) + np.float32(track - soil) * worn - np.float32(0.1 * soil) * bare
            bands.append(earth * tone * (1 - grass) + np.float32(green) * blade * grass)
        return bands

    def _with_crowns(self, ground: list[Picture], depth: Picture, shows: NDArray[np.int64]) -> list[Picture]:
        """The same with the leaves of crowns on it: darker within, lighter on top."""
        there = shows >= 0
        light, yellow = self.crowns.look[shows[there]].T.astype(np.float32)
        tone = (np.float32(0.72) + np.float32(0.4) * depth[there]) * (1 + np.float32(0.1) * light)
        for band, leaf, hue in zip(ground, self.light.leaves, (0.13, 0.05, -0.03), strict=True):
            band[there] = np.float32(leaf) * tone * (1 + np.float32(hue) * yellow)
        return ground

    def _box(self) -> tuple[FloatArray, FloatArray]:
        positions = self.flight.orchard.positions
        return positions.min(axis=0) - MARGIN_M, positions.max(axis=0) + MARGIN_M

    def _flown(self) -> View:
        view = self.flight.visit.view
        return View(view.directions, view.low - BEYOND_VIEW_M, view.high + BEYOND_VIEW_M)

    def _inside(self, points: FloatArray) -> BoolArray:
        low, high = self._box()
        return self._flown().sees(points) & ((points >= low) & (points <= high)).all(axis=1)


@dataclass(frozen=True, eq=False)
class _Place:
    """For each pixel where it truly lies, metres: in the orchard, across the rows, from the nearest tree's position."""

    x: Picture
    y: Picture
    across: Picture
    edge: Picture
    ground: Picture

    @classmethod
    def of(cls, flight: Flight, grid: Grid) -> _Place:
        nodes = Nodes.of(grid)
        true = flight.displacement.inverse(nodes.points)
        edge, _ = cKDTree(flight.orchard.positions).query(true)
        ground = flight.ground(true) - flight.ground.level
        values = (*true.T, flight.orchard.rows.inverse(true)[:, 1], edge, ground)
        return cls(*(nodes.spread(np.asarray(some)) for some in values))


def _ramp(values: Picture, width: float) -> Picture:
    """0 below, 1 above, and a smooth rise of this width about 0."""
    share = np.clip(values / np.float32(width) + np.float32(0.5), 0, 1)
    return cast(Picture, share * share * (3 - 2 * share))
