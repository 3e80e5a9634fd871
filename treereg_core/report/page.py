"""A page: template, style, scripts and data in one file that asks the network for nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

SHARED = ("elements", "theme", "placement", "draw", "view", "layer", "stage", "pick", "map_page")
"""The scripts of every page, each on top of those before it."""
SCRIPTS = (*SHARED, "decode", "colour", "heat", "swipe", "scene", "panels", "histogram", "controls", "main")
"""Those of the page of a run."""


def page(data: Mapping[str, Any], template: str = "template.html", scripts: Sequence[str] = SCRIPTS) -> str:
    """The page that shows this data: the content of report-data.json, or what another page's scripts read.

    The data stands in it as JSON in which no markup can begin, and the scripts show it as text. The page's policy
    forbids the network, and any script or style but its own.
    """
    style, d3 = _text("report.css"), _text("d3.min.js")
    script = '"use strict";\n(() => {\n' + "\n".join(_text(f"js/{name}.js") for name in scripts) + "})();\n"
    policy = (
        f"default-src 'none'; script-src {_source(d3)} {_source(script)}; style-src {_source(style)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    parts = {"policy": policy, "style": style, "d3": d3, "script": script, "data": embedded(data)}
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _text(template))


def embedded(data: Mapping[str, Any]) -> str:
    """JSON that may stand in an element of a page: ASCII, and without the sign that opens a tag."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _text(name: str) -> str:
    return (files("treereg_core.report") / name).read_text(encoding="utf-8")


def _source(text: str) -> str:
    """The name by which a policy allows one inline script or style."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
