"""What stands on and over the picture, seen and used as a person would."""

import numpy as np
import pytest

pytestmark = pytest.mark.browser


@pytest.fixture
def editor(open_editor):
    """The signalised junction at t = 0, from above."""
    page = open_editor()
    page.until(lambda: page.workspace.playback.is_playing, "the demo to play")
    page.go_to_now()
    page.close_notifications()
    page.key("v")
    page.until(lambda: page._tab()._view.is_from_above, "the top view")
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
        lambda: editor._tab()._view.distance_m > 1.5 * height, "the camera's report"
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
