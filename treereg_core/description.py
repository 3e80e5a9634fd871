"""Description: what the filters of a run know of every tree at the judged placement, for people to see."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from treereg_core.errors import NoRegistration, in_words
from treereg_core.features import FeatureSet, frozen_array
from treereg_core.method import Context, Described, FeatureFilter, Method, RowDetector
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.transform import FloatArray

NAME = r"[a-z][a-z0-9_]{0,49}"
# A survey's own: what a filter says must not stand in its place.
TAKEN = {field.name for field in fields(FeatureSet)}


def describe(stages: Sequence[Method], pair: Pair, context: Context, clock: Clock) -> tuple[Described, tuple[str, ...]]:
    """What the filters among these stages know of all trees, and a sentence for each that failed.

    `pair` holds all usable trees at the judged placement, and the rows that led to it. Where two filters use one name
    the later one counts.
    """
    filters = [stage for stage in stages if isinstance(stage, FeatureFilter)]
    first = next((stage for stage in stages if isinstance(stage, FeatureFilter | RowDetector)), None)
    if isinstance(first, FeatureFilter):
        # Trees that were filtered out before rows were detected stand in none, which says nothing on them.
        pair = replace(pair, rows=None)
    reference, source, warnings = dict[str, FloatArray](), dict[str, FloatArray](), list[str]()
    for stage in filters:
        try:
            with clock(stage.name):
                known = checked(stage.describe(pair, context), pair)
        except NoRegistration:
            continue
        except Exception as error:  # a plugin's fault must not cost the registration
            warnings.append(f"{stage.name} could not describe the trees ({in_words(error)}); its figures are left out.")
            continue
        reference |= known[0]
        source |= known[1]
    return (reference, source), tuple(warnings)


def checked(described: Described, pair: Pair) -> Described:
    """What a filter said of the trees of a pair, as read-only arrays.

    Raises `ValueError` or `TypeError` for a name that cannot be a property's, or for anything but one finite number for
    each tree.
    """
    reference, source = described
    return _checked(reference, len(pair.reference)), _checked(source, len(pair.source))


def _checked(named: Mapping[str, FloatArray], count: int) -> dict[str, FloatArray]:
    arrays = {}
    for name, values in named.items():
        if not re.fullmatch(NAME, name) or name in TAKEN:
            raise ValueError(f"{name!r:.60} cannot be the name of what is known of trees")
        array = frozen_array(values)
        if array.shape != (count,):
            raise ValueError(f"{name} has shape {array.shape}, but there are {count} trees")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} holds a number that is not finite")
        arrays[name] = array
    return arrays
