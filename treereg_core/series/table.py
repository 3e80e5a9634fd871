"""The trees of a series as a table: one line for each tree and survey, trees in order, surveys in the order of time."""

from __future__ import annotations

from typing import Any

import numpy as np

from treereg_core.features import FeatureSet
from treereg_core.series.history import State, gathered
from treereg_core.series.registering import Member, Series
from treereg_core.transform import FloatArray


def table(series: Series) -> dict[str, np.ndarray[Any, Any]]:
    """The columns (t x s,) by name, as `trees.parquet` has them.

    Whole numbers that are not known are masked, other numbers NaN. `x` and `y` are full coordinates of the first
    survey's working CRS, metres: where the survey shows the tree, else where the others do on the average.
    """
    history, places, members = series.history, series.places, series.accepted
    trees, surveys = history.detection.shape
    xy = (history.xy + np.asarray(series.frame.origin)).reshape(-1, 2)
    words = np.array([state.word for state in State])

    def each(values: list[FloatArray]) -> FloatArray:
        return gathered(values, history.detection).ravel()

    def known(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.ma.masked_less(values, 0)

    return {
        "tree": np.repeat(np.arange(trees), surveys),
        "survey": np.tile([member.name for member in members], trees),
        "feature": known(
            np.nan_to_num(each([features(m).ids.astype(float) for m in members]), nan=-1).astype(np.int64)
        ),
        "row_index": known(np.repeat(places.row, surveys)),
        "tree_index": known(np.repeat(places.tree, surveys)),
        "state": words[history.state.ravel()],
        "area_m2": np.round(each([area(member) for member in members]), 4),
        "height_m": np.round(each([height(member) for member in members]), 4),
        "confidence": each([features(member).confidence for member in members]),
        "x": np.round(xy[:, 0], 4),
        "y": np.round(xy[:, 1], 4),
        "probability": np.round(np.repeat(history.probability, surveys), 4),
    }


def features(member: Member) -> FeatureSet:
    """The usable trees of a survey that was read."""
    assert member.survey is not None
    return member.survey.features


def area(member: Member) -> FloatArray:
    """Crown areas (n,) in the first survey's measure, square metres."""
    scale = member.transform.scale if member.transform else 1.0
    return features(member).area * scale**2


def height(member: Member) -> FloatArray:
    """Heights (n,), metres; NaN where the survey does not tell them."""
    told = member.survey.heights if member.survey else None
    return np.full(len(features(member)), np.nan) if told is None else told.height
