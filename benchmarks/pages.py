"""Pages of the documentation that commands fill in, and tables for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence


def filled(page: str, texts: Mapping[str, str]) -> str:
    """The page with new texts between its marks `<!-- NAME -->` and `<!-- /NAME -->`, the rest left as it is.

    `ValueError` when a mark is missing.
    """
    for name, text in texts.items():
        before, begin, rest = page.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition(f"<!-- /{name} -->\n")
        if not (begin and end):
            raise ValueError(f"the page lacks the marks <!-- {name} --> and <!-- /{name} -->")
        page = f"{before}{begin}\n{text}\n\n{end}{after}"
    return page


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]], left: int | None = None) -> str:
    """A table of Markdown: so many columns flush left, all by default, the others flush right."""
    left = len(header) if left is None else left
    rule = ["---"] * left + ["---:"] * (len(header) - left)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))
