"""The site needs no network: formulas are drawn by the browser, and what a page would fetch is found."""

from pathlib import Path

import pytest

from docs.extensions.offline import fetched
from tests.pages import ROOT, blocks, name

FORMULAS = [page for page in sorted(ROOT.glob("docs/**/*.md")) if "$$" in page.read_text(encoding="utf-8")]


@pytest.mark.parametrize(
    "element",
    [
        '<script src="https://somewhere.org/a.js"></script>',
        '<link rel="stylesheet" href="//somewhere.org/a.css">',
        '<link href="http://somewhere.org/a.woff2" rel="preload">',
        '<img alt="a" src="https://somewhere.org/a.png">',
        '<source srcset="https://somewhere.org/a.webp 2x">',
        "<style>@import 'https://somewhere.org/a.css';</style>",
        '<p style="background: url(https://somewhere.org/a.png)">a</p>',
        '<iframe src="HTTPS://somewhere.org"></iframe>',
    ],
)
def test_what_a_page_would_fetch_is_found(element: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(f"<html><body>{element}</body></html>", encoding="utf-8")
    assert len(fetched(page)) == 1


@pytest.mark.parametrize(
    "element",
    [
        '<a href="https://somewhere.org">a link</a>',
        '<link rel="canonical" href="https://somewhere.org">',
        '<script src="a.js"></script><img alt="a" src="data:image/png;base64,AAAA">',
        "<p>https://somewhere.org/a.js</p>",
        '<style>p { background: url("data:image/svg+xml;charset=utf-8,<svg/>") }</style>',
    ],
)
def test_links_may_lead_anywhere(element: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(f"<html><body>{element}</body></html>", encoding="utf-8")
    assert fetched(page) == []


def test_fonts_of_a_style_sheet_are_found(tmp_path: Path) -> None:
    sheet = tmp_path / "style.css"
    sheet.write_text('@font-face { src: url("https://somewhere.org/a.woff2") }', encoding="utf-8")
    assert fetched(sheet) == ["https://somewhere.org/a.woff2"]


@pytest.mark.parametrize("page", FORMULAS, ids=name)
def test_formulas_are_closed(page: Path) -> None:
    """A `$$` too many would swallow the text up to the next one."""
    text = page.read_text(encoding="utf-8")
    for block in blocks(page):
        text = text.replace(block, "")
    lines = [line.strip() for line in text.splitlines() if "$$" in line]
    assert set(lines) == {"$$"}
    assert len(lines) % 2 == 0
