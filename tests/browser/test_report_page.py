"""The page of a run in a real browser: what clicks, keys and pointers do, what is drawn, and that nothing leaves it."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from visiting import HOSTILE, MOVED, PHONE, brightness, differ

from treereg_core.cli import main
from treereg_core.report import page as page_of
from treereg_core.simulate import Scene, simulate, simulate_family, write_simulation

SCENE = Scene(trees=250, jitter=0.1, area_persistence=0.9, shift_sd=4.0, rotation_sd=2.0)


@pytest.fixture(scope="module")
def clear(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An accepted run by rows, with images."""
    folder = tmp_path_factory.mktemp("clear")
    write_simulation(simulate(SCENE, 4), folder, rasters=True)
    command = ["run", str(folder / "reference"), str(folder / "source"), "--method", "aco+icp", "--rasters", "none"]
    assert main([*command, "-q", "--out", str(folder / "out")]) == 0
    return folder / "out"


def not_accepted(folder: Path, family: str) -> Path:
    write_simulation(simulate_family(family, 1), folder)
    assert main(["run", str(folder / "reference"), str(folder / "source"), "-q", "--out", str(folder / "out")]) == 3
    return folder / "out"


def data_in(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "report-data.json").read_text())


def test_the_page_says_the_verdict_and_draws_the_map(clear: Path, visit: Any) -> None:
    data, one = data_in(clear), visit(clear / "report.html")
    assert one.page.locator("#badge").inner_text() == "accepted"
    assert one.page.locator("#sentence").inner_text() == data["sentence"]
    assert str(data["registration"]["matched"]) in one.page.locator("#figures").inner_text()
    drawn = one.pixels()
    assert len(np.unique(drawn.reshape(-1, 4), axis=0)) > 50
    assert (drawn != drawn[0, 0]).any(axis=2).mean() > 0.05
    assert "aco+icp" in one.page.locator("#method").inner_text()
    assert one.page.locator("#lengths rect").count() > 5


@pytest.mark.parametrize(("role", "how"), [("reference", "hover"), ("source", "hover"), ("reference", "tap")])
def test_a_tree_tells_its_numbers(role: str, how: str, clear: Path, visit: Any) -> None:
    data, one = data_in(clear), visit(clear / "report.html", has_touch=how == "tap")
    other = {"reference": "source", "source": "reference"}[role]
    after = data["placements"][1]
    tree = next(i for i, partner in enumerate(after[role]) if partner >= 0 and i > 100)
    one.page.locator(f"[name={other}]").uncheck()
    one.page.evaluate("document.getElementById('stage').scrollIntoView({ block: 'center' })")
    place = one.place_of(role, tree)
    if how == "tap":
        one.page.touchscreen.tap(*place)
    else:
        one.page.mouse.move(*place)
    tip, partner = one.tip(), after[role][tree]
    assert tip["title"] == f"Tree {data[role]['id'][tree]} of {role}"
    assert float(tip["confidence"]) == pytest.approx(data[role]["confidence"][tree], abs=0.006)
    assert float(tip["canopy area (m²)"]) == pytest.approx(data[role]["area_m2"][tree], abs=0.06)
    assert tip[f"partner in {other}"] == f"tree {data[other]['id'][partner]}"
    pair = (tree, partner) if role == "reference" else (partner, tree)
    assert metres(tip["distance"]) == pytest.approx(distance(data, after, *pair), abs=0.011)


def metres(text: str) -> float:
    value, unit = text.split()
    return float(value) * {"cm": 0.01, "m": 1.0}[unit]


def distance(data: dict[str, Any], placement: dict[str, Any], reference: int, source: int) -> float:
    points = [
        np.array([data[r]["x"][i], data[r]["y"][i]]) / 100 for r, i in (("reference", reference), ("source", source))
    ]
    return float(np.hypot(*(np.array(placement["matrix"]) @ [*points[1], 1.0] - points[0])))


def test_before_and_after_and_the_move_between(clear: Path, visit: Any) -> None:
    data = data_in(clear)
    one = visit(clear / "report.html", reduced_motion="no-preference")
    after = one.pixels()
    one.page.get_by_text("Before", exact=True).first.click()
    assert one.page.evaluate("window.treereg.scene.moving")
    one.until(MOVED)
    assert one.page.evaluate("window.treereg.state.transform") == {"a": 1, "b": 0, "c": 0, "d": 1, "e": 0, "f": 0}
    assert differ(after, one.pixels()) > 0.02
    one.page.get_by_role("button", name="Play the move").click()
    one.until(MOVED)
    shown = one.page.evaluate("window.treereg.state.transform")
    assert [shown["e"], shown["f"]] == [row[2] for row in data["placements"][1]["matrix"]]
    assert differ(after, one.pixels()) < 0.001


