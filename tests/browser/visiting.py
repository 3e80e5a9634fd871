"""A page that is open in a browser, and what tests ask of it."""

from __future__ import annotations

import base64
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import BrowserContext, Route

DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
HOSTILE = "<img src=x onerror=alert(1)></script><script>window.hacked=1</script>"
SETTLED = "document.documentElement.dataset.fault || document.getElementById('map').dataset.drawn"
MOVED = "!window.treereg.scene.moving"


class Visit:
    """A page that is open, and what went wrong in it."""

    def __init__(self, context: BrowserContext, path: Path) -> None:
        self.faults: list[str] = []
        self.page = context.new_page()
        self.page.on("console", lambda message: self.faults.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("dialog", lambda dialog: self.faults.append(f"dialog: {dialog.message}"))
        context.route("**/*", lambda route: self.answer(route, path.as_uri()))
        self.page.goto(path.as_uri())
        self.until(SETTLED)

    def answer(self, route: Route, mine: str) -> None:
        if route.request.url == mine:
            route.continue_()
        else:
            self.faults.append(f"asked for {route.request.url[:80]}")
            route.abort()

    def until(self, expression: str) -> None:
        """Wait until this holds; asked from outside, since the page's policy lets no text be run as a script."""
        for _ in range(500):
            if self.page.evaluate(expression):
                return
            self.page.wait_for_timeout(20)
        pytest.fail(f"never {expression}")

    def pixels(self) -> np.ndarray:
        """What is on the canvas, once everything asked for is drawn: (height, width, 4)."""
        self.until(MOVED)
        url = self.page.evaluate("""() => {
            window.treereg.scene.drawNow();
            return window.treereg.canvas.toDataURL();
        }""")
        return np.asarray(255 * imread(BytesIO(base64.b64decode(url.partition(",")[2])), format="png"))

    def place_of(self, role: str, tree: int) -> tuple[float, float]:
        """Where a tree lies on the page."""
        x, y = self.page.evaluate("([role, tree]) => window.treereg.scene.screenOf(role, tree)", [role, tree])
        box = self.page.locator("#map").bounding_box()
        assert box is not None
        return box["x"] + x, box["y"] + y

    def tip(self) -> dict[str, str]:
        """The numbers that are shown of a tree, by name, and its title."""
        self.page.wait_for_selector("#tip:not([hidden])")
        names, values = (self.page.locator(f"#tip {tag}").all_inner_texts() for tag in ("dt", "dd"))
        title = self.page.locator("#tip strong").inner_text()
        return {"title": title, **dict(zip(names, values, strict=True))}


def differ(a: np.ndarray, b: np.ndarray) -> float:
    """The share of pixels that differ."""
    return float((a != b).any(axis=2).mean())


def brightness(pixels: np.ndarray) -> float:
    return float(np.median(pixels[..., :3]))
