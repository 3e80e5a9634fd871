"""The page of a series in a real browser: surveys, trees and colours are chosen, and nothing leaves it."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import geopandas
import pandas as pd
import pytest
from visiting import HOSTILE, PHONE, Visit, brightness, differ

from treereg_core.cli import main
from treereg_core.report.page import page as page_of
from treereg_core.series.page import SCRIPTS, TEMPLATE
from treereg_core.simulate import Scene, Seasons, simulate_series, write_series

SCENE = Scene(trees=250, jitter=0.1, area_persistence=0.9, shift_sd=4.0, rotation_sd=2.0)
STATES = ("present", "missing", "new", "replanted", "unseen")
NONE, MINUS = "\u2013", "\u2212"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four surveys that see parts of the orchard, and one of another orchard between them."""
    folder = tmp_path_factory.mktemp("series")
    surveys = write_series(simulate_series(SCENE, 3, Seasons(surveys=4, seen=0.85)), folder)
    (folder / "else").mkdir()
    other = write_series(simulate_series(SCENE, 99, Seasons(surveys=2)), folder / "else")[1].rename(folder / "other")
    given = [str(survey) for survey in (*surveys[:2], other, *surveys[2:])]
    assert main(["series", *given, "--method", "icp", "-q", "--out", str(folder / "out")]) == 3
    return folder / "out"


def trees_in(folder: Path) -> pd.DataFrame:
    return pd.DataFrame(geopandas.read_parquet(folder / "trees.parquet").drop(columns="geometry"))


def series_in(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "series.json").read_text())


def data_of(one: Visit) -> dict[str, Any]:
    return json.loads(one.page.locator("#data").text_content() or "")


def lines(one: Visit, table: str) -> list[list[str]]:
    """The cells of a table's lines, but for its header."""
    rows = one.page.locator(f"#{table} tr").all()[1:]
    return [row.locator("th, td").all_inner_texts() for row in rows]


def test_the_surveys_are_told_those_not_accepted_too(done: Path, visit: Any) -> None:
    one, document = visit(done / "series.html"), series_in(done)
    told = lines(one, "all")
    assert [line[:2] for line in told] == [[said["name"], said["verdict"]] for said in document["surveys"]]
    for line, said in zip(told, document["surveys"], strict=True):
        counts = [str(said["states"][state]) for state in STATES] if said["states"] else [NONE] * 5
        assert line[3:8] == counts
    shown = one.page.locator("#chosen label").all_inner_texts()
    assert shown == [said["name"] for said in document["surveys"] if said["states"]]
    assert one.page.locator("#headline").inner_text() == f"{document['probable_trees']} trees through 4 surveys"


def test_each_survey_has_its_picture_and_counts(done: Path, visit: Any) -> None:
    one, document = visit(done / "series.html"), series_in(done)
    seen = []
    for said in document["surveys"]:
        if said["states"]:
            one.page.locator("#chosen").get_by_text(said["name"], exact=True).click()
            seen.append(one.pixels())
            legend = one.page.locator("#legend").inner_text()
            assert all(f"{state} ({said['states'][state]})" in legend for state in STATES)
    assert all(differ(a, b) > 1e-3 for a, b in itertools.pairwise(seen))


def test_states_are_hidden_and_growth_is_coloured(done: Path, visit: Any) -> None:
    one = visit(done / "series.html")
    one.page.get_by_role("radio", name="2022").check(force=True)
    before, same = one.pixels(), []
    for state in ("present", "missing", "new", "unseen"):
        one.page.locator(f"[name={state}]").uncheck()
        same += [state] if differ(before, one.pixels()) < 1e-4 else []
        one.page.locator(f"[name={state}]").check()
    assert same == []
    assert differ(before, one.pixels()) == 0
    one.page.get_by_role("radio", name="2024").check(force=True)
    pictures = [one.pixels()]
    for mode in ("previous", "first"):
        one.page.locator("#colour").select_option(mode)
        pictures.append(one.pixels())
        assert "unchanged" in one.page.locator("#legend").inner_text()
    assert all(differ(a, b) > 1e-3 for a, b in itertools.pairwise(pictures))


