"""Waves that an orchard makes: the structure factor of its trees in small windows, and its highest peaks."""

from __future__ import annotations

import heapq

import numpy as np

from treereg_aco.compiled import compiled
from treereg_core.features import BoolArray, IntArray
from treereg_core.transform import FloatArray

# Peaks kept for each window.
PEAKS = 6
# Trees that stand anywhere reach this power, the highest of hundreds, in one window of a hundred.
CHANCE = 11.0
# Neighbouring windows show the same rows when their wave vectors differ by less than this share of their length.
SAME = 0.3


@compiled
def window_peaks(
    xy: FloatArray, centre: FloatArray, members: IntArray, step: float, low: float, high: float
) -> tuple[FloatArray, FloatArray]:
    """Wave vectors (m, PEAKS, 2), per metre, and powers (m, PEAKS) of the highest peaks in each of m windows.

    `members` (m, k) are positions in `xy` (n, 2), -1 for none. The power at a wave vector is |sum exp(2 pi i k.x)|^2
    over the number of trees: 1 on average for trees anywhere, the number of trees for a perfect lattice. It is
    searched on a grid of wave vectors `step` apart, of lengths `low` to `high` per metre. Peaks stand highest first;
    missing ones are 0.
    """
    half = int(np.ceil(high / step)) + 1
    waves = np.zeros((len(members), PEAKS, 2))
    powers = np.zeros((len(members), PEAKS))
    x_wave = np.empty(2 * half + 1, np.complex128)
    for window in range(len(members)):
        total = np.zeros((half + 2, 2 * half + 1), np.complex128)
        count = 0
        for tree in members[window]:
            if tree < 0:
                continue
            count += 1
            x, y = xy[tree] - centre[window]
            turn = np.exp(2j * np.pi * step * x)
            x_wave[half] = 1
            for column in range(1, half + 1):
                x_wave[half + column] = x_wave[half + column - 1] * turn
                x_wave[half - column] = np.conj(x_wave[half + column])
            turn = np.exp(2j * np.pi * step * y)
            y_wave = np.conj(turn)
            for row in range(half + 2):
                for column in range(2 * half + 1):
                    total[row, column] += x_wave[column] * y_wave
                y_wave *= turn
        if count >= 6:
            power = (total.real.T**2 + total.imag.T**2) / count
            waves[window], powers[window] = highest(power, step, low, high)
    return waves, powers


@compiled
def highest(power: FloatArray, step: float, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """The highest peaks of one window; `power` is over x from -half to half steps and y from -1 to half."""
    half = power.shape[0] // 2
    waves = np.zeros((PEAKS, 2))
    powers = np.zeros(PEAKS)
    for column in range(1, 2 * half):
        for row in range(1, half + 1):
            here = power[column, row]
            along_x, along_y = (column - half) * step, (row - 1) * step
            length = np.hypot(along_x, along_y)
            if length < low or length > high or here <= powers[-1] or (row == 1 and column < half):
                continue
            if here < power[column - 1 : column + 2, row - 1 : row + 2].max():
                continue
            place = PEAKS - 1
            while place > 0 and powers[place - 1] < here:
                powers[place], waves[place] = powers[place - 1], waves[place - 1]
                place -= 1
            powers[place] = here
            waves[place, 0] = along_x + step * summit(power[column - 1, row], here, power[column + 1, row])
            waves[place, 1] = along_y + step * summit(power[column, row - 1], here, power[column, row + 1])
    return waves, powers


@compiled
def summit(before: float, here: float, after: float) -> float:
    """Where the parabola through three neighbouring values has its top, in steps from the middle one."""
    bend = before - 2 * here + after
    return 0.0 if bend >= 0 else min(max((before - after) / (2 * bend), -0.5), 0.5)


@compiled
def grow(
    waves: FloatArray, powers: FloatArray, near: IntArray, free: BoolArray, begin: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """The waves (m, 2) of one block of free windows (m,) and their power (m,), 0 where it does not reach.

    `waves` and `powers` are as from `window_peaks`, `near` (m, k) the windows around each; `begin` is a window and one
    of its peaks. From that one outward, the clearest first: each window takes of its own waves the one most like what
    its neighbours took, if there is one.
    """
    wave, power = np.zeros((len(free), 2)), np.zeros(len(free))
    seed, peak = begin
    waiting = [(-powers[seed, peak], seed, waves[seed, peak, 0], waves[seed, peak, 1])]
    while len(waiting) > 0:
        negative, here, here_x, here_y = heapq.heappop(waiting)
        if power[here] > 0:
            continue
        wave[here, 0], wave[here, 1], power[here] = here_x, here_y, -negative
        for other in near[here]:
            if not free[other] or power[other] > 0:
                continue
            x = y = 0.0
            count = 0
            for beside in near[other]:
                if power[beside] > 0:
                    x, y, count = x + wave[beside, 0], y + wave[beside, 1], count + 1
            x, y = (x / count, y / count) if count > 0 else (here_x, here_y)
            best = best_x = best_y = 0.0
            best_power = 0.0
            for k in range(PEAKS):
                if powers[other, k] < CHANCE:
                    break
                own_x, own_y = waves[other, k, 0], waves[other, k, 1]
                if own_x * x + own_y * y < 0:
                    own_x, own_y = -own_x, -own_y
                unlike = np.hypot(own_x - x, own_y - y) / np.hypot(x, y)
                worth = powers[other, k] * (1 - unlike / SAME)
                if worth > best:
                    best, best_x, best_y, best_power = worth, own_x, own_y, powers[other, k]
            if best > 0:
                heapq.heappush(waiting, (-best_power, other, best_x, best_y))
    return wave, power


@compiled
def add_comb(
    window: IntArray, along: FloatArray, weight: FloatArray, frequencies: FloatArray, total: FloatArray
) -> None:
    """How well steps along rows fit a comb: add cos(2 pi f a) to `total` (windows, frequencies), over pairs of trees.

    `window`, `along` (metres) and `weight` are of the pairs (p,); `frequencies` per metre, evenly spaced.
    """
    for pair in range(len(window)):
        turn = np.exp(2j * np.pi * (frequencies[1] - frequencies[0]) * along[pair])
        wave = weight[pair] * np.exp(2j * np.pi * frequencies[0] * along[pair])
        for k in range(len(frequencies)):
            total[window[pair], k] += wave.real
            wave *= turn
