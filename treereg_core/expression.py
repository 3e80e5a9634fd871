"""Method expressions: `name("+"name)*`, such as `aco+icp`.

In running order: at most one row detector, then at most one row matcher, then any point matchers. Feature filters stand
anywhere before a later detector or matcher. A recipe stands for the expression that it names.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from treereg_core.errors import PluginError, UsageError
from treereg_core.method import FeatureFilter, Method, PointMatcher, RowDetector, RowMatcher
from treereg_core.recipe import Recipe
from treereg_core.registry import STAGES, Registry
from treereg_core.settings import Settings, merge

ORDER = (RowDetector, RowMatcher, PointMatcher)


@dataclass(frozen=True)
class Expression:
    """An expression in its right form: the methods in running order, and the settings that its recipes bring."""

    text: str
    stages: tuple[type[Method], ...]
    settings: Settings


def parse(text: str, registry: Registry) -> Expression:
    """Read an expression. `UsageError` with the nearest right one when it is wrong."""
    stages: list[type[Method]] = []
    settings: dict[str, dict[str, object]] = {}
    for name in text.split("+"):
        try:
            offer = registry.entry(name, (*STAGES, Recipe)).offer
        except UsageError as error:
            raise refusal(text, str(error), registry) from None
        if isinstance(offer, Recipe):
            stages += stages_of(offer, registry)
            settings = merge(settings, offer.settings)
        else:
            stages.append(registry.method(name))
    flaw = flaw_of(stages)
    if flaw:
        raise refusal(text, flaw, registry)
    return Expression(text, tuple(stages), settings)


def stages_of(recipe: Recipe, registry: Registry) -> list[type[Method]]:
    """The methods of a recipe. `UsageError` when one is not installed, `PluginError` when the recipe is wrong."""
    try:
        stages = [registry.method(name) for name in recipe.expression.split("+")]
    except UsageError as error:
        raise UsageError(f"the recipe {recipe.name} stands for {recipe.expression}, but {error}") from None
    unused = recipe.settings.keys() - {stage.name for stage in stages}
    if unused:
        raise PluginError(f"the recipe {recipe.name} has settings for {min(unused)}, which is not one of its methods")
    return stages


def refusal(text: str, flaw: str, registry: Registry) -> UsageError:
    """The error for a wrong expression, with the nearest right one where there is one."""
    near = nearest(text, registry)
    if near:
        flaw = flaw.partition("; did you mean")[0]
    return UsageError(f"method {text!r}: {flaw}" + (f"; the nearest right expression is {near!r}" if near else ""))


def flaw_of(stages: Sequence[type[Method]]) -> str | None:
    """What is wrong with the order of stages, in words; None when it is right."""
    for stage in stages:
        if not issubclass(stage, STAGES):
            hint = "; give it to --start" if stage.role == "coarse aligner" else ""
            return f"{stage.name} is of the role {stage.role}, which has no place in an expression{hint}"
    solid = [stage for stage in stages if not issubclass(stage, FeatureFilter)]
    for kind in (RowDetector, RowMatcher):
        several = [stage.name for stage in solid if issubclass(stage, kind)]
        if len(several) > 1:
            return f"{' and '.join(several)} are both of the role {kind.role}, of which there can be one"
    for before, after in pairwise(solid):
        if rank(before) > rank(after):
            return f"{after.name} ({after.role}) must stand before {before.name} ({before.role})"
    if not any(issubclass(stage, (RowDetector, PointMatcher)) for stage in solid):
        return "it needs a row detector or a point matcher"
    if issubclass(solid[0], RowMatcher):
        return f"{solid[0].name} needs a row detector before it"
    if issubclass(stages[-1], FeatureFilter):
        return f"nothing after {stages[-1].name} would see what it selects"
    return None


def rank(stage: type[Method]) -> int:
    """The place of a role in the running order; filters have none of their own and come first."""
    return next((place for place, kind in enumerate(ORDER, 1) if issubclass(stage, kind)), 0)


def nearest(text: str, registry: Registry) -> str | None:
    """The right expression nearest to a wrong one; None when there is nothing to go by."""
    names = registry.names(*STAGES)
    recipes = registry.names(Recipe)
    whole = difflib.get_close_matches(text.lower(), recipes, n=1, cutoff=0.75)
    if whole and whole[0] != text:
        return whole[0]
    guesses = [difflib.get_close_matches(part.strip().lower(), names, n=1) for part in text.split("+")]
    stages = sorted((registry.method(guess[0]) for guess in guesses if guess), key=rank)
    kept = [s for i, s in enumerate(stages) if rank(s) not in (1, 2) or rank(s) not in map(rank, stages[:i])]
    if kept and not any(issubclass(stage, (RowDetector, PointMatcher)) for stage in kept):
        needed = RowDetector if issubclass(kept[-1], RowMatcher) else PointMatcher
        kept += [registry.method(name) for name in registry.names(needed)[:1]]
        kept.sort(key=rank)
    if kept and issubclass(next((s for s in kept if rank(s)), kept[0]), RowMatcher):
        kept = sorted(kept + [registry.method(name) for name in registry.names(RowDetector)[:1]], key=rank)
    return None if not kept or flaw_of(kept) else "+".join(stage.name for stage in kept)
