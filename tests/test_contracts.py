"""Every law of the contract, on every installed method, on whole expressions, and on an outsider's plugin."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.outside.installed import entry_points
from treereg_core.cli.check import targets
from treereg_core.errors import UsageError
from treereg_core.method import Method
from treereg_core.recipe import Recipe
from treereg_core.registry import Registry, installed, load
from treereg_core.rows import NearestRows
from treereg_core.testing import Law, laws_for

EXPRESSIONS = (
    "confidence+icp",
    "bn_landmarks+icp",
    "aco",
    "confidence+aco",
    "aco+icp",
    "aco+bn_rows",
    "aco+bn_rows+icp",
    "straight_rows",
    "straight_rows+icp",
    "large_crowns+straight_rows+mutual",
)
"""The contract's own examples and some of the outsider's; those of plugins that are still to come are left out."""


def registry() -> Registry:
    with tempfile.TemporaryDirectory() as folder:
        outside = load(entry_points(Path(folder)))
    return Registry((*installed().entries, *outside.entries))


REGISTRY = registry()


def subjects() -> Iterator[tuple[str, Method]]:
    """Everything that has to keep the laws, by name."""
    for entry in REGISTRY.entries:
        if not entry.problem:
            yield from targets(entry.name, REGISTRY)
    for expression in EXPRESSIONS:
        try:
            yield from targets(expression, REGISTRY)
        except UsageError:
            continue
    yield "nearest_rows", NearestRows()


SUBJECTS = dict(subjects())


@pytest.mark.parametrize(
    ("law", "method"),
    [
        pytest.param(law, method, id=f"{law.__name__}[{name}]")
        for name, method in SUBJECTS.items()
        for law in laws_for(method)
    ],
)
def test_law(law: Law, method: Method) -> None:
    law(method)


def test_nothing_was_left_out() -> None:
    assert not [entry.problem for entry in REGISTRY.entries if entry.problem]
    assert SUBJECTS.keys() >= {entry.name for entry in REGISTRY.entries}
    assert SUBJECTS.keys() >= {"icp", "confidence", "coarse", "confidence+icp", "mutual", "straight_rows", "outside"}


def test_an_outsiders_plugin_is_listed_like_any_other() -> None:
    found = {entry.name: entry for entry in REGISTRY.entries if entry.distribution == "treereg-outside"}
    assert {entry.name: entry.role for entry in found.values()} == {
        "large_crowns": "feature filter",
        "mutual": "point matcher",
        "outside": "recipe",
        "straight_rows": "row detector",
    }
    assert {entry.version for entry in found.values()} == {"0.3.0"}
    assert isinstance(found["outside"].offer, Recipe)
