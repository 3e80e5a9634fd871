"""The guide for strangers says what the code says: the files of its plugin, the hooks, the roles and the laws."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from treereg_core import hookspecs
from treereg_core.evaluator import Evaluator
from treereg_core.learning import Learner
from treereg_core.method import CoarseAligner, FeatureFilter, PointMatcher, RowDetector, RowMatcher
from treereg_core.registry import OFFERS
from treereg_core.testing import Law, laws

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
OUTSIDE = ROOT / "tests" / "outside"
FILES = [path.relative_to(OUTSIDE).as_posix() for path in OUTSIDE.rglob("*") if path.suffix in {".py", ".toml"}]
ROLES = (FeatureFilter, CoarseAligner, RowDetector, RowMatcher, PointMatcher, Evaluator, Learner)
GROUPS = {
    "Settings, of every method": laws.SETTINGS,
    "Conduct, of every method": laws.CONDUCT,
    "Invariance, of every method but evaluators": laws.INVARIANCE,
    "Feature filters": laws.FILTER,
    "Coarse aligners": laws.ALIGNER,
    "Row detectors": laws.DETECTOR,
    "Row matchers": laws.ROW_MATCHER,
    "Point matchers": laws.MATCHER,
    "Point matchers with the judge, and whole expressions": laws.WHOLE,
    "Evaluators": laws.EVALUATOR,
    "Learners": laws.LEARNER,
}
"""The tables of laws, by their titles."""


@pytest.mark.parametrize("name", [name for name in FILES if name != "installed.py"])
def test_the_guide_shows_the_plugin_that_is_tested(name: str) -> None:
    shown = re.search(rf"`{re.escape(name)}`[^\n]*:\n\n```\w+\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)
    assert shown, f"docs/plugins.md does not show {name}"
    assert shown[1] == (OUTSIDE / name).read_text(encoding="utf-8")


def test_the_first_file_of_the_guide_is_the_one_that_stands_alone() -> None:
    first = re.search(r"^```python\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)
    assert first
    assert first[1] == (OUTSIDE / "treereg_outside" / "crowns.py").read_text(encoding="utf-8")


def test_the_guide_lists_the_hooks() -> None:
    specified = [name for name in vars(hookspecs) if name.startswith("treereg_")]
    assert sorted(specified) == sorted(OFFERS)
    rows = [
        f"| `{name}() -> {returned(getattr(hookspecs, name))}` | {first_line(getattr(hookspecs, name))} |"
        for name in specified
    ]
    assert "\n".join(rows) in GUIDE


def test_the_guide_lists_the_roles_with_their_verbs() -> None:
    assert "\n".join(role_row(role) for role in ROLES) in GUIDE


@pytest.mark.parametrize("title", GROUPS)
def test_the_guide_lists_every_law(title: str) -> None:
    assert law_table(title, GROUPS[title]) in GUIDE


def test_no_law_is_in_no_table() -> None:
    listed = {law for group in GROUPS.values() for law in group}
    assert listed == {law for role in laws.BY_ROLE.values() for law in role} | set(laws.PIPELINE)


def law_table(title: str, group: Iterable[Law]) -> str:
    """A group of laws as the guide has it: each in words, and the first line of what it says of itself."""
    rows = [f"| {law.__name__.replace('_', ' ')} | {first_line(law)} |" for law in group]
    return "\n".join([f"### {title}", "", "| law | what it demands |", "|---|---|", *rows])


def role_row(role: type) -> str:
    """A role as the guide has it: its class, its verb with what it takes and gives, and what it is."""
    (verb,) = sorted(vars(role)["__abstractmethods__"])
    signature = inspect.signature(getattr(role, verb))
    taken = ", ".join(f"{p.name}: {p.annotation}" for p in list(signature.parameters.values())[1:])
    return f"| `{role.__name__}` | `{verb}({taken}) -> {signature.return_annotation}` | {first_line(role)} |"


def returned(function: object) -> str:
    """What a function gives, as its annotation says it."""
    return str(inspect.signature(function).return_annotation)  # type: ignore[arg-type]


def first_line(documented: object) -> str:
    """The first line of a docstring, fit for a table."""
    return (inspect.getdoc(documented) or "").partition("\n")[0].replace("|", "\\|")
