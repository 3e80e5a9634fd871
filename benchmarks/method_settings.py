"""The tables of settings in `docs/methods/NAME.md`, made from the methods' own records.

    python -m benchmarks.method_settings

Writes each page anew between `<!-- settings -->` and `<!-- /settings -->`; the text around them is left as it is.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from treereg_core.recipe import Recipe
from treereg_core.registry import installed
from treereg_core.settings import describe, range_in_words

PAGES = Path(__file__).parents[1] / "docs" / "methods"
BEGIN, END = "<!-- settings -->\n", "<!-- /settings -->\n"


def main() -> int:
    """Write the tables of all pages."""
    for page in sorted(PAGES.glob("*.md")):
        page.write_text(filled(page), encoding="utf-8")
    return 0


def filled(path: Path) -> str:
    """The page of a method with its table made anew. `ValueError` when a mark is missing."""
    before, begin, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{path.name} lacks the marks {BEGIN.strip()} and {END.strip()}")
    return "\n".join([before + begin, *table(path.stem), "", end + after])


def table(name: str) -> Iterator[str]:
    """The lines of the table of a method's settings, or of those that a recipe changes."""
    offer = installed().entry(name).offer
    if isinstance(offer, Recipe):
        yield "| setting | value in this recipe |"
        yield "| --- | --- |"
        for stage, values in offer.settings.items():
            for setting, value in values.items():
                yield f"| `{stage}.{setting}` | {value} |"
        return
    assert offer is not None, f"{name} is not installed"
    yield "| setting | default | unit | range | what |"
    yield "| --- | --- | --- | --- | --- |"
    for setting, known in describe(offer).items():
        default = json.dumps(known.get("default"), ensure_ascii=False).replace("null", "none")
        allowed = range_in_words({key: value for key, value in known.items() if key != "unit"})
        what = known.get("description", "").replace("|", "\\|")
        yield f"| `{name}.{setting}` | {default} | {known.get('unit', '')} | {allowed} | {what} |"


if __name__ == "__main__":
    sys.exit(main())
