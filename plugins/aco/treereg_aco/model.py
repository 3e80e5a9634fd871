"""What the trees of a row look like, learned from the survey itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logit

from treereg_aco.frames import Frames, steps
from treereg_aco.nearby import nearby
from treereg_core.features import BoolArray, FeatureSet, IntArray
from treereg_core.transform import FloatArray

# Share of a lane within which a tree can still belong to a row.
HALF_LANE = 0.5
# Share of all trees that are taken for strangers before any row is known.
STRANGERS = 0.1
# Bounds of what is learned, so that a few odd trees teach no nonsense.
TAKEN = (0.4, 0.98)
EVIDENCE = (-3.0, 2.0)
FEW = 15
LEAST_SPREAD = 0.05


class RowModel(NamedTuple):
    """How trees of a row scatter, and how others do.

    - `along`, `across`: sd of a tree about its planting position, metres.
    - `taken`: the probability that a planting position shows a tree.
    - `strangers`: detections of no row per square metre.
    - `half_width`: distance from its row beyond which no tree belongs to it, metres.
    """

    along: float
    across: float
    taken: float
    strangers: float
    half_width: float


def first_model(features: FeatureSet, frames: Frames) -> RowModel:
    """From the steps to neighbours: those of about one spacing along a row are a Gaussian among strangers.

    The two are told apart by expectation maximisation (Dempster, Laird & Rubin 1977,
    doi:10.1111/j.2517-6161.1977.tb01600.x).
    """
    lane = frames.lane
    found = []
    for step in steps(features.xy, frames.along, frames.near):
        spacing = frames.spacing[step.i]
        x, y = step.along - spacing, step.across
        box = (np.abs(x) < 0.5 * spacing) & (np.abs(y) < 0.4 * lane)
        found.append((x[box], y[box], spacing[box] * 0.8 * lane))
    x, y, room = (np.concatenate(parts) for parts in zip(*found, strict=True))
    squares_along, squares_across = x**2, y**2
    along, across, share = (0.15 * float(np.median(frames.spacing))) ** 2, (0.1 * lane) ** 2, 0.8
    for _ in range(40):
        near = (
            share
            / (2 * np.pi * np.sqrt(along * across))
            * np.exp(-0.5 * (squares_along / along + squares_across / across))
        )
        member = near / (near + (1 - share) / room)
        total = max(float(member.sum()), 1e-9)
        share = min(max(total / max(len(x), 1), 1e-3), 1 - 1e-3)
        along = max(float((member * squares_along).sum()) / total, (0.01 * frames.lane) ** 2)
        across = max(float((member * squares_across).sum()) / total, (0.01 * frames.lane) ** 2)
    across_sd = float(np.sqrt(across / 2))
    return RowModel(
        along=float(np.sqrt(along / 2)),
        across=across_sd,
        taken=float(np.clip(total / 2 / len(features), *TAKEN)),
        strangers=STRANGERS / float(np.median(frames.spacing * frames.row_spacing)),
        half_width=min(HALF_LANE * lane, 6 * across_sd),
    )


def learned(model: RowModel, frames: Frames, rows: list[IntArray], xy: FloatArray) -> RowModel:
    """The model after a first search that found these rows, as positions of trees."""
    inside = sum(len(row) for row in rows)
    spacing = float(np.median(frames.spacing))
    steps_in_rows = [np.maximum(np.round(np.hypot(*np.diff(xy[row], axis=0).T) / spacing), 1) for row in rows]
    positions = max(len(rows) + sum(float(steps.sum()) for steps in steps_in_rows), 1.0)
    ground = positions * spacing * float(np.median(frames.row_spacing))
    return model._replace(taken=float(np.clip(inside / positions, *TAKEN)), strangers=max(len(xy) - inside, 1) / ground)


def evidence(features: FeatureSet, in_rows: BoolArray) -> FloatArray:
    """How much confidence and crown say for each tree being a tree, (n,), natural log-odds, from those in rows and not.

    Both are taken as Gaussian, confidence in log-odds and crown area as the logarithm over its neighbours' median.
    Few strangers teach little.
    """
    total = np.zeros(len(features))
    strangers = np.count_nonzero(~in_rows)
    if strangers < FEW // 2 or len(features) - strangers < FEW:
        return total
    count = min(24, len(features))
    size = np.log(features.area)
    usual = np.empty(len(size))
    for some, _, near in nearby(features, range(1, count + 1)):
        usual[some] = np.median(size[near], axis=1)
    for values in (logit(np.clip(features.confidence, 1e-3, 1 - 1e-3)), size - usual):
        inside, inside_sd = centre_and_spread(values[in_rows])
        outside, outside_sd = centre_and_spread(values[~in_rows])
        odds = 0.5 * ((values - outside) / outside_sd) ** 2 - 0.5 * ((values - inside) / inside_sd) ** 2
        total += np.clip(odds + np.log(outside_sd / inside_sd), *EVIDENCE) * strangers / (strangers + FEW)
    return total


def centre_and_spread(values: FloatArray) -> tuple[float, float]:
    """Median, and the standard deviation that the median absolute deviation stands for; one that can be divided by."""
    centre = float(np.median(values))
    return centre, max(1.4826 * float(np.median(np.abs(values - centre))), LEAST_SPREAD)