@pytest.mark.parametrize("how", ["click", "tap"])
def test_a_tree_shows_its_history(how: str, done: Path, visit: Any) -> None:
    one, table = visit(done / "series.html", has_touch=how == "tap"), trees_in(done)
    number = data_of(one)["trees"]["number"]
    probable = table[table.tree.isin(number)]
    missed = probable.groupby("tree").state.apply(lambda state: list(state) == ["present", "missing", *["present"] * 2])
    tree = int(missed.index[missed][0])
    one.page.evaluate("document.getElementById('stage').scrollIntoView({ block: 'center' })")
    place = one.place_of("trees", number.index(tree))
    if how == "tap":
        one.page.touchscreen.tap(*place)
    else:
        one.page.mouse.click(*place)
    assert one.tip()["title"].startswith(f"Tree {tree}:")
    mine = table[table.tree == tree]
    for line, row in zip(lines(one, "history"), mine.itertuples(), strict=True):
        crown = NONE if pd.isna(row.area_m2) else f"{row.area_m2:.1f}"
        assert line[:4] == [row.survey, row.state, crown, NONE]
    assert one.page.locator("#chart circle").count() == 3
    first, last = mine.area_m2.iloc[0], mine.area_m2.iloc[-1]
    told = lines(one, "history")[-1][5].replace(MINUS, "-").removesuffix("%")
    assert float(told) == pytest.approx(100 * (last / first - 1), abs=0.6)


def test_everything_can_be_done_with_keys(done: Path, visit: Any) -> None:
    one = visit(done / "series.html")
    board = one.page.keyboard
    one.page.locator("#map").focus()
    assert one.page.locator("#tree").is_hidden()
    board.press("ArrowRight")
    first = one.page.locator("#tree-text").inner_text()
    board.press("ArrowRight")
    assert one.page.locator("#tree-text").inner_text() not in (first, "")
    assert one.page.locator("#history").is_visible()
    board.press("Escape")
    assert one.page.locator("#tip").is_hidden()
    board.press(" ")
    assert one.page.get_by_role("radio", name="2021").is_checked()
    one.page.get_by_role("radio", name="2021").focus()
    board.press("ArrowRight")
    assert one.page.get_by_role("radio", name="2022").is_checked()
    assert one.page.evaluate("window.treereg.state.survey") == 1


def test_play_goes_through_all_surveys(done: Path, visit: Any) -> None:
    one = visit(done / "series.html")
    one.page.get_by_role("button", name="Play").click()
    assert one.page.get_by_role("radio", name="2021").is_checked()
    one.until("document.getElementById('play').textContent === 'Play'")
    assert one.page.get_by_role("radio", name="2024").is_checked()


def test_markup_from_the_data_is_shown_as_text(done: Path, tmp_path: Path, visit: Any) -> None:
    data = data_of(visit(done / "series.html"))
    series = data["series"]
    for said in series["surveys"]:
        said |= {"name": HOSTILE, "verdict": HOSTILE, "reason": HOSTILE, "path": HOSTILE}
    series |= dict.fromkeys(("method", "start", "version", "crs"), HOSTILE)
    series |= {"plugins": {HOSTILE: HOSTILE}, "settings": {HOSTILE: {HOSTILE: HOSTILE}}}
    path = tmp_path / "hostile.html"
    path.write_text(page_of(data, TEMPLATE, SCRIPTS))
    one = visit(path, viewport=PHONE)
    assert one.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    one.page.locator("#map").focus()
    one.page.keyboard.press("ArrowRight")
    assert one.tip()["survey"] == HOSTILE
    assert lines(one, "history")[0][0] == HOSTILE
    assert HOSTILE in one.page.locator("#method").inner_text()
    assert one.page.locator("img").count() == 0
    assert one.page.evaluate("window.hacked") is None


def test_a_series_of_which_none_was_accepted(done: Path, tmp_path: Path, visit: Any) -> None:
    out, folder = tmp_path / "out", done.parent
    given = ["series", str(folder / "2021"), str(folder / "other"), "--method", "icp", "-q", "--out", str(out)]
    assert main(given) == 3
    one = visit(out / "series.html")
    assert "No survey could be laid on 2021" in one.page.locator("#sentence").inner_text()
    assert one.page.get_by_role("button", name="Play").is_disabled()
    one.page.locator("#colour").select_option("first")
    one.page.locator("#map").focus()
    one.page.keyboard.press("ArrowRight")
    assert len(lines(one, "history")) == 1


def test_damaged_data_is_told(done: Path, tmp_path: Path, visit: Any) -> None:
    data = data_of(visit(done / "series.html"))
    del data["trees"]["x"]
    path = tmp_path / "damaged.html"
    path.write_text(page_of(data, TEMPLATE, SCRIPTS))
    one = visit(path)
    assert one.page.locator("#headline").inner_text() == "This series cannot be drawn"


def test_light_dark_print_and_phone(done: Path, visit: Any) -> None:
    light, dark = visit(done / "series.html"), visit(done / "series.html", color_scheme="dark")
    assert brightness(light.pixels()) > 200
    assert brightness(dark.pixels()) < 80
    dark.page.emulate_media(media="print")
    dark.until("window.treereg.scene.printing")
    assert brightness(dark.pixels()) > 200
    assert dark.page.locator("#controls").is_hidden()
    phone = visit(done / "series.html", viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=3)
    phone.page.locator("#map").focus()
    phone.page.keyboard.press("ArrowRight")
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
