"""The browser that tests of pages share, and pages in it that must do nothing wrong."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, sync_playwright
from visiting import DESKTOP, Visit

CHROMIUM = shutil.which("chromium")
QUIET = ("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update")
SWITCHES = ["--no-sandbox", "--disable-gpu", "--disable-sync", *QUIET]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        sentence = "no chromium is installed; install it (Debian: apt-get install chromium) to test pages in it"
        if os.environ.get("CI"):
            pytest.fail(sentence)
        pytest.skip(sentence)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SWITCHES)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser: Browser) -> Iterator[Any]:
    """Opens a page; in the end nothing may have gone wrong in any."""
    contexts: list[BrowserContext] = []
    visits: list[Visit] = []

    def opened(path: Path, **options: Any) -> Visit:
        contexts.append(browser.new_context(**{"viewport": DESKTOP, "reduced_motion": "reduce", **options}))
        visits.append(Visit(contexts[-1], path))
        return visits[-1]

    yield opened
    for context in contexts:
        context.close()
    assert [fault for one in visits for fault in one.faults] == []
