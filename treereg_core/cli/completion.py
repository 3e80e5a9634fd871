"""What a shell offers when a word is completed with the tabulator."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import typer

from treereg_core.errors import TreeregError
from treereg_core.expression import parse
from treereg_core.judge import Judge
from treereg_core.method import CoarseAligner, FeatureFilter, Method, RowDetector
from treereg_core.options import defaults
from treereg_core.plan import IDENTITY, aligner_named
from treereg_core.recipe import Recipe
from treereg_core.registry import STAGES, installed
from treereg_core.settings import describe
from treereg_core.simulate import FAMILIES
from treereg_core.simulate.families import GROUPS


def beginning(words: Iterable[str], incomplete: str) -> list[str]:
    """Those of the words that begin so."""
    return [word for word in words if word.startswith(incomplete)]


def one_of(*words: str) -> Callable[[str], list[str]]:
    """A completion among a few words."""

    def complete(incomplete: str) -> list[str]:
        return beginning(words, incomplete)

    return complete


def joined(incomplete: str, kinds: tuple[type, ...]) -> list[str]:
    """An expression with its last name completed; each method once."""
    before, plus, _ = incomplete.rpartition("+")
    used = before.split("+")
    return beginning((f"{before}{plus}{name}" for name in installed().names(*kinds) if name not in used), incomplete)


def expressions(incomplete: str) -> list[str]:
    """Method expressions."""
    return joined(incomplete, (*STAGES, Recipe))


def row_expressions(incomplete: str) -> list[str]:
    """Expressions that find rows."""
    return joined(incomplete, (FeatureFilter, RowDetector))


def starts(incomplete: str) -> list[str]:
    """Coarse aligners and the identity; where none fits, a shell offers files."""
    return beginning([*installed().names(CoarseAligner), IDENTITY], incomplete)


def names(incomplete: str) -> list[str]:
    """Everything that is installed, and the judge."""
    return beginning([*(entry.name for entry in installed().entries), "judge"], incomplete)


def targets(incomplete: str) -> list[str]:
    """What can be checked: any method or recipe, and expressions."""
    return joined(incomplete, (Method, Recipe))


def families(incomplete: str) -> list[str]:
    """Families of simulated surveys."""
    return beginning(FAMILIES, incomplete)


def families_and_groups(incomplete: str) -> list[str]:
    """Families of simulated surveys, and their groups."""
    return beginning([*GROUPS, *FAMILIES], incomplete)


def settings(context: typer.Context, incomplete: str) -> list[str]:
    """`STAGE.PARAMETER=` of the stages that the command line names so far, or of its defaults."""
    methods = context.params.get("method") or defaults().get(str(context.info_name), defaults()["method"])
    begins = context.params.get("start") or defaults()["start"]
    stages: dict[str, type] = {}
    for method in [methods] if isinstance(methods, str) else methods:
        stages |= {stage.name: stage for stage in stages_of(method)}
    for start in [begins] if isinstance(begins, str) else begins:
        stages |= {stage.name: stage for stage in aligners_of(start)}
    stages["judge"] = Judge
    return beginning((f"{name}.{field}=" for name, kind in stages.items() for field in describe(kind)), incomplete)


def stages_of(method: str) -> tuple[type[Method], ...]:
    """The stages of an expression; none of one that is not right."""
    try:
        return parse(method, installed()).stages
    except TreeregError:
        return ()


def aligners_of(start: str) -> tuple[type[Method], ...]:
    """The coarse aligner of this name, where there is one."""
    try:
        aligner = aligner_named(start, installed())
    except TreeregError:
        return ()
    return (aligner,) if aligner else ()
