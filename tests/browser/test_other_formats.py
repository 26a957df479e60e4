"""Files of other formats in the browser: empty maps, their framing and their downloads."""

import zipfile

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.scene import scene_limits
from pd_editor.viewer.scene.camera import projected
from tests.browser.test_files_and_sessions import notice, upload
from tests.scene.formats.test_commonroad import text as commonroad_text
from tests.scene.formats.test_opendrive import LINE, lane, road, section, write
from tests.scene.test_map_window import city

pytestmark = pytest.mark.browser

LONG = LINE.replace('length="50"', 'length="400"')


def test_an_empty_map_is_shown_whole_and_asks_to_be_filled(open_editor, tmp_path):
    path = write(tmp_path, road(section(lane(-1), lane(1)), geometry=LONG, length=400))
    editor = open_editor()
    upload(editor, "empty.xodr", path.read_bytes())
    editor.until(lambda: not len(editor.session.scenario.agents), "the road")
    notice(editor, "Fill the road")
    editor.settle()
    lines = np.concatenate(editor.session.scenario.road_map.polylines)
    screen, is_ahead = projected(editor.client.camera, lines * [1, 1, 0])
    assert is_ahead.all()
    assert ((screen > 0) & (screen < 1)).all(), "the whole road is in the picture"
    assert np.ptp(screen, axis=0).max() > 0.5, "and not from too far away"
    assert editor.page.get_by_text("Click a car").count() == 0


def test_a_commonroad_scene_is_downloaded_as_commonroad(open_editor, tmp_path):
    editor = open_editor()
    upload(editor, "scene.xml", commonroad_text().encode())
    name = "ZAM_Road-1_1_T-1"
    editor.until(lambda: editor.session.scenario.scenario_id == name, "the scene")
    editor.choose("Format", "CommonRoad")
    with editor.page.expect_download() as download:
        editor.press("Download zip")
    files = zipfile.ZipFile(download.value.path()).namelist()
    assert f"{name}/{name}.xml" in files


def test_a_part_of_a_large_map_is_chosen_on_its_outline(
    open_editor, tmp_path, monkeypatch
):
    editor = open_editor()
    monkeypatch.setattr(scene_limits, "MAX_LANES", 100)
    upload(editor, "city.xodr", city(tmp_path).read_bytes())
    card = editor.page.get_by_role("dialog", name="Choose a part of the map")
    card.wait_for()
    notice(editor, "has 144 lanes")
    canvas = card.locator("svg")
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    mouse = editor.page.mouse
    mouse.move(x - 100, y - 100)
    mouse.down()
    mouse.move(x + 20, y + 10, steps=4)
    mouse.up()
    editor.screenshot("40_part_of_a_map")
    card.get_by_role("button", name="Open this part").click()
    editor.until(
        lambda: editor.session.scenario.scenario_id.startswith("city-x"), "the part"
    )
    window = editor.session.base.provenance.cut.window
    lanes = len(editor.session.scenario.road_map.lanes)
    assert 0 < lanes < 100
    # The same file again, through a click with a size.
    editor.press("Choose a part of the map")
    card.wait_for()
    # It has the focus, so that arrow keys move the square.
    square = card.locator("rect")
    corner = float(square.get_attribute("x") or "nan")
    expect(card.locator("svg")).to_be_focused()
    editor.page.keyboard.press("Shift+ArrowRight")
    half = float(square.get_attribute("width") or "nan") / 2
    assert float(square.get_attribute("x") or "nan") == pytest.approx(corner + half)
    # Tab goes round in it, both ways.
    size = card.get_by_label("Half side (m)")
    names = [size, card.get_by_text("Cancel"), card.get_by_text("Open this part")]
    for one in (*names, card.locator("svg"), size):
        editor.page.keyboard.press("Tab")
        expect(one).to_be_focused()
    for one in (card.locator("svg"), names[-1]):
        editor.page.keyboard.press("Shift+Tab")
        expect(one).to_be_focused()
    size.fill("40")
    mouse.click(x, y)
    card.get_by_text("80 \u00d7 80 m").wait_for()
    card.get_by_role("button", name="Open this part").click()
    editor.until(
        lambda: editor.session.base.provenance.cut.window.radius_m == 40, "another part"
    )
    assert editor.session.base.provenance.cut.window != window
