"""What stands on and over the picture, seen and used as a person would."""

import numpy as np
import pytest
from playwright.sync_api import expect

from pd_editor.editor.commands import SetLocks, SetRoadWarp, TransformAgents
from pd_editor.scene.locks import Lock
from pd_editor.scene.palette import DARK, LIGHT
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    """The signalised junction at t = 0, from above."""
    page = open_editor()
    page.until(lambda: page.workspace.playback.is_playing, "the demo to play")
    page.go_to_now()
    page.close_notifications()
    page.look_from_above()
    page.settle()
    return page


def box_of(locator) -> tuple[float, float, float, float]:
    """Left, top, right, bottom on the page."""
    box = locator.bounding_box()
    return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]


def agent_box(editor, agent_id: str) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of an agent at t = 0 on the page."""
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    row = agents.row_of[agent_id]
    heading = agents.heading_rad[row, step]
    ahead = np.array([np.cos(heading), np.sin(heading)]) * agents.size_m[row, 0] / 2
    left = np.array([-np.sin(heading), np.cos(heading)]) * agents.size_m[row, 1] / 2
    corners = [
        editor.pixel(agents.position_m[row, step] + along * ahead + aside * left)
        for along in (-1, 1)
        for aside in (-1, 1)
    ]
    (x, y), (right, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
    return float(x), float(y), float(right), float(bottom)


def test_the_label_of_a_selected_agent_stands_beside_it(editor):
    """The label lay on the agent in the top view (D14)."""
    focal = editor.session.scenario.focal_id
    editor.click_at(centre(editor, focal))
    editor.until(lambda: editor.session.selection == (focal,), "the selection")
    label = editor.page.get_by_role("note").filter(has_text=focal)
    label.wait_for()
    editor.settle()
    left, top, right, bottom = box_of(label)
    x, y, x_end, y_end = agent_box(editor, focal)
    gap = max(left - x_end, x - right, top - y_end, y - bottom)
    assert 8 <= gap <= 60


def centre(editor, agent_id: str) -> np.ndarray:
    scenario = editor.session.scenario
    row = scenario.agents.row_of[agent_id]
    return scenario.agents.position_m[row, scenario.current_step]


def test_hovering_outlines_a_car_thinly(editor):
    """The outline of 10 px made a blob of a car in the top view (D14)."""
    editor.page.mouse.move(
        *editor.pixel(centre(editor, editor.session.scenario.focal_id))
    )
    thick = editor.until(
        lambda: editor.page.evaluate(OUTLINE_WIDTHS), "outlines of agents"
    )
    assert max(thick) <= 3


OUTLINE_WIDTHS = """
() => {
  const found = [];
  for (const [name, node] of Object.entries(__viserMutable.nodeRefFromName))
    if (name.startsWith("/agents/")) node?.traverse((part) => {
      const width = part.material?.uniforms?.thickness;
      if (width) found.push(width.value);
    });
  return found;
}
"""


def test_pedestrians_can_be_hit_from_far_above(editor):
    """A pedestrian was 5 px, and smaller from further away (D18)."""
    scenario = editor.session.scenario
    agents, step = scenario.agents, scenario.current_step
    camera = editor.client.camera
    height = camera.position[2]
    people = [
        row
        for row in np.flatnonzero(agents.is_valid[:, step])
        if agents.kinds[row] == "pedestrian"
    ]
    row = people[0]
    x, y = agents.position_m[row, step]
    with editor.client.atomic():
        camera.position = (x, y, 1.6 * height)
        camera.look_at = (x, y, 0.0)
    editor.until(
        lambda: editor.seen_camera.position[2] > 1.5 * height,
        "the camera's report",
    )
    editor.settle()
    at = editor.pixel((x, y))
    editor.page.mouse.click(at[0] + 2, at[1] + 2)
    others = {
        agents.ids[r]
        for r in people
        if np.hypot(*(agents.position_m[r, step] - (x, y))) < 4
    }
    editor.until(
        lambda: set(editor.session.selection) & others, "a pedestrian selected"
    )


def test_holding_o_shows_the_original(editor):
    """Outlines, dashed trajectories and the difference of the selected agent."""
    session, focal = editor.session, editor.session.scenario.focal_id
    x, y = centre(editor, focal)
    editor.select((focal,))
    editor.tab().ui.post(
        lambda: session.apply(
            TransformAgents(agent_ids=(focal,), dx_m=6.0, dy_m=0.0, rotation_rad=0.0)
        )
    )
    editor.until(lambda: session.entries, "the move")
    comparison = editor.tab().elements.picture.comparison
    editor.page.evaluate("document.activeElement?.blur()")
    editor.page.keyboard.down("o")
    editor.until(lambda: comparison.is_on, "the original")
    plate = editor.page.get_by_text("Original: 1 agent differs")
    plate.wait_for()
    note = editor.page.get_by_role("note").filter(
        has_text="now: 6.0 m from the original, as fast"
    )
    note.wait_for()
    editor.settle()
    outline = "__viserMutable.nodeRefFromName['/original/boxes']?.visible"
    editor.until(lambda: editor.page.evaluate(outline), "the outlines")
    boxes = editor.node("/original/boxes")
    assert np.allclose(boxes.batched_positions[0, :2], (x, y))
    editor.page.keyboard.up("o")
    editor.until(lambda: not comparison.is_on, "the end of it")
    plate.wait_for(state="hidden")
    editor.open_tab("View")
    editor.tick("Compare with the original")
    editor.until(lambda: comparison.is_on, "the original for longer")


def test_the_sheet_lists_every_registered_key_and_escape_only_closes_it(editor):
    """`?` did nothing (D34)."""
    session = editor.session
    editor.select((session.scenario.focal_id,))
    sheet = editor.page.get_by_role("dialog", name="Keys and mouse")
    editor.page.set_viewport_size({"width": 1280, "height": 720})
    editor.tab().ui.notify("A notice", "It stays.", stays=True)
    notice = editor.page.get_by_text("It stays.")
    notice.wait_for()
    editor.key("?")
    sheet.wait_for()
    # It was one long column, half of it out of sight, below notices.
    assert sheet.evaluate("one => one.scrollHeight <= one.clientHeight")
    expect(notice).to_be_hidden()
    text = sheet.inner_text()
    missing = [
        hotkey.label
        for hotkey in editor.tab().ui.hotkeys
        if hotkey.key and hotkey.label.split(" (")[0] not in text
    ]
    assert not missing
    assert "Shift+drag an agent" in text
    editor.page.keyboard.press("r")
    editor.page.keyboard.press("Escape")
    sheet.wait_for(state="hidden")
    assert session.selection
    assert not session.entries
    editor.page.get_by_role("button", name="Keys and mouse").click()
    sheet.wait_for()
    editor.page.keyboard.press("F1")
    sheet.wait_for(state="hidden")


def test_the_legend_has_the_colours_of_the_theme_and_stays_folded(editor):
    def colors() -> dict[str, str]:
        return dict(
            editor.page.evaluate(
                "[...document.querySelectorAll('.pd-legend-list li')].map(item =>"
                " [item.innerText, item.firstChild.style.color])"
            )
        )

    light = colors()
    assert light["Focal agent"] == f"rgb{LIGHT.focal}"
    assert light["Problem"] == f"rgb{LIGHT.warning}"
    editor.open_tab("View")
    editor.tick("Dark theme")
    editor.until(lambda: colors()["Focal agent"] == f"rgb{DARK.focal}", "dark colours")
    chip = editor.page.get_by_role("button", name="Legend", exact=True)
    chip.click()
    expect(chip).to_have_attribute("aria-expanded", "false")
    editor.reload()
    chip.wait_for()
    expect(chip).to_have_attribute("aria-expanded", "false")


def test_the_legend_tells_of_padlocks_and_of_the_original_road_while_it_is_drawn(
    editor,
):
    session, page, ui = editor.session, editor.page, editor.tab().ui
    legend = page.locator("#pd-legend-list")
    expect(legend).not_to_contain_text("Original")
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=30.0)
    warp = RoadWarp(anchor=pose_of_anchor(session.scenario, "focal"), terms=(term,))
    ui.post(lambda: ui.apply(SetRoadWarp(warp=warp)))
    row = legend.get_by_role("listitem").filter(has_text="Original road")
    expect(row.locator(".pd-legend-line")).to_be_visible()
    editor.open_tab("Road")
    editor.tick("Show the original road")
    expect(row).to_have_count(0)
    lock = SetLocks(agent_ids=(session.scenario.focal_id,), lock=Lock(kept_s=2.0))
    ui.post(lambda: ui.apply(lock))
    locked = legend.get_by_role("listitem").filter(has_text="Locked beginning")
    expect(locked.locator("svg path")).to_be_visible()
    hint = page.get_by_role("status", name="Hint")
    box = page.locator(".pd-legend-box.pd-solid")
    assert box_of(hint)[3] < box_of(box)[1]
    editor.screenshot("legend")


def test_hints_leave_one_by_one_and_do_not_come_back(editor):
    session, page = editor.session, editor.page
    card = page.get_by_role("status", name="Hint")
    card.filter(has_text="Click a car").wait_for()
    legend = page.locator(".pd-legend-box.pd-solid")
    _, top, _, bottom = box_of(card)
    assert bottom - top < 60  # Two lines at most, where the picture is narrow.
    assert box_of(legend)[0] < 40
    assert bottom < box_of(legend)[1]
    editor.click_at(centre(editor, session.scenario.focal_id))
    card.filter(has_text="Drag it").wait_for()
    editor.reload()
    card.filter(has_text="Drag it").wait_for()
    page.get_by_role("button", name="Close the hints").click()
    card.wait_for(state="hidden")
    editor.reload()
    page.get_by_role("button", name="Legend", exact=True).wait_for()
    expect(card).to_be_hidden()
