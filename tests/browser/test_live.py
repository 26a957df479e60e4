"""Live traffic in a real browser: it reacts while the mouse drags an agent or a slider."""

import numpy as np
import pytest

from pd_editor.editor.commands import RegeneratedEdit, SetRoadWarp, TransformAgents
from pd_editor.scene.scenario import Scenario

pytestmark = [pytest.mark.browser, pytest.mark.slow]


@pytest.fixture
def editor(open_editor):
    """The demo at t = 0 with generated traffic."""
    page = open_editor()
    page.go_to_now()
    page.until(lambda: not page.workspace.playback.is_playing, "a pause")
    page.key("r")
    page.until(lambda: is_done(page.session, 1), "generated traffic", 120)
    return page


class Seen:
    """Every scenario that the session has shown, with whether it was a preview."""

    def __init__(self, session) -> None:
        self.shown: list[tuple[Scenario, bool]] = []
        session.add_listener(self._changed)

    def _changed(self, _before, after) -> None:
        self.shown.append((after.scenario, after.is_previewing))

    def num_regenerated(self, agent_ids: tuple[str, ...]) -> int:
        """Number of different previews of the future of agents that are not dragged."""
        ends = [
            scenario.agents.position_m[scenario.agents.rows(agent_ids), -1].tobytes()
            for scenario, is_previewing in self.shown
            if is_previewing
        ]
        return len(set(ends))


def mover(editor) -> str:
    """The moving vehicle nearest to the middle of the picture."""
    scenario = editor.session.scenario
    agents, now = scenario.agents, scenario.current_step
    center = agents.position_m[agents.row_of[scenario.focal_id], now]
    fits = (np.array(agents.kinds) == "vehicle") & agents.is_valid[:, now]
    rows = np.flatnonzero(fits & (agents.speed_mps()[:, now] > 3))
    away = np.linalg.norm(agents.position_m[rows, now] - center, axis=-1)
    return agents.ids[rows[away.argmin()]]


def place_of(editor, agent_id: str) -> np.ndarray:
    agents = editor.session.scenario.agents
    now = editor.session.scenario.current_step
    return np.append(agents.position_m[agents.row_of[agent_id], now], 1.4)


def is_done(session, count: int) -> bool:
    """Whether the session shows the result of its last of so many entries."""
    entries = session.entries
    if len(entries) != count or entries[-1].after is None:
        return False
    # An entry is pushed before its scenario is shown.
    return session.scenario is entries[-1].after.scenario


def test_traffic_reacts_while_an_agent_is_dragged_and_one_undo_takes_all_back(editor):
    session = editor.session
    dragged = mover(editor)
    others = tuple(n for n in session.entries[0].command.sample.ids if n != dragged)
    before, seen = session.scenario, Seen(session)
    start = place_of(editor, dragged)
    editor.drag(start, start + np.array([6.0, 3.0, 0.0]))
    editor.until(lambda: is_done(session, 2), "one entry")
    assert seen.num_regenerated(others) > 3, "previews came before the release"
    entry = session.entries[1]
    assert isinstance(entry.command, RegeneratedEdit)
    assert isinstance(entry.command.edit, TransformAgents)
    assert set(entry.command.traffic.sample.ids) == {*others, dragged}
    now = before.current_step
    row = before.agents.row_of[dragged]
    shift = session.scenario.agents.position_m[row] - before.agents.position_m[row]
    assert np.allclose(shift[now], [6, 3], atol=0.3)
    editor.screenshot("live_after_a_drag")
    editor.key("Control+z")
    editor.until(lambda: session.scenario is before, "undo of everything")

    # Escape takes back the drag and what it made other agents do.
    x, y = editor.pixel(place_of(editor, dragged))
    seen.shown.clear()
    editor.page.mouse.move(x, y)
    editor.page.wait_for_timeout(100)
    editor.page.mouse.down()
    for step in range(1, 16):
        editor.page.mouse.move(x + 4 * step, y + 2 * step)
        editor.page.wait_for_timeout(25)
    editor.until(lambda: seen.num_regenerated(others) > 1, "live previews")
    editor.key("Escape")
    editor.until(lambda: session.scenario is before, "the scenario before the drag")
    editor.page.mouse.up()
    editor.page.wait_for_timeout(500)
    assert session.scenario is before
    assert len(session.entries) == 2, "the undone entry only"

    # Switched off, the same drag carries the one agent and makes a plain entry.
    editor.key("Shift+R")
    editor.until(lambda: not editor.workspace.view.is_live, "live is off")
    seen.shown.clear()
    start = place_of(editor, dragged)
    editor.drag(start, start + np.array([6.0, 3.0, 0.0]))
    editor.until(lambda: is_done(session, 2), "one entry")
    assert isinstance(session.entries[1].command, TransformAgents)
    assert seen.num_regenerated(others) == 1
    editor.page.get_by_role("button", name="Live: traffic reacts").click()
    editor.until(lambda: editor.workspace.view.is_live, "live is on again")


def test_traffic_reacts_while_a_warp_slider_is_dragged(editor):
    session = editor.session
    before, seen = session.scenario, Seen(session)
    ids = session.entries[0].command.sample.ids
    editor.open_tab("Road")
    slider = editor.row("Bend").get_by_role("slider")
    box = slider.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    editor.page.mouse.move(x, y)
    editor.page.mouse.down()
    for step in range(1, 13):
        editor.page.mouse.move(x + 2 * step, y)
        editor.page.wait_for_timeout(60)
    editor.until(lambda: seen.num_regenerated(ids) > 3, "live previews")
    assert len(session.entries) == 1, "nothing in the history before the release"
    editor.page.mouse.up()
    editor.until(lambda: is_done(session, 2), "one entry")
    entry = session.entries[1]
    assert isinstance(entry.command, RegeneratedEdit)
    assert isinstance(entry.command.edit, SetRoadWarp)
    assert session.scenario.applied_warp is not None
    editor.screenshot("live_after_a_warp")
    editor.key("Control+z")
    editor.until(lambda: session.scenario is before, "undo of everything")
