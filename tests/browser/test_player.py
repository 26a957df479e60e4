"""The player's page, opened from a file without a network, as a person would."""

import re
from base64 import b64decode
from dataclasses import replace
from io import BytesIO
from operator import methodcaller
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats.player import Player, player_page
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor, warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm

pytestmark = [pytest.mark.browser, pytest.mark.slow]
EVIL = "</script><b>x</b>"


@pytest.fixture
def opened(browser, tmp_path: Path):
    """Opens the page of a warped junction and a roundabout with a strange name."""
    plain = open_scenario("signalised-junction")
    warp = RoadWarp(
        anchor=pose_of_anchor(plain, plain.focal_id),
        terms=(WarpTerm(kind="smooth-turn", power=6.0, length_m=30.0),),
    )
    scenes = [
        replace(warp_scenario(plain, warp), scenario_id="warped"),
        replace(open_scenario("roundabout"), scenario_id=EVIL),
    ]
    path = tmp_path / "set.html"
    path.write_bytes(player_page(scenes))
    contexts, told = [], []

    def page_with(**options) -> Page:
        size = {"width": 800, "height": 480}
        options = {"reduced_motion": "reduce", "viewport": size, **options}
        context = browser.new_context(offline=True, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: told.append(message.text))
        page.on("pageerror", lambda error: told.append(str(error)))
        page.on("request", lambda one: told.append(one.url))
        page.goto(path.as_uri())
        expect(page.get_by_text("60 agents")).to_be_visible()
        return page

    yield page_with
    for context in contexts:
        context.close()
    assert set(told) <= {path.as_uri(), "data:,"}


def seconds(page: Page) -> float:
    words = page.get_by_label("Time shown").text_content() or ""
    return float(words.removesuffix(" s").replace("\u2212", "-"))


# What was asked for is drawn after two frames, however late a busy machine draws them.
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


def picture(page: Page) -> bytes:
    page.evaluate(DRAWN)
    return page.get_by_role("main").screenshot()


def agents_drawn(page: Page, canvas: int = 1) -> np.ndarray:
    """The agents, of shape (rows, columns, 4): their canvas has no line of the road."""
    page.evaluate(DRAWN)
    url = page.locator("canvas").nth(canvas).evaluate("one => one.toDataURL()")
    return np.asarray(Image.open(BytesIO(b64decode(url.partition(",")[2]))), float)


def differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether more than edges differ, which a browser smooths in more than one way."""
    return bool((np.abs(one - other).max(axis=2) > 64.0).mean() > 2e-4)


def test_time_runs_and_the_picture_moves(opened):
    page = opened(reduced_motion="no-preference")
    expect(page.get_by_label("Time shown")).to_have_text(re.compile("^\u2212[32]"))
    page.keyboard.press(" ")
    expect(page.get_by_role("button", name="Play")).to_be_visible()
    before = picture(page)
    begin = seconds(page)
    assert picture(page) == before
    page.keyboard.press(".")
    after = picture(page)
    assert after != before
    assert seconds(page) == pytest.approx(begin + 0.1, abs=0.051)
    page.keyboard.press(",")
    page.keyboard.press("l")
    picture(page)
    assert seconds(page) == pytest.approx(begin + 1.0, abs=0.051)
    page.keyboard.press("Shift+ArrowLeft")
    picture(page)
    assert seconds(page) == pytest.approx(begin, abs=0.051)
    page.get_by_label("Speed").select_option("4")
    page.get_by_role("slider").fill("60")
    picture(page)
    assert seconds(page) == pytest.approx(1.1)
    assert picture(page) != before


def test_an_agent_is_followed_and_labelled(opened):
    page = opened()
    focal = open_scenario("signalised-junction").focal_id
    whole = agents_drawn(page)
    page.keyboard.press("f")
    expect(page.get_by_role("button", name="Follow")).to_have_attribute(
        "aria-pressed", "true"
    )
    expect(page.get_by_role("note")).to_contain_text(focal)
    assert differ(agents_drawn(page), whole)
    stage = page.get_by_role("main").bounding_box()
    middle = stage["x"] + stage["width"] / 2, stage["y"] + stage["height"] / 2
    for _ in range(3):
        page.keyboard.press("l")
        # It stays in the middle, under the pointer, while it drives.
        page.keyboard.press("Escape")
        expect(page.get_by_role("button", name="Follow")).to_have_attribute(
            "aria-pressed", "false"
        )
        page.mouse.click(*middle)
        expect(page.get_by_role("note")).to_contain_text(focal)
        page.keyboard.press("f")
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 80, middle[1], steps=3)
    page.mouse.up()
    expect(page.get_by_role("button", name="Follow")).to_have_attribute(
        "aria-pressed", "false"
    )
    page.keyboard.press("Escape")
    page.mouse.move(5, 5)
    for _ in range(3):
        page.keyboard.press("j")
    page.keyboard.press("Home")
    assert not differ(agents_drawn(page), whole)
    # A picture of another size shows all, until the view is moved.
    page.set_viewport_size({"width": 1000, "height": 700})
    resized = agents_drawn(page)
    page.keyboard.press("Home")
    assert not differ(agents_drawn(page), resized)
    page.keyboard.press("+")
    zoomed = agents_drawn(page)
    page.set_viewport_size({"width": 1000, "height": 690})
    assert not differ(agents_drawn(page)[5:-5], zoomed[10:-10])


def test_the_view_zooms_tilts_and_compares(opened):
    page = opened()
    seen = [picture(page)]
    page.mouse.move(400, 300)
    page.mouse.wheel(0, -300)
    seen.append(picture(page))
    for key in ("v", "o", "o", "v", "-", "+"):
        page.keyboard.press(key)
        seen.append(picture(page))
    zoomed, slanted, compared, hidden, above, far, near = seen[1:]
    assert len({seen[0], zoomed, slanted, compared, far}) == 5
    assert (hidden, above, near) == (slanted, zoomed, zoomed)


def test_scenes_are_a_list_and_names_are_text(opened):
    page = opened()
    page.get_by_role("button", name=EVIL).click()
    expect(page.get_by_role("heading", name=EVIL)).to_be_visible()
    expect(page.get_by_text("11 agents")).to_be_visible()
    assert page.locator("b").count() == 0
    # It is as recorded: there is nothing to compare with.
    expect(page.get_by_role("button", name="Original")).to_be_hidden()
    page.keyboard.press("PageUp")
    expect(page.get_by_text("60 agents")).to_be_visible()
    page.keyboard.press("?")
    expect(page.get_by_role("region", name="About")).to_contain_text("play or pause")


def test_it_is_dark_where_the_browser_is_and_fits_a_phone(opened):
    light = picture(opened())
    page = opened(color_scheme="dark")
    assert picture(page) != light
    phone = opened(viewport={"width": 390, "height": 780}, has_touch=True)
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    for name in ("Play", "Follow", "Fit", "3-D", "Original", "About"):
        box = phone.get_by_role("button", name=name, exact=True).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
        assert box["y"] + box["height"] <= 780
    before = picture(phone)
    phone.get_by_role("button", name="3-D").tap()
    assert picture(phone) != before


def test_a_notebook_plays_it_in_its_output(browser):
    # As notebooks do, by name.
    output = methodcaller("_repr_html_")(Player(open_scenario("roundabout")))
    page = browser.new_page()
    page.set_content(f"<!doctype html><p>Out</p>{output}")
    frame = page.frame_locator("iframe")
    expect(frame.get_by_text("11 agents")).to_be_visible()
    expect(frame.get_by_label("Time shown")).not_to_have_text("\u22124.9 s")
    page.close()


def test_two_scenes_play_side_by_side_on_one_clock(browser, tmp_path: Path):
    plain = open_scenario("signalised-junction")
    late = replace(open_scenario("roundabout"), scenario_id=EVIL)
    path = tmp_path / "pair.html"
    path.write_bytes(player_page([plain, late], is_pair=True))
    context = browser.new_context(
        offline=True, reduced_motion="reduce", viewport={"width": 900, "height": 480}
    )
    page = context.new_page()
    told: list[str] = []
    page.on("pageerror", lambda error: told.append(str(error)))
    page.goto(path.as_uri())
    expect(page.get_by_role("heading", name="signalised-junction")).to_be_visible()
    expect(page.get_by_role("heading", name=EVIL)).to_be_visible()
    expect(page.get_by_label("Scenes")).to_be_hidden()
    traffic = page.locator("canvas")
    boxes = [traffic.nth(number).bounding_box() for number in (0, 2)]
    assert [round(box["x"]) for box in boxes] == [0, 450]

    def pictures() -> list[np.ndarray]:
        return [agents_drawn(page, canvas) for canvas in (1, 3)]

    before = pictures()
    page.keyboard.press("l")
    assert all(map(differ, before, pictures()))
    # A drag over either moves both.
    before = pictures()
    page.mouse.move(700, 240)
    page.mouse.down()
    page.mouse.move(760, 280, steps=4)
    page.mouse.up()
    assert all(map(differ, before, pictures()))
    context.close()
    assert not told
