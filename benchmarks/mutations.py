"""Valid files made wrong: bytes, the values in JSON, the lines and words of text, each by a given source of chance."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random
from typing import Any

Value = Any
STRANGE: tuple[Value, ...] = (
    None,
    True,
    0,
    -1,
    0.5,
    1e308,
    -1e308,
    10**400,
    float("nan"),
    float("inf"),
    "",
    "\ud800",
    "\x00",
    "EPSG:4326",
    "EPSG:999999",
    "+proj=utm +zone=99",
    "a" * 3000,
    [],
    {},
    [[]],
    [[], [[]]],
    {"type": "Point", "coordinates": [0, 0]},
    {"type": "Polygon", "coordinates": [[[0, 0]]]},
    {"type": "MultiPolygon", "coordinates": [[[[0, 0], [0, 0], [0, 0], [0, 0]]]]},
    {"type": "GeometryCollection", "geometries": [None]},
    {"type": "name", "properties": {"name": "EPSG:5041"}},
    {"type": "name", "properties": {"name": "EPSG:4978"}},
    {"type": "name", "properties": {"name": "EPSG:5773"}},
    {"type": "name", "properties": {"name": 7}},
)
"""Values that stand where others were meant."""
FACTORS = (-1, 0, 1e-300, 1e-9, 1 + 1e-12, 2, 1e9, 1e300)
WORDS = ("nan", "inf", "-1", "1e999", "9" * 5000, *"\"'[]=,;\n\x00\u2028é", "..", "")


def mutated_bytes(content: bytes, chance: Random) -> bytes:
    """Some bytes flipped, overwritten, cut out, repeated or put in, a few times."""
    raw = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(raw) + 1)
        end = min(len(raw), at + chance.choice((1, 1, 2, 4, 8, 64, 4096)))
        match chance.randrange(6):
            case 0 if at < len(raw):
                raw[at] ^= 1 << chance.randrange(8)
            case 1:
                raw[at:end] = bytes(chance.choice((0, 255, 127, 128)) for _ in range(end - at))
            case 2:
                del raw[at:end]
            case 3:
                raw[at:at] = raw[at:end]
            case 4:
                del raw[at:]
            case _:
                raw[at:end] = chance.randbytes(end - at)
    return bytes(raw)


def mutated_text(content: bytes, chance: Random) -> bytes:
    """Words put in, lines left out, repeated or exchanged, or bytes changed."""
    if chance.randrange(4) == 0:
        return mutated_bytes(content, chance)
    lines = content.decode(errors="replace").split("\n")
    for _ in range(chance.randint(1, 3)):
        i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
        line = lines[i]
        at = chance.randrange(len(line) + 1)
        match chance.randrange(5):
            case 0:
                lines[i], lines[j] = lines[j], lines[i]
            case 1:
                lines.insert(i, lines[j])
            case 2 if len(lines) > 1:
                del lines[i]
            case 3:
                lines[i] = line[:at] + chance.choice(WORDS) + line[at:]
            case _:
                words = line.split(",")
                words[chance.randrange(len(words))] = chance.choice(WORDS)
                lines[i] = ",".join(words)
    return "\n".join(lines).encode(errors="surrogatepass")


def mutated_json(content: bytes, chance: Random) -> bytes:
    """Values replaced, members removed, renamed or doubled, numbers scaled, deep nesting, or bytes changed."""
    if chance.randrange(8) == 0:
        return mutated_bytes(content, chance)
    document = [json.loads(content)]
    for _ in range(chance.randint(1, 3)):
        _change(*_somewhere(document, chance), chance)
    try:
        return json.dumps(document[0]).encode()
    except RecursionError:
        return b"[" * 100_000


def _somewhere(document: list[Value], chance: Random) -> tuple[Value, Value]:
    """A container in the document and the key of one of its values."""
    holder: Value = document
    key: Value = 0
    while True:
        inner = holder[key]
        if not isinstance(inner, dict | list) or not inner or chance.randrange(5) == 0:
            return holder, key
        holder = inner
        key = chance.choice(list(holder)) if isinstance(holder, dict) else chance.randrange(len(holder))


def _change(holder: Value, key: Value, chance: Random) -> None:
    value = holder[key]
    changes: list[Callable[[], None]] = [lambda: _put(holder, key, _copy(chance.choice(STRANGE)))] * 3
    if isinstance(holder, dict):
        changes += [lambda: holder.pop(key), lambda: _put(holder, chance.choice(("type", "crs", "x", "")), value)]
    elif len(holder) > 1:
        changes += [lambda: holder.pop(key), lambda: holder.insert(key, _copy(value)), lambda: chance.shuffle(holder)]
    if isinstance(value, int | float):
        changes += [lambda: _put(holder, key, _scaled(value, chance.choice(FACTORS)))] * 3
    if isinstance(value, str):
        changes.append(lambda: _put(holder, key, _respelt(value, chance)))
    if isinstance(value, list):
        changes += [value.clear, lambda: _put(holder, key, value[: len(value) // 2])]
    if chance.randrange(20) == 0:
        changes = [lambda: _put(holder, key, _nested(value, chance.choice((10, 100, 900))))]
    chance.choice(changes)()


def _scaled(value: float, factor: float) -> Value:
    try:
        return value * factor
    except OverflowError:
        return -value


def _respelt(value: str, chance: Random) -> str:
    return mutated_bytes(value.encode(errors="replace"), chance).decode(errors="replace")


def _put(holder: Value, key: Value, value: Value) -> None:
    holder[key] = value


def _nested(value: Value, depth: int) -> Value:
    for _ in range(depth):
        value = [value]
    return value


def _copy(value: Value) -> Value:
    """A copy, so that what is changed later is not changed twice."""
    try:
        return json.loads(json.dumps(value))
    except RecursionError:
        return None
