"""Settings from `--set` and TOML, and the sentences about wrong ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.core.methods import Columns, Nearest
from treereg_core.errors import InputError, UsageError
from treereg_core.settings import (
    check_used,
    describe,
    merge,
    parse_assignments,
    parse_value,
    range_in_words,
    read_config,
    record,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5", 1.5),
        ("3", 3),
        ("true", True),
        ("[1, 2]", [1, 2]),
        ('"quoted"', "quoted"),
        ("plain words", "plain words"),
        ("", ""),
        ("1\nother = 2", "1\nother = 2"),
    ],
)
def test_values_are_toml_or_text(text: str, value: object) -> None:
    assert parse_value(text) == value


def test_assignments() -> None:
    assert parse_assignments(["a.x=1", "a.y=b=c", "b.z=.5"]) == {"a": {"x": 1, "y": "b=c"}, "b": {"z": ".5"}}


@pytest.mark.parametrize("text", ["a=1", "a.x", ".x=1", "a.=1", "=", ""])
def test_a_malformed_assignment_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"write STAGE\.PARAMETER=VALUE"):
        parse_assignments([text])


def test_later_layers_go_before_earlier_ones() -> None:
    assert merge({"a": {"x": 1, "y": 1}}, {"a": {"x": 2}, "b": {}}) == {"a": {"x": 2, "y": 1}, "b": {}}


def test_an_unused_stage_is_refused_with_the_nearest() -> None:
    check_used({"nearest": {"reach": 1}}, ["nearest"])
    with pytest.raises(UsageError, match=r"neerest\.reach: the stage 'neerest' is not used.*did you mean 'nearest'"):
        check_used({"neerest": {"reach": 1}}, ["nearest", "judge"])
    with pytest.raises(UsageError, match="there are: nearest, judge"):
        check_used({"zzz": {}}, ["nearest", "judge"])


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"reach": -1}, "nearest.reach is -1, but must be above 0, at most 50 m"),
        ({"reach": "far"}, "nearest.reach is 'far': input should be a valid number"),
        ({"reach": float("nan")}, "nearest.reach is nan; give a finite number"),
        ({"reech": 1}, "there is no setting nearest.reech; did you mean 'reach'?"),
    ],
)
def test_a_wrong_value_gets_one_sentence_with_the_range(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError) as raised:
        record(Nearest, values, lambda field: f"nearest.{field}")
    assert str(raised.value).startswith(sentence)
    assert "\n" not in str(raised.value)


def test_text_becomes_the_number_it_shows() -> None:
    assert record(Nearest, {"reach": ".5"}, str).reach == 0.5


def test_a_description_has_default_unit_range_and_words() -> None:
    field = describe(Columns)["width"]
    assert (field["default"], field["unit"], field["description"]) == (5.0, "m", "row spacing")
    assert range_in_words(field) == "above 0 m"


def test_a_config_file(tmp_path: Path) -> None:
    path = tmp_path / "treereg.toml"
    path.write_text('method = "nearest"\nseed = 3\n[nearest]\nreach = 2.0\n')
    assert read_config(path) == ({"method": "nearest", "seed": 3}, {"nearest": {"reach": 2.0}})


@pytest.mark.parametrize(
    "content",
    [b"method = ", b"\xff\xfe", b"a = " + b"[" * 5000, b"a = " + b"9" * 5000, b"a = [{b = 0x" + b"f" * 5000 + b"}]"],
)
def test_a_config_file_that_is_not_toml(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.toml: not TOML"):
        read_config(path)
    with pytest.raises(InputError, match=r"absent\.toml: No such file"):
        read_config(tmp_path / "absent.toml")


def test_a_file_that_begins_with_a_mark_of_its_byte_order(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_bytes(b"\xef\xbb\xbfseed = 1")
    assert read_config(tmp_path / "run.toml") == ({"seed": 1}, {})
