"""JSON as text: one line for data, readable lines for people; never NaN."""

from __future__ import annotations

import base64
import json
import math
from datetime import date, datetime, time, timedelta
from decimal import Decimal
from typing import Any

LINE = 100


def json_line(value: Any) -> bytes:
    """One line of UTF-8. What JSON cannot hold becomes what is nearest to it (`plain`)."""
    try:
        return json.dumps(value, ensure_ascii=False, allow_nan=False).encode()
    except UnicodeEncodeError:  # half a surrogate pair, which JSON has but UTF-8 has not
        return json.dumps(plain(value)).encode()
    except ValueError:
        return json_line(plain(value))


def plain(value: Any) -> Any:
    """A value as JSON has it: null for NaN and infinity, dates in ISO 8601, durations in seconds, bytes in base 64."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, timedelta):
        return value.total_seconds()
    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value if value is None or isinstance(value, str | int) else str(value)


def readable(value: Any, indent: str = "") -> str:
    """Indented JSON in which whatever fits on a line stands on one, matrices row by row. `ValueError` for NaN."""
    line = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if len(indent) + len(line) <= LINE or not isinstance(value, dict | list | tuple) or not value:
        return line
    deeper = indent + "  "
    if isinstance(value, dict):
        items = [f"{json.dumps(str(key), ensure_ascii=False)}: {readable(item, deeper)}" for key, item in value.items()]
    else:
        items = [readable(item, deeper) for item in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{deeper}" + f",\n{deeper}".join(items) + f"\n{indent}{closing}"
