"""The grammar of expressions, and what is said of wrong ones."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.core.methods import BOTH, REGISTRY
from treereg_core.errors import PluginError, TreeregError, UsageError
from treereg_core.expression import flaw_of, parse
from treereg_core.registry import Entry, Registry


@pytest.mark.parametrize(
    "text",
    [
        "nearest",
        "sure+nearest",
        "columns",
        "sure+columns",
        "columns+nearest",
        "columns+same_rows",
        "columns+same_rows+nearest",
        "columns+same_rows+sure+nearest",
        "sure+columns+big+same_rows+sure+nearest",
        "nearest+nearest",
        "nearest+sure+nearest",
    ],
)
def test_right_expressions(text: str) -> None:
    assert "+".join(stage.name for stage in parse(text, REGISTRY).stages) == text


def test_a_recipe_is_expanded_with_its_settings() -> None:
    expression = parse("both+nearest", REGISTRY)
    assert [stage.name for stage in expression.stages] == ["sure", "columns", "nearest", "nearest"]
    assert expression.settings == {"sure": {"least": 0.2}}
    assert expression.text == "both+nearest"


@pytest.mark.parametrize(
    ("text", "complaint", "right"),
    [
        ("neerest", "there is no method 'neerest'", "nearest"),
        ("Nearest", "there is no method 'Nearest'", "nearest"),
        ("sure + nearest", "there is no method 'sure '", "sure+nearest"),
        ("colums+neares", "there is no method 'colums'", "columns+nearest"),
        ("nearest+", "there is no method ''", "nearest"),
        ("nearest,sure", "there is no method 'nearest,sure'", "nearest"),
        ("boht", "there is no method 'boht'", "both"),
        ("sure", "it needs a row detector or a point matcher", "sure+nearest"),
        ("same_rows", "it needs a row detector or a point matcher", "columns+same_rows"),
        ("same_rows+nearest", "same_rows needs a row detector before it", "columns+same_rows+nearest"),
        ("same_rows+columns", "columns (row detector) must stand before same_rows (row matcher)", "columns+same_rows"),
        ("nearest+columns", "columns (row detector) must stand before nearest (point matcher)", "columns+nearest"),
        ("columns+lines", "columns and lines are both of the role row detector", "columns"),
        ("nearest+sure", "nothing after sure would see what it selects", "sure+nearest"),
        ("middle+nearest", "give it to --start", "nearest"),
        ("lost+nearest", "ImportError: gone", None),
    ],
)
def test_wrong_expressions_get_the_nearest_right_one(text: str, complaint: str, right: str | None) -> None:
    with pytest.raises(TreeregError) as raised:
        parse(text, REGISTRY)
    message = str(raised.value)
    assert complaint in message
    if right:
        assert f"nearest right expression is {right!r}" in message
        assert flaw_of(parse(right, REGISTRY).stages) is None


def test_the_empty_expression_is_refused() -> None:
    with pytest.raises(TreeregError, match="no method ''"):
        parse("", REGISTRY)


def with_recipe(**changes: object) -> Registry:
    recipe = replace(BOTH, name="mine", **changes)  # type: ignore[arg-type]
    return Registry((*REGISTRY.entries, Entry("mine", "recipe", "test", "1", recipe)))


def test_a_recipe_of_a_method_that_is_not_there_says_so() -> None:
    with pytest.raises(UsageError, match=r"recipe mine stands for columns\+far, but there is no method 'far'"):
        parse("mine", with_recipe(expression="columns+far", settings={}))


def test_a_recipe_with_settings_for_a_stranger_is_broken() -> None:
    with pytest.raises(PluginError, match="settings for big, which is not one of its methods"):
        parse("mine", with_recipe(settings={"big": {"least": 1}}))
