"""How large the page of a run is, how soon it can be used in a browser, and how smoothly it pans.

python -m benchmarks.report --sizes 1500 20000

Needs chromium where Debian's package of that name puts it. In brackets the slowest tenth of frames.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from benchmarks.table import table
from treereg_core.api import register
from treereg_core.outputs import write_result
from treereg_core.report import DATA, PAGE, write_report
from treereg_core.simulate import Scene, simulate, write_simulation

CHROMIUM = "/usr/bin/chromium"
QUIET = ("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update")
SWITCHES = ["--no-sandbox", "--disable-gpu", "--disable-sync", *QUIET]
FRAMES = 90
MOST_IMAGES = 5_000
"""Images are made of orchards of at most so many trees; of larger ones that takes minutes."""
PAN = """([factor, frames]) => new Promise((done) => {
  const { zoom, scene } = window.treereg;
  zoom.reset();
  zoom.by(factor);
  scene.drawNow();
  const times = [];
  const step = (now) => {
    times.push(now);
    if (times.length > frames) return done(times);
    zoom.pan(times.length % 60 < 30 ? 4 : -4, 2, factor);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""
MOVE = """(frames) => new Promise((done) => {
  const times = [];
  window.treereg.play();
  const step = (now) => {
    times.push(now);
    if (times.length > frames) return done(times);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""


def made(folder: Path, trees: int, rasters: bool) -> tuple[dict[str, str], Path]:
    """Register two simulated surveys and write their report; gives what that cost, and the page."""
    write_simulation(simulate(Scene(trees=trees), 0), folder, rasters=rasters)
    result = register(folder / "reference", folder / "source")
    out = folder / "out"
    out.mkdir()
    write_result(result, out)
    begin = time.perf_counter()
    write_report(result, out)
    seconds = time.perf_counter() - begin
    sizes = {f"{name} MB": f"{(out / name).stat().st_size / 1e6:.2f}" for name in (PAGE, DATA)}
    return {"trees": str(trees), "images": "yes" if rasters else "no", "write s": f"{seconds:.2f}", **sizes}, out / PAGE


def opened(page: Page, path: Path) -> dict[str, str]:
    """Seconds until the page can be used and until all is drawn, and frames in a second, the median and the worst."""
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]")
    usable = page.evaluate("performance.now()") / 1000
    page.wait_for_selector("#map[data-drawn]")
    drawn = page.evaluate("performance.now()") / 1000
    figures = {"usable s": f"{usable:.2f}", "drawn s": f"{drawn:.2f}"}
    for factor in (1, 4):
        figures[f"pan x{factor} frames/s"] = rates(page.evaluate(PAN, [factor, FRAMES]))
    page.evaluate("() => { window.treereg.zoom.reset(); window.treereg.scene.drawNow(); }")
    figures["move frames/s"] = rates(page.evaluate(MOVE, 30))
    return figures


def rates(times: list[float]) -> str:
    """Frames in a second: the median, and that of the slowest tenth."""
    steps = sorted(b - a for a, b in itertools.pairwise(times))
    return f"{1000 / steps[len(steps) // 2]:.0f} ({1000 / steps[int(0.9 * len(steps))]:.0f})"


def main() -> int:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.report", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[1_500, 20_000], metavar="TREES")
    sizes = parser.parse_args().sizes
    rows = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SWITCHES)
        for trees in sizes:
            with tempfile.TemporaryDirectory() as folder:
                figures, path = made(Path(folder), trees, rasters=trees <= MOST_IMAGES)
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                rows.append(figures | opened(page, path))
                page.close()
        browser.close()
    print(table(tuple(rows[0]), [tuple(row.values()) for row in rows]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
