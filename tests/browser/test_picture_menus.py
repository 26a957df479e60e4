"""Tooltip, context menu, selection keys and the candidates' banner, by real mouse."""

import numpy as np
import pytest
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    page = open_editor()
    page.go_to_now()
    return page


def focal_state(editor):
    scenario = editor.session.scenario
    row, step = scenario.agents.row_of[scenario.focal_id], scenario.current_step
    heading = float(scenario.agents.heading_rad[row, step])
    return scenario.agents.position_m[row, step], heading


def roof(editor) -> tuple[float, float, float]:
    (x, y), heading = focal_state(editor)
    return float(x - 0.9 * np.cos(heading)), float(y - 0.9 * np.sin(heading)), 1.2


def ahead(editor, distance_m: float) -> np.ndarray:
    point, heading = focal_state(editor)
    return point + distance_m * np.array([np.cos(heading), np.sin(heading)])


def right_click(editor, point) -> None:
    editor.settle()
    editor.page.mouse.click(*editor.pixel(point), button="right")


def item(editor, name: str):
    return editor.page.get_by_role("menuitem", name=name)


def test_a_pointer_at_rest_is_told_what_is_there(editor):
    page, session = editor.page, editor.session
    tip = page.get_by_role("tooltip")
    editor.settle()
    page.mouse.move(*editor.pixel(roof(editor)))
    tip.get_by_text(f"vehicle {session.scenario.focal_id}").wait_for()
    expect(tip).to_contain_text("focal agent")
    expect(tip).to_contain_text("m/s")
    editor.screenshot("11_tooltip")
    page.mouse.move(*editor.pixel(ahead(editor, 16.0)))
    tip.get_by_text("vehicle lane").wait_for()
    page.mouse.down()
    tip.wait_for(state="hidden")
    page.mouse.up()


def test_right_clicks_offer_what_there_is_to_do(editor):
    page, session = editor.page, editor.session
    focal = session.scenario.focal_id
    before = len(session.scenario.agents)
    right_click(editor, roof(editor))
    item(editor, "Duplicate").wait_for()
    assert session.selection == (focal,)
    expect(item(editor, "Make focal")).to_be_disabled()
    editor.screenshot("12_menu")
    item(editor, "Duplicate").click()
    editor.until(lambda: len(session.scenario.agents) == before + 1, "a copy")
    expect(item(editor, "Duplicate")).to_be_hidden()
    editor.key("Control+z")
    editor.until(lambda: len(session.scenario.agents) == before, "undo")

    point = ahead(editor, 15.0)
    right_click(editor, point)
    item(editor, "Place a vehicle here").click()
    editor.until(lambda: len(session.scenario.agents) == before + 1, "a new agent")
    assert np.linalg.norm(session.scenario.agents.position_m[-1, 49] - point) < 0.3

    # Escape closes the menu and nothing else.
    selection = session.selection
    right_click(editor, roof(editor))
    item(editor, "Delete").wait_for()
    page.keyboard.press("Escape")
    item(editor, "Delete").wait_for(state="hidden")
    assert session.selection == (focal,) != selection

    # A right drag pans and opens nothing.
    start = editor.pixel(ahead(editor, 25.0))
    view = np.array(editor.client.camera.position)
    page.mouse.move(*start)
    page.mouse.down(button="right")
    for step in range(1, 8):
        page.mouse.move(start[0] + 8 * step, start[1])
        page.wait_for_timeout(25)
    page.mouse.up(button="right")
    editor.until(
        lambda: not np.allclose(editor.client.camera.position, view, atol=0.1), "a pan"
    )
    expect(item(editor, "Delete")).to_be_hidden()


def test_selecting_all_the_others_and_the_same_kind(editor):
    """(D34)"""
    session = editor.session
    agents = session.scenario.agents
    present = set(np.array(agents.ids)[agents.is_valid[:, 49]])
    editor.key("Control+a")
    editor.until(lambda: set(session.selection) == present, "all")
    assert editor.page.evaluate("getSelection().toString()") == ""
    editor.key("Escape")
    editor.click_at(roof(editor))
    focal = session.scenario.focal_id
    editor.until(lambda: session.selection == (focal,), "the focal agent")
    editor.key("Control+i")
    editor.until(lambda: set(session.selection) == present - {focal}, "the others")
    right_click(editor, roof(editor))
    item(editor, "Select all of this kind").click()
    kind = agents.kinds[agents.row_of[focal]]
    editor.until(
        lambda: (
            {agents.kinds[agents.row_of[a]] for a in session.selection} == {kind}
            and focal in session.selection
        ),
        "the vehicles",
    )


def test_possible_trajectories_say_what_a_click_does(editor):
    session = editor.session
    right_click(editor, roof(editor))
    item(editor, "Possible trajectories").click()
    bar = editor.page.get_by_role("status", name="Mode")
    bar.get_by_text(
        f"Possible trajectories of vehicle {session.scenario.focal_id}"
    ).wait_for()
    editor.press("Done (Esc)")
    editor.until(lambda: editor.tab().elements.candidates.view.shown is None, "the end")
    bar.wait_for(state="hidden")


def test_bending_from_here_takes_the_clicked_place(editor):
    session = editor.session
    point = ahead(editor, 18.0)
    right_click(editor, point)
    item(editor, "Bend the road from here").click()
    editor.open_tab("Road")
    anchor = editor.until(lambda: editor.node("/warp_anchor"), "an anchor")
    assert np.hypot(*(anchor.position[:2] - point)) < 0.3
    assert not session.entries
