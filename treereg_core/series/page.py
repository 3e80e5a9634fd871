"""The page of a series: its surveys and probable trees as plain values, and as one file to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from treereg_core.report.page import SHARED, page
from treereg_core.series.history import State, gathered
from treereg_core.series.registering import Series
from treereg_core.series.table import area, features, height
from treereg_core.transform import FloatArray

PAGE = "series.html"
TEMPLATE = "series.html"
SCRIPTS = (*SHARED, *(f"series/{name}" for name in ("decode", "colour", "scene", "panels", "chart", "main")))
NOT_YET = len(State)
"""In place of `missing`, before the tree is `new`: it was not there yet, or was missed."""


def series_page(series: Series, document: Mapping[str, Any]) -> str:
    """The page that shows a series; `document` is the content of series.json."""
    return page(page_data(series, document), TEMPLATE, SCRIPTS)


def page_data(series: Series, document: Mapping[str, Any]) -> dict[str, Any]:
    """What the page is drawn from.

    `trees` are the probable ones: the `number` that each has in the table, `x` and `y`, where the surveys show it on
    average, centimetres in the first survey's working frame, `row` and `place` in it from 0, -1 for none. `states` are
    the words for the numbers in `history`, which has for each accepted survey the `state`, `area_m2`, `height_m` and
    `confidence` of every tree; null where it is not known.
    """
    history, places = series.history, series.places
    kept = history.probable
    detection, seen = history.detection[kept], history.seen[kept]
    centre = np.mean(history.xy[kept], axis=1, where=seen[..., None])
    x, y = np.round(100 * centre).astype(np.int64).T
    not_yet = (history.state[kept] == State.MISSING) & (np.cumsum(seen, axis=1) == 0)
    state = np.where(not_yet, NOT_YET, history.state[kept])
    told = {
        "area_m2": [area(member) for member in series.accepted],
        "height_m": [height(member) for member in series.accepted],
        "confidence": [features(member).confidence for member in series.accepted],
    }
    columns = {name: gathered(values, detection) for name, values in told.items()}
    return {
        "series": dict(document),
        "states": [*(state.word for state in State), "not seen yet"],
        "trees": {
            "number": np.flatnonzero(kept).tolist(),
            "x": x.tolist(),
            "y": y.tolist(),
            "row": places.row[kept].tolist(),
            "place": places.tree[kept].tolist(),
        },
        "history": [
            {"state": state[:, s].tolist(), **{name: _plain(values[:, s]) for name, values in columns.items()}}
            for s in range(state.shape[1])
        ],
    }


def _plain(values: FloatArray) -> list[float | None]:
    return [None if value != value else value for value in np.round(values, 2).tolist()]
