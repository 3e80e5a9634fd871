"""Settings from people: `--set STAGE.PARAMETER=VALUE`, `--config FILE.toml`, and the records made from them."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from treereg_core.errors import InputError, UsageError

Settings = Mapping[str, Mapping[str, object]]
"""Values by stage and parameter."""

OUT_OF_RANGE = {"greater_than", "greater_than_equal", "less_than", "less_than_equal", "literal_error", "enum"}
"""What pydantic calls a value of the right type outside its range."""

Record = TypeVar("Record", bound=BaseModel)


def parse_assignments(texts: Iterable[str]) -> dict[str, dict[str, object]]:
    """Read `STAGE.PARAMETER=VALUE` texts; a value is read as TOML where it is TOML, else as it stands."""
    settings: dict[str, dict[str, object]] = {}
    for text in texts:
        target, equals, value = text.partition("=")
        stage, dot, parameter = target.partition(".")
        if not (equals and dot and stage and parameter):
            raise UsageError(f"--set {text!r}: write STAGE.PARAMETER=VALUE, as in stage.setting=1.5")
        settings.setdefault(stage.strip(), {})[parameter.strip()] = parse_value(value.strip())
    return settings


def parse_value(text: str) -> object:
    """A TOML value, or the text itself where it is none."""
    try:
        parsed = _toml(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if parsed.keys() == {"value"} else text


def read_config(path: Path) -> tuple[dict[str, object], dict[str, dict[str, object]]]:
    """A configuration file: long options at the top, and a table for each stage. `InputError` when it is not TOML."""
    try:
        content = _toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give --config a TOML file") from None
    except (ValueError, RecursionError) as error:
        quotes = ", a path with backslashes goes in 'single quotes'" if b"\\" in path.read_bytes() else ""
        raise InputError(f"{path}: not TOML ({error}); mend the file{quotes}") from None
    options = {key: value for key, value in content.items() if not isinstance(value, dict)}
    return options, {key: value for key, value in content.items() if isinstance(value, dict)}


def _toml(text: str) -> dict[str, Any]:
    """What the text says. `ValueError` where it is not TOML, whose whole numbers have 64 bits; Python's have any."""
    content = tomllib.loads(text)
    _check_whole_numbers(content)
    return content


def _check_whole_numbers(value: object) -> None:
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            _check_whole_numbers(part)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number of more than 64 bits")


def merge(*layers: Settings) -> dict[str, dict[str, object]]:
    """Settings of several sources in one; a later layer goes before an earlier one."""
    merged: dict[str, dict[str, object]] = {}
    for layer in layers:
        for stage, values in layer.items():
            merged.setdefault(stage, {}).update(values)
    return merged


def check_used(settings: Settings, stages: Iterable[str]) -> None:
    """Refuse settings for a stage that takes no part in the run."""
    used = list(dict.fromkeys(stages))
    for stage, values in settings.items():
        if stage not in used:
            parameter = next(iter(values), "...")
            raise UsageError(f"{stage}.{parameter}: the stage {stage!r} is not used here{suggestion(stage, used)}")


def suggestion(wrong: str, right: Iterable[str]) -> str:
    """How a sentence on a wrong name ends: with the nearest right one, or with all of them."""
    names = list(right)
    near = difflib.get_close_matches(wrong, names, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; there are: {', '.join(names) or 'none'}"


def record(kind: type[Record], values: Mapping[str, object], called: Callable[[str], str]) -> Record:
    """The record of this kind with these values; `called` gives the name of a field as the user knows it.

    `UsageError`, in one sentence with the allowed range, for the first value that does not fit.
    """
    for name, value in values.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise UsageError(f"{called(name)} is {value}; give a finite number")
        if isinstance(value, bool) and "boolean" not in describe(kind).get(name, {}).get("type", "boolean"):
            raise UsageError(f"{called(name)} is {str(value).lower()}, where no true or false is wanted")
    try:
        return kind(**values)
    except ValidationError as error:
        raise UsageError(sentence(kind, error, called)) from None


def sentence(kind: type[BaseModel], error: ValidationError, called: Callable[[str], str]) -> str:
    """The first complaint of a validation error, for a person."""
    first = error.errors(include_url=False)[0]
    name = str(first["loc"][0]) if first["loc"] else ""
    if first["type"] == "extra_forbidden":
        return f"there is no setting {called(name)}" + suggestion(name, kind.model_fields)
    message = first["msg"].removeprefix("Value error, ")
    if not name:
        return message
    allowed = range_in_words(describe(kind)[name])
    value = f"{called(name)} is {first['input']!r:.80}"
    if allowed and first["type"] in OUT_OF_RANGE:
        return f"{value}, but must be {allowed}"
    return f"{value}: {message[:1].lower()}{message[1:]}" + (f" ({allowed})" if allowed else "")


def describe(kind: type[BaseModel]) -> dict[str, dict[str, Any]]:
    """The settings of a record: by name its default, description, unit, type and bounds, in JSON Schema's words."""
    schema = kind.model_json_schema()
    return {name: flat(field, schema.get("$defs", {})) for name, field in schema.get("properties", {}).items()}


def flat(field: Mapping[str, Any], definitions: Mapping[str, Any]) -> dict[str, Any]:
    """One field with the bounds of its alternatives and of what it refers to brought up to it."""
    merged = {key: value for key, value in field.items() if key not in ("anyOf", "allOf", "$ref", "title")}
    inner = [*field.get("anyOf", ()), *field.get("allOf", ())]
    if "$ref" in field:
        inner.append(definitions[field["$ref"].rsplit("/", 1)[1]])
    kinds = [merged["type"]] if "type" in merged else []
    for part in inner:
        below = flat(part, definitions)
        kinds += [below.pop("type")] if "type" in below else []
        merged = {**below, **merged}
    return {**merged, "type": " or ".join(dict.fromkeys(kinds))} if kinds else merged


def range_in_words(field: Mapping[str, Any]) -> str:
    """The allowed values of a described setting, such as `above 0, at most 10 m`; empty without bounds."""
    if "enum" in field:
        return " or ".join(str(value) for value in field["enum"])
    words = {"exclusiveMinimum": "above", "minimum": "at least", "exclusiveMaximum": "below", "maximum": "at most"}
    bounds = ", ".join(f"{word} {field[key]:.10g}" for key, word in words.items() if key in field)
    unit = field.get("unit")
    return f"{bounds} {unit}" if bounds and unit else bounds
