"""Warns of everything that a browser would fetch from a network to show a page. Links may lead anywhere."""

import re
from html.parser import HTMLParser
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

REMOTE = re.compile(r"\s*(?:https?:|wss?:)?//", re.IGNORECASE)
IN_STYLES = re.compile(r"""(?:url\(|@import)\s*["']?\s*((?:https?:)?//[^"')\s]+)""", re.IGNORECASE)
FETCHED = {"src", "srcset", "poster", "data", "background"}
LINKS_THAT_FETCH = {
    "stylesheet",
    "icon",
    "preload",
    "prefetch",
    "preconnect",
    "dns-prefetch",
    "modulepreload",
    "manifest",
}


class Fetched(HTMLParser):
    """The addresses beyond the site that a page has fetched, in `found`."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found = IN_STYLES.findall(page)
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Look at one element."""
        given = {name: value or "" for name, value in attributes}
        asked = [given[name] for name in FETCHED & given.keys()]
        if tag == "link" and LINKS_THAT_FETCH & set(given.get("rel", "").lower().split()):
            asked.append(given.get("href", ""))
        self.found += [address for address in asked if REMOTE.match(address)]


def fetched(path: Path) -> list[str]:
    """What a page or a style sheet would fetch from a network."""
    text = path.read_text(encoding="utf-8")
    return IN_STYLES.findall(text) if path.suffix == ".css" else Fetched(text).found


def look(app: Sphinx, problem: Exception | None) -> None:
    """Look at every page and style sheet of a finished site."""
    if problem is not None or app.builder.format != "html":
        return
    for path in sorted(p for p in Path(app.outdir).rglob("*") if p.suffix in {".html", ".css"}):
        for address in fetched(path):
            logging.getLogger(__name__).warning("%s would fetch %s", path.relative_to(app.outdir), address)


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx."""
    app.connect("build-finished", look)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