def test_a_rival_is_laid(clear: Path, visit: Any) -> None:
    data, one = data_in(clear), visit(clear / "report.html")
    after = one.pixels()
    one.page.get_by_role("button", name="Lay Rival 1").click()
    assert one.page.get_by_role("radio", name="Rival 1").is_checked()
    rival = data["placements"][2]
    assert one.page.locator("#residuals-text").inner_text().startswith(f"Rival 1: {rival['matched']} pairs")
    assert differ(after, one.pixels()) > 0.02


def test_every_layer_is_drawn(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html")
    before, unseen = one.pixels(), []
    for layer in ("reference", "source", "pairs", "residuals", "alone", "rows", "gaps", "boundary"):
        one.page.locator(f"[name={layer}]").click()
        unseen += [layer] if differ(before, one.pixels()) < 1e-4 else []
        one.page.locator(f"[name={layer}]").click()
    assert unseen == []


def test_colours_heat_map_and_the_length_of_residuals(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html")
    seen = [one.pixels()]
    one.page.locator("[name=residuals]").check()
    seen.append(one.pixels())
    one.page.locator("#exaggeration").press("ArrowRight")
    assert one.page.locator("#exaggeration-text").inner_text() == "10 times as long"
    seen.append(one.pixels())
    for select, values in {"#colour": ["match", "row", "confidence"], "#heat": ["confidence", "height"]}.items():
        for value in values:
            one.page.locator(select).select_option(value)
            seen.append(one.pixels())
    assert all(differ(a, b) > 1e-3 for a, b in itertools.pairwise(seen))


def test_the_swipe_shows_both_images(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html")
    one.until("Object.keys(window.treereg.scene.pictures).length === 2")
    for layer in ("reference", "source", "alone", "gaps", "boundary"):
        one.page.locator(f"[name={layer}]").uncheck()
    shown = {}
    for value in ("reference", "source", "swipe"):
        one.page.locator("#image").select_option(value)
        shown[value] = one.pixels().astype(int)
    width = shown["swipe"].shape[1]
    left, right = slice(0, width // 2 - 4), slice(width // 2 + 4, width)
    rows = slice(0, 200)  # without the scale bar and the grip
    assert np.array_equal(shown["swipe"][rows, left], shown["reference"][rows, left])
    assert np.array_equal(shown["swipe"][rows, right], shown["source"][rows, right])
    assert differ(shown["reference"], shown["source"]) > 0.1
    one.page.evaluate("document.getElementById('stage').scrollIntoView({ block: 'center' })")
    box = one.page.locator("#map").bounding_box()
    middle, height = box["x"] + box["width"] / 2, box["y"] + 100
    one.page.mouse.move(middle + 5, height)
    one.page.mouse.down()
    one.page.mouse.move(box["x"] + 0.8 * box["width"], height)
    one.page.mouse.up()
    assert one.page.locator("#swipe").input_value() == "80"
    assert one.page.evaluate("window.treereg.scene.zoomState.x") == 0
    one.page.locator("#swipe").press("End")
    assert np.array_equal(one.pixels()[rows, left], shown["reference"][rows, left])
    assert differ(one.pixels()[rows, right], shown["source"][rows, right]) > 0.1


def test_everything_can_be_done_with_keys(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html")
    board = one.page.keyboard
    one.page.locator("#map").focus()
    board.press("ArrowRight")
    first = one.tip()["title"]
    board.press("ArrowRight")
    assert one.tip()["title"] != first
    board.press("ArrowLeft")
    board.press("Escape")
    assert one.page.locator("#tip").is_hidden()
    scale = "window.treereg.scene.view.scale"
    start = one.page.evaluate(scale)
    board.press("+")
    board.press("Shift+ArrowRight")
    assert one.page.evaluate(scale) > 1.5 * start
    left = one.page.evaluate("window.treereg.scene.view.left")
    board.press("Shift+ArrowRight")
    assert one.page.evaluate("window.treereg.scene.view.left") == pytest.approx(left - 70)
    board.press("0")
    assert one.page.evaluate(scale) == start
    board.press(" ")
    assert one.page.get_by_role("radio", name="Before").is_checked()
    one.page.get_by_role("radio", name="Before").focus()
    board.press("ArrowRight")
    assert one.page.get_by_role("radio", name="After").is_checked()


def test_wheel_and_drag_move_the_map(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html")
    one.page.evaluate("document.getElementById('stage').scrollIntoView({ block: 'center' })")
    x, y = one.place_of("reference", 100)
    one.page.mouse.move(x, y)
    one.page.mouse.wheel(0, -300)
    one.until("window.treereg.scene.zoomState.k > 1.2")
    assert one.place_of("reference", 100) == pytest.approx((x, y), abs=1.5)  # a pointer stands on whole pixels
    x, y = one.place_of("reference", 100)
    one.page.mouse.move(x, y)
    one.page.mouse.down()
    one.page.mouse.move(x + 50, y + 20)
    one.page.mouse.up()
    assert one.place_of("reference", 100) == pytest.approx((x + 50, y + 20), abs=1.5)


@pytest.mark.parametrize(("family", "verdict"), [("different", "failed"), ("periodic_crops", "ambiguous")])
def test_other_verdicts(family: str, verdict: str, tmp_path: Path, visit: Any) -> None:
    out = not_accepted(tmp_path, family)
    data, one = data_in(out), visit(out / "report.html")
    assert one.page.locator("#badge").inner_text() == verdict
    assert one.page.locator("#placements label").count() == len(data["placements"])
    assert one.page.locator("#rivals-section").is_visible() == (verdict == "ambiguous")
    before = one.pixels()
    one.page.locator("#map").focus()
    one.page.keyboard.press(" ")
    assert (differ(before, one.pixels()) > 0.01) == (verdict == "ambiguous")


def hostile(value: Any) -> Any:
    """Data whose every text is markup, names of members that are free included."""
    if isinstance(value, str):
        return value if value.startswith("data:") else HOSTILE
    if isinstance(value, list):
        return [hostile(item) for item in value]
    return {key: hostile(item) for key, item in value.items()} if isinstance(value, dict) else value


def test_markup_from_the_data_is_shown_as_text(clear: Path, tmp_path: Path, visit: Any) -> None:
    data = data_in(clear)
    free = {key: hostile(data[key]) for key in ("registration", "headline", "sentence", "chance_wrong")}
    free["registration"]["settings"] = {HOSTILE: {HOSTILE: HOSTILE}}
    data |= {**free, "warnings": [HOSTILE], "timings_s": {HOSTILE: 1.0}}
    for side in ("reference", "source"):
        data[side]["attributes"] = {HOSTILE: data[side]["confidence"]}
    data["placements"][2]["name"] = HOSTILE
    path = tmp_path / "hostile.html"
    path.write_text(page_of(data))
    one = visit(path)
    assert one.page.locator("#sentence").inner_text() == HOSTILE
    one.page.locator("#colour").select_option(HOSTILE)
    one.page.locator("#heat").select_option(HOSTILE)
    one.page.locator("#map").focus()
    one.page.keyboard.press("ArrowRight")
    assert HOSTILE.replace("_", " ") in one.tip()
    assert one.page.locator("img").count() == 0
    assert one.page.evaluate("window.hacked") is None


def test_damaged_data_is_told(clear: Path, tmp_path: Path, visit: Any) -> None:
    data = data_in(clear)
    del data["source"]["x"]
    path = tmp_path / "damaged.html"
    path.write_text(page_of(data))
    one = visit(path)
    assert one.page.locator("#headline").inner_text() == "This report cannot be drawn"
    assert "make it again" in one.page.locator("#sentence").inner_text()


def test_light_dark_and_print(clear: Path, visit: Any) -> None:
    light, dark = visit(clear / "report.html"), visit(clear / "report.html", color_scheme="dark")
    assert brightness(light.pixels()) > 200
    assert brightness(dark.pixels()) < 80
    ground = "getComputedStyle(document.body).backgroundColor"
    assert light.page.evaluate(ground) != dark.page.evaluate(ground)
    dark.page.emulate_media(media="print")
    dark.until("window.treereg.scene.printing")
    assert brightness(dark.pixels()) > 200
    assert dark.page.evaluate(ground) == "rgb(255, 255, 255)"
    for hidden in ("#controls", "#play", "#keys"):
        assert dark.page.locator(hidden).is_hidden()
    dark.page.emulate_media(media="screen")
    dark.until("!window.treereg.scene.printing")
    assert brightness(dark.pixels()) < 80
    assert len(dark.page.pdf()) > 20_000


def test_a_phone_shows_it_all_without_scrolling_sideways(clear: Path, visit: Any) -> None:
    one = visit(clear / "report.html", viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=3)
    assert one.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert len(np.unique(one.pixels().reshape(-1, 4), axis=0)) > 50
    one.page.evaluate("document.getElementById('stage').scrollIntoView({ block: 'center' })")
    one.page.touchscreen.tap(*one.place_of("reference", 120))
    one.tip()
    tip, stage = (one.page.locator(name).bounding_box() for name in ("#tip", "#stage"))
    assert stage["x"] <= tip["x"]
    assert tip["x"] + tip["width"] <= stage["x"] + stage["width"]
    assert one.page.locator("#stage").bounding_box()["height"] < PHONE["height"] * 0.7
