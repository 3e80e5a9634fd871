"""Correlation: every shift of one survey over another at once, by FFT, and the shifts worth a closer look."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from treereg_core.evidence import Evidence
from treereg_core.features import IntArray, largest
from treereg_core.threads import concurrently
from treereg_core.transform import Affine, FloatArray

Map = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
T = TypeVar("T")

# Cells of the maps of coverage, which vary slowly, in tree spacings.
COARSE_CELL = 4 / 3
# Cells from which threads gain more than they cost.
WORTH_THREADS = 1_000_000
# Rows of a map that are searched for maxima at once.
STRIP = 64
# A shift must let so many trees, and this share of the smaller survey, meet; of a handful of trees a good part.
LEAST_TREES = 8.0
LEAST_COMMON = 0.04
FEW_COMMON = 0.35


@dataclass(frozen=True)
class Grid:
    """How finely surveys are drawn, in tree spacings: the cells, and the radius within which two trees meet."""

    cell: float
    kernel: float


ROUGH = Grid(1 / 3, 0.25)
"""Forgives noise and some error in the rotation."""
FINE = Grid(1 / 5, 0.15)
"""Tells placements apart by the small errors of planting, where trees were found precisely."""


@dataclass(frozen=True, eq=False)
class Peaks:
    """Shifts at which many trees meet, best first, all with the linear part and of the kind of `template`.

    `shift` (k, 2) metres; `met` (k,) is about how many trees meet there; `score` (k,) ranks them: the evidence
    (twice the log-likelihood) that the share of met trees and the agreement of their crowns give, against all other
    peaks.
    """

    template: Affine
    shift: FloatArray
    met: FloatArray
    score: FloatArray

    def __len__(self) -> int:
        return len(self.shift)

    def foremost(self, count: int) -> IntArray:
        """Positions of the best by score, and of as many at which most trees meet."""
        return np.unique(np.concatenate([np.arange(min(count, len(self))), largest(self.met, count)]))

    def transform(self, k: int) -> Affine:
        """The k-th placement."""
        return type(self.template)(self.template.linear, self.shift[k])


class Correlator:
    """Correlates two surveys under any linear map.

    Density and crown size (the evidence's scores) are drawn on a grid of a third of the tree spacing or less; on
    coarser grids neighbouring peaks merge. The half turn comes with every map at the price of two inverse transforms.
    Cross-correlation as in Reddy & Chatterji 1996, doi:10.1109/83.506761, on points instead of pixels.
    """

    def __init__(self, evidence: Evidence, grid: Grid = ROUGH) -> None:
        self.reference, self.source = evidence.reference, evidence.source
        self.spacing, self.threads = evidence.spacing, evidence.threads
        self.cell, self.kernel = grid.cell * evidence.spacing, grid.kernel * evidence.spacing
        sides = (self.reference, self.source)
        self.weights = [
            np.clip(side.features.confidence / max(float(side.features.confidence.mean()), 1e-9), 0.3, 1.5)
            for side in sides
        ]
        smaller = min(float(w.sum()) for w in self.weights)
        self.least = max(min(LEAST_TREES, FEW_COMMON * smaller), LEAST_COMMON * smaller)

    def at(self, template: Affine) -> tuple[Peaks, Peaks]:
        """All shifts worth a look for the linear part of `template`, and for that and a half turn."""
        reference, source = self.reference, self.source
        kind, nowhere = type(template), np.zeros(2)
        onto = kind(template.linear, nowhere)
        fixed_points, moved_points = reference.features.xy, onto(source.features.xy)
        fixed_low, moved_low = fixed_points.min(axis=0), moved_points.min(axis=0)
        size = np.ptp(fixed_points, axis=0) + np.ptp(moved_points, axis=0) + 4 * self.cell
        shape = self._shape(size, self.cell)
        workers = self.threads if shape[0] * shape[1] > WORTH_THREADS else 1

        coarse_cell = COARSE_CELL * self.spacing
        coarse_shape = self._shape(size + 2 * coarse_cell, coarse_cell)
        everywhere, trees = self._coverage(0, kind.identity(), fixed_low, coarse_cell, coarse_shape)
        moving_everywhere, moving_trees = self._coverage(1, onto, moved_low, coarse_cell, coarse_shape)

        def correlate(a: Spectrum, b: Spectrum, s: tuple[int, int], sign: int) -> Map:
            product = np.conj(b) if sign > 0 else b  # which nobody wants again
            product *= a
            return np.asarray(fft.irfft2(product, s=s, workers=workers, overwrite_x=True))

        def spectrum(side: int, points: FloatArray, scored: bool) -> Spectrum:
            values = self.weights[side]
            if scored:
                values = values * (reference, source)[side].scores["area"]
            picture = _Brush(points / self.cell, shape).draw(values)
            return np.asarray(fft.rfft2(picture, workers=workers, overwrite_x=True))

        def both(scored: bool, look: Callable[[int, Map], T]) -> tuple[T, T]:
            """What `look` finds on the map of how many trees meet, or how well crowns do, and on the half turn's."""
            # Maps of a large field take much memory: each is gone before the next is made.
            fixed = spectrum(0, fixed_points - fixed_low, scored)
            for factor in _gaussian(shape, self.kernel / self.cell):
                fixed *= factor
            moving = spectrum(1, moved_points - moved_low, scored)
            return look(1, correlate(fixed, moving, shape, 1)), look(-1, correlate(fixed, moving, shape, -1))

        def maxima(sign: int, met: Map) -> _Maxima:
            covered = (
                correlate(trees, moving_everywhere, coarse_shape, sign),
                correlate(everywhere, moving_trees, coarse_shape, sign),
            )
            common = np.sqrt(np.maximum(covered[0], 0) * np.maximum(covered[1], 0))
            # Indices count f - m for the map itself, which wraps below 0, and f + m for the half turn, which does not.
            limit = np.ptp(fixed_points, axis=0) / self.cell + 2 if sign > 0 else np.array(shape)
            return self._maxima(met, common, coarse_cell, limit)

        places = dict(zip((1, -1), both(False, maxima), strict=True))

        def peaks(sign: int, crowns: Map) -> Peaks:
            found = places[sign]
            order, score = found.ranked(crowns[found.cell])
            turned = kind(sign * template.linear, nowhere)
            return Peaks(turned, found.shift[order] + fixed_low - sign * moved_low, found.met[order], score)

        return both(True, peaks)

    @staticmethod
    def _shape(size: FloatArray, cell: float) -> tuple[int, int]:
        x, y = (fft.next_fast_len(int(np.ceil(s / cell)) + 1, real=True) for s in size)
        return x, y

    def _coverage(
        self, side: int, onto: Affine, corner: FloatArray, cell: float, shape: tuple[int, int]
    ) -> tuple[Spectrum, Spectrum]:
        """Spectra of a survey's footprint (1 inside, 0 outside) and of its trees."""
        survey = (self.reference, self.source)[side]
        ground = onto(survey.footprint.points) - corner
        share = np.full(len(ground), (survey.footprint.cell / cell) ** 2)
        trees = onto(survey.features.xy) - corner
        inside = fft.rfft2(_Brush(ground / cell, shape).draw(share))
        return np.asarray(inside), np.asarray(fft.rfft2(_Brush(trees / cell, shape).draw(self.weights[side])))

    def _maxima(self, met: Map, common: Map, coarse_cell: float, limit: FloatArray) -> _Maxima:
        """Where enough of the trees that both surveys cover meet, and more than at any shift beside it."""
        i, j = _tops(met, self.least / 3, self.threads)
        fine = np.column_stack([_parabola(met, i, j, axis) for axis in (0, 1)])
        shift = np.column_stack([i, j]) + fine
        shift = np.where(shift > limit, shift - met.shape, shift) * self.cell
        shared = ndimage.map_coordinates(common, (shift / coarse_cell).T, order=1, mode="grid-wrap")
        keep = shared > self.least
        i, j = i[keep], j[keep]
        return _Maxima((i, j), shift[keep], met[i, j].astype(np.float64), shared[keep].astype(np.float64))


@dataclass(frozen=True, eq=False)
class _Maxima:
    """Local maxima (k,) of the trees that meet: their `cell`, `shift` (k, 2) in metres, trees `met` and `shared`."""

    cell: tuple[IntArray, IntArray]
    shift: FloatArray
    met: FloatArray
    shared: FloatArray

    def ranked(self, crowns: Map) -> tuple[IntArray, FloatArray]:
        """Their order, best first, and the scores in that order; `crowns` (k,) tells how crowns agree there."""
        # The peaks that most trees meet at are what a wrong placement on the lattice looks like.
        decoys = largest(self.met, max(60, len(self.met) // 20))
        share = self.met / self.shared
        z_met = (share - np.median(share[decoys]) if len(decoys) else share) * np.sqrt(self.shared)
        z_crowns = crowns.astype(np.float64) / np.sqrt(np.maximum(self.met, 1))
        score = _signed_square(_unit(z_met, decoys, 0.2)) + _signed_square(_unit(z_crowns, decoys, 0.3))
        order = np.argsort(-score, kind="stable")
        return order, score[order]


class _Brush:
    """Draws values at fixed grid positions (n, 2), each shared among its four nearest cells; the grid wraps around."""

    def __init__(self, position: FloatArray, shape: tuple[int, int]) -> None:
        low = np.floor(position)
        x, y = (position - low).T
        i, j = low.astype(np.int64).T
        rows = [(i % shape[0] * shape[1], 1 - x), ((i + 1) % shape[0] * shape[1], x)]
        columns = [(j % shape[1], 1 - y), ((j + 1) % shape[1], y)]
        self.shape = shape
        self.shares = [(row + column, a * b) for row, a in rows for column, b in columns]

    def draw(self, values: FloatArray) -> Map:
        """The grid of these values, one for each position."""
        grid = np.zeros(self.shape[0] * self.shape[1], dtype=np.float32)
        for cell, share in self.shares:
            np.add.at(grid, cell, (share * values).astype(np.float32))
        return grid.reshape(self.shape)


def _gaussian(shape: tuple[int, int], sigma: float) -> tuple[Map, Map]:
    """The transform of a Gaussian of height 1 and `sigma` cells, for `rfft2`: a factor for each axis."""
    x, y = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
    high = np.sqrt(2 * np.pi) * sigma
    x, y = (high * np.exp(-2 * (np.pi * sigma * f) ** 2) for f in (x, y))
    return x.astype(np.float32), y.astype(np.float32)


def _parabola(values: Map, i: IntArray, j: IntArray, axis: int) -> FloatArray:
    """Where between the cells a local maximum lies, -0.5 to 0.5, along one axis."""
    step_i, step_j = (1, 0) if axis == 0 else (0, 1)
    rows, columns = values.shape
    before = values[(i - step_i) % rows, (j - step_j) % columns]
    after = values[(i + step_i) % rows, (j + step_j) % columns]
    bend = before - 2 * values[i, j] + after
    return np.asarray(np.clip((before - after) / (2 * np.where(bend < 0, bend, -np.inf)), -0.5, 0.5))


def _tops(values: Map, least: float, threads: int) -> tuple[IntArray, IntArray]:
    """The cells above `least` that none of the eight around exceeds; the grid wraps around."""

    def tops(begin: int) -> tuple[IntArray, IntArray]:
        end = min(begin + STRIP, len(values))
        around = values[np.arange(begin - 1, end + 1) % len(values)]
        highest = np.maximum(np.maximum(around[:-2], around[1:-1]), around[2:])
        wide = np.concatenate([highest[:, -1:], highest, highest[:, :1]], axis=1)
        highest = np.maximum(np.maximum(wide[:, :-2], wide[:, 1:-1]), wide[:, 2:])
        middle = around[1:-1]
        i, j = np.nonzero((middle == highest) & (middle > least))
        return i + begin, j

    # a strip at a time stays in the processor's cache, several times faster than the filter of scipy
    found = concurrently(tops, range(0, len(values), STRIP), threads if values.size > WORTH_THREADS else 1)
    i, j = (np.concatenate(part) for part in zip(*found, strict=True))
    return i, j


def _signed_square(z: FloatArray) -> FloatArray:
    return np.sign(z) * z**2


def _unit(z: FloatArray, decoys: IntArray, least: float) -> FloatArray:
    """`z` over its robust spread among the decoys."""
    if len(decoys) == 0:
        return z
    spread = 1.4826 * float(np.median(np.abs(z[decoys] - np.median(z[decoys]))))
    return z / max(spread, least)
