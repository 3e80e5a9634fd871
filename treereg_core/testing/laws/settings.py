"""Laws on what a method says of itself: its settings and its docstring."""

from __future__ import annotations

import inspect
import pickle
import re
from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError

from treereg_core.method import Method
from treereg_core.settings import describe
from treereg_core.testing.law import law, require

BOUNDS = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum", "enum", "const")


@law
def settings_are_described(method: Method) -> None:
    """Every setting has a default, a description and, where it is a number, a range."""
    for name, setting in describe(type(method)).items():
        require(not type(method).model_fields[name].is_required(), f"{name} has no default")
        require(setting.get("description"), f"{name} has no description")
        kinds = set(str(setting.get("type", "")).split(" or "))
        if kinds & {"number", "integer"}:
            require(setting.keys() & set(BOUNDS), f"{name} is a number without a range")


@law
def settings_survive_json(method: Method) -> None:
    """What is written as JSON and read again is the same method, for every setting that can be had."""
    for variant in variants(method):
        again = type(method).model_validate_json(variant.model_dump_json())
        require(again == variant, f"{variant!r} became {again!r}")


@law
def an_unknown_setting_is_refused(method: Method) -> None:
    """A misspelt setting is an error, never ignored."""
    name = "no_such_setting"
    try:
        type(method)(**{name: 1})
    except ValidationError:
        return
    require(False, f"{name} was taken without a word")


@law
def settings_are_frozen(method: Method) -> None:
    """A method is a value: its settings cannot be changed."""
    for name in type(method).model_fields:
        try:
            setattr(method, name, getattr(method, name))
        except (ValidationError, AttributeError):
            continue
        require(False, f"{name} could be set")


@law
def it_pickles(method: Method) -> None:
    """A method can be sent to another process."""
    for variant in variants(method):
        again = pickle.loads(pickle.dumps(variant))
        require(type(again) is type(variant) and again == variant, f"{variant!r} became {again!r}")


@law
def the_docstring_names_its_source(method: Method) -> None:
    """The first line says what the method is; a DOI, or a section or figure of the proposal, says where it is from."""
    text = inspect.cleandoc(type(method).__dict__.get("__doc__") or "")
    require(text, "it has no docstring of its own")
    require(
        re.search(r"doi:10\.\d{4,}/\S+|\b(section|figure|chapter)\s+\d", text),
        "it names neither a DOI (doi:10...) nor a section or figure",
    )


@law
def models_are_named(method: Method) -> None:
    """A method says which transforms it can work with: one at least."""
    require(len(method.models) > 0, "it can work with no model")


def variants(method: Method) -> Iterator[Method]:
    """The method as it is, and with each setting at other values that it takes."""
    yield method
    for name, setting in describe(type(method)).items():
        for value in other_values(setting):
            try:
                yield type(method)(**{name: value})
            except ValidationError:
                continue


def other_values(setting: dict[str, Any]) -> list[Any]:
    """Values that a described setting may take: its bounds, what lies just inside, and every choice."""
    kinds = set(str(setting.get("type", "")).split(" or "))
    values: list[Any] = list(setting.get("enum", ()))
    if "boolean" in kinds:
        values += [True, False]
    if "null" in kinds:
        values.append(None)
    if kinds & {"number", "integer"}:
        low = [setting[key] for key in ("minimum", "exclusiveMinimum") if key in setting]
        high = [setting[key] for key in ("maximum", "exclusiveMaximum") if key in setting]
        values += [*low, *high]
        if low and high:
            values.append(low[0] + (high[0] - low[0]) // 3 if "integer" in kinds else low[0] + (high[0] - low[0]) / 3)
        elif low or high:
            values += [(low or high)[0] + step for step in (1, -1)]
    return values
