"""A JSON object with one long list, read some items at a time: what was read and used need not be held."""

from __future__ import annotations

import json
import re
from codecs import getincrementaldecoder
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from treereg_core.io.files import read_json
from treereg_core.io.untrusted import check_file_size

PIECE = 2**20
"""So many bytes are read at a time."""
ENOUGH = 2**16
"""Items are handed out when they take so many characters: few enough to be at hand in the processor's caches."""
FOLLOWING = frozenset(",:]}")
"""What stands behind a value; a number without it may go on in the next piece."""

_BLANK = re.compile(r"[ \t\n\r]*")
_value_at = json.JSONDecoder().raw_decode


class NotInPieces(Exception):  # noqa: N818 -- an outcome, not a fault
    """The file has to be read whole: it is no such object, or unsound, which `read_whole` says in words."""


def items_of(path: Path, name: str, members: dict[str, Any]) -> Iterator[list[Any]]:
    """The items of the list `name` of the object that a JSON file is, some at a time, never none.

    The other members get into `members` as they come; all are there at the end. Raises `NotInPieces`, perhaps after
    items that were sound, and `InputError` for a file that is too large.
    """
    try:
        check_file_size(path)
        with path.open("rb") as file:
            yield from _Reader(file).items(name, members)
    except (OSError, ValueError, RecursionError) as error:
        raise NotInPieces from error


def read_whole(path: Path) -> Any:
    """What `read_json` gives and raises, but an unsound file takes no more memory than its text."""
    read_json(path, hook=lambda members: None)
    return read_json(path)


class _Reader:
    """The text of a file, of which a piece is held, and the place in it that is reached."""

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file
        self.decoder = getincrementaldecoder(json.detect_encoding(file.read(4)))()
        file.seek(0)
        self.text, self.at = "", 0
        self.dropped = 0

    def items(self, name: str, members: dict[str, Any]) -> Iterator[list[Any]]:
        found, sign = False, self.sign()
        if sign != "{":
            raise NotInPieces
        while sign != "}":
            key = self.value()
            if not isinstance(key, str) or self.sign() != ":":
                raise NotInPieces
            if key != name:
                members[key] = self.value()
            elif found or self.sign() != "[":
                raise NotInPieces
            else:
                found = True
                yield from self.list()
            sign = self.sign()
            if sign not in (",", "}"):
                raise NotInPieces
        if not found or self.sign():
            raise NotInPieces

    def list(self) -> Iterator[list[Any]]:
        """The items of the list that has begun, up to its end."""
        items, sign, begun = [], ",", self.dropped + self.at
        while sign != "]":
            items.append(self.value())
            sign = self.sign()
            if sign not in (",", "]"):
                raise NotInPieces
            if sign == "]" or self.dropped + self.at - begun >= ENOUGH:
                yield items
                items, begun = [], self.dropped + self.at

    def value(self) -> Any:
        """The value that comes next."""
        while True:
            try:
                value, end = _value_at(self.text, self._next(self.at))
                if self.text[self._next(end)] in FOLLOWING:
                    self.at = end
                    return value
            except (ValueError, IndexError):
                pass  # cut off by the end of the piece, or wrong, which shows when there is no more
            if not self.more():
                raise NotInPieces

    def sign(self) -> str:
        """The character that comes next, white space apart; empty at the end."""
        while (at := self._next(self.at)) == len(self.text):
            if not self.more():
                return ""
        self.at = at + 1
        return self.text[at]

    def more(self) -> bool:
        """Read on, at least as much again as is left, so that a long value takes few turns; False at the end."""
        raw = self.file.read(max(PIECE, len(self.text) - self.at))
        self.dropped += self.at
        self.text, self.at = self.text[self.at :] + self.decoder.decode(raw, not raw), 0
        return bool(raw)

    def _next(self, at: int) -> int:
        """The place of the first character from here on that is no white space."""
        blank = _BLANK.match(self.text, at)
        return blank.end() if blank else at
