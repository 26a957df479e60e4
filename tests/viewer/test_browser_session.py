"""The whole tab without a browser: panels, pointer, views and session together."""

import time

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    AddGuidance,
    DeleteAgents,
    PlaceAgent,
    RegeneratedEdit,
    RemoveAllAgents,
    SetAgentSpeed,
    SetFocalAgent,
    TransformAgents,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.viewer.tab import ui_context as ui_module
from tests.builders import two_agents_that_pass
from tests.viewer.agents.drag_by_hand import DragByHand
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until

SIZE = "Length, width (m)"
UPLOAD = "Upload files"


@pytest.fixture
def folder(tmp_path):
    out = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), out, forbidden=None)
    return out


@pytest.fixture
def app(tmp_path, folder):
    with running_app(tmp_path / "library", str(folder)) as running:
        yield running


@pytest.fixture
def tab(app):
    with connected_tab(app) as opened:
        opened.run(opened.elements.timeline.go_to_current)
        yield opened


def labels(tab: FakeTab) -> list[str]:
    return [entry.label for entry in tab.session.entries]


def test_reactions_to_edits_run_no_network_here(tab):
    """(W10) Live is on by default, and guided agents react to every gesture."""
    first, second = tab.session.scenario.agents.ids
    goal = AddGuidance(term=GoalPoint(agent_id=first, point_m=(0.0, 0.0)))
    tab.run(lambda: tab.ui.apply(goal))
    move = TransformAgents(agent_ids=(second,), dx_m=1.0)
    tab.run(lambda: tab.ui.preview("drag 1", move))
    tab.run(tab.ui.end_gesture)
    until(lambda: len(labels(tab)) == 2 and tab.ui.gesture is None)
    tab.run(lambda: None)
    command = tab.session.entries[1].command
    assert isinstance(command, RegeneratedEdit)
    assert command.traffic.generator == "drift"


def test_a_slider_movement_is_one_undo_step_and_reset_is_exact(tab, monkeypatch):
    opened = tab.session.scenario
    # However slow the machine is, only the last rest is long enough.
    for power, pause_s in ((1.0, 60.0), (2.5, 60.0), (4.0, 0.1)):
        monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", pause_s)
        assert not labels(tab)
        tab.type("S-bend", power)
        assert tab.session.scenario.applied_warp is not None
    until(lambda: labels(tab))
    tab.run(lambda: None)
    assert labels(tab) == ["Bend the road: S-bend +4"]
    assert "Friction-limited speed" in tab.text()
    tab.press("Reset road")
    assert tab.session.scenario.road_map is opened.road_map
    assert tab.field("S-bend").value == 0
    tab.hear("toolbar", kind="press", icon="undo")
    assert tab.field("S-bend").value == 4


def test_the_map_nodes_follow_the_warp(tab):
    before = tab.node("/map/lanes").glb_data
    assert not tab.is_drawn("/map_ghost")
    tab.type("Bend", 5.0)
    assert tab.node("/map/lanes").glb_data != before
    assert tab.is_drawn("/map_ghost")
    tab.press("Reset road")
    assert tab.node("/map/lanes").glb_data == before
    assert not tab.is_drawn("/map_ghost")


def drag(tab: FakeTab, agent_id: str, end: tuple[float, float], rotates: bool = False):
    """A whole drag as viser reports it."""
    agents = tab.session.scenario.agents
    row = agents.row_of[agent_id]
    x, y = agents.position_m[row, 49]
    pointer = DragByHand(tab, agent_id, rotates=rotates)
    pointer.say("start", (x, y))
    pointer.say("update", (x + 1, y))
    pointer.say("update", end)
    pointer.say("end", end)


def test_a_drag_moves_the_agent_and_is_one_undo_step(tab):
    opened = tab.session.scenario
    agent_id = opened.agents.ids[1]
    x, y = opened.agents.position_m[1, 49]
    drag(tab, agent_id, (x + 7.0, y - 2.0))
    assert tab.session.selection == (agent_id,)
    assert labels(tab) == [f"Move agent {agent_id} by 7.3 m"]
    moved = tab.session.scenario.agents.position_m[1]
    assert np.allclose(moved - opened.agents.position_m[1], [7.0, -2.0], atol=1e-3)
    tab.run(tab.elements.history.undo)
    assert tab.session.scenario is opened


def test_a_drag_ends_when_its_agent_goes(tab):
    agent_id = tab.session.scenario.agents.ids[1]
    x, y = tab.session.scenario.agents.position_m[1, 49]
    pointer = DragByHand(tab, agent_id)
    pointer.say("start", (x, y))
    tab.run(lambda: tab.ui.apply(DeleteAgents(agent_ids=(agent_id,))))
    for phase in ("update", "end"):
        pointer.say(phase, (x + 3.0, y))
    assert labels(tab) == [f"Delete agent {agent_id}"]


def test_overlaps_that_edits_cause_are_told_and_marked(tab):
    first, second = tab.session.scenario.agents.ids
    x, y = tab.session.scenario.agents.position_m[0, 49]
    drag(tab, second, (x + 1.0, y))
    assert tab.model.findings.agents_at(tab.session.scenario.current_step) == {
        first,
        second,
    }
    (problem,) = tab.model.findings.new
    assert "collide" in problem.message


def test_clicks_select_toggle_and_clear(tab):
    agents = tab.session.scenario.agents
    first, second = agents.position_m[:, 49]
    # A click on an agent also arrives for the scene, and must not clear the selection.
    tab.click(first, on=agents.ids[0])
    assert tab.session.selection == agents.ids[:1]
    tab.click(second, on=agents.ids[1], modifier="shift")
    assert tab.session.selection == agents.ids
    tab.click(second, on=agents.ids[1], modifier="shift")
    assert tab.session.selection == agents.ids[:1]
    tab.click((first[0], first[1] + 30.0))
    assert tab.session.selection == ()


def test_placing_takes_the_lanes_heading_and_speed(tab):
    tab.press("Place on road")
    x, y = tab.session.scenario.agents.position_m[0, 49]
    tab.click((x + 20.0, y + 0.4))
    agents = tab.session.scenario.agents
    row = agents.row_of[tab.session.selection[0]]
    assert agents.heading_rad[row, 49] == pytest.approx(0.0, abs=1e-6)
    # The other agent on that lane drives at 10 m/s.
    assert np.hypot(*agents.velocity_mps[row, 49]) == pytest.approx(10.0, abs=0.1)


def test_deleting_the_focal_agent_is_refused_in_words_and_changes_nothing(tab):
    opened = tab.session.scenario
    tab.run(lambda: tab.session.select((opened.focal_id,)))
    with pytest.raises(EditError, match="focal"):
        tab.run(tab.elements.agent.delete)
    assert tab.session.scenario is opened


def test_a_new_focal_agent_is_told_with_what_became_of_the_former_one(tab, monkeypatch):
    """On a cleared road there is no former one: "Agent - was removed." was told."""
    told = []
    monkeypatch.setattr(tab.ui, "notify", lambda *notice: told.append(notice))
    cleared = RemoveAllAgents()
    tab.run(lambda: tab.ui.apply(cleared))
    assert told[-1][0] == "No focal agent"
    told.clear()
    place = PlaceAgent(
        agent_id="new",
        kind=AgentKind.VEHICLE,
        x_m=0.0,
        y_m=0.0,
        heading_rad=0.0,
        speed_mps=5.0,
    )
    tab.run(lambda: tab.ui.apply(place))
    assert tab.session.scenario.focal_id == "new"
    assert ("Agent new is the focal agent now", "") in told


def test_regenerate_applies_a_result_and_a_stale_one_is_only_offered(tab):
    panel = tab.elements.generation
    tab.run(panel.regenerate)
    deadline = time.monotonic() + 60
    while not labels(tab) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert labels(tab)[0].startswith("Regenerate 2 agents")

    ids = tab.session.scenario.agents.ids

    def start_and_edit() -> None:
        panel.regenerate()
        tab.session.apply(SetAgentSpeed(agent_ids=ids[1:], speed_mps=2.0))

    tab.run(start_and_edit)
    deadline = time.monotonic() + 60
    while tab.model.is_running and time.monotonic() < deadline:
        time.sleep(0.05)
    tab.run(lambda: None)
    assert len(labels(tab)) == 2
    # (D12) It does not fit the new state, so using it goes back to its own.
    assert tab.model.run.action == "Go to its state, use result"
    tab.run(panel.result.use_result)
    assert [label.split(" (")[0] for label in labels(tab)] == [
        "Regenerate 2 agents",
        "Regenerate 2 agents",
    ]
    assert tab.model.run is None


def test_an_offered_result_that_still_fits_is_applied(tab):
    panel, ids = tab.elements.generation, tab.session.scenario.agents.ids

    def start_and_edit() -> None:
        panel.regenerate()
        tab.session.apply(SetFocalAgent(agent_id=ids[1]))

    tab.run(start_and_edit)
    deadline = time.monotonic() + 60
    while tab.model.is_running and time.monotonic() < deadline:
        time.sleep(0.05)
    tab.run(lambda: None)
    assert tab.model.run.action == "Use result"
    tab.run(panel.result.use_result)
    assert len(labels(tab)) == 2


def test_a_gesture_under_way_survives_an_error_and_a_reload(app):
    with connected_tab(app) as tab:
        session = tab.session
        tab.type("Bend", 3.0)
        with pytest.raises(EditError):
            tab.run(tab.elements.agent.snap)
        assert session.scenario.applied_warp is not None
    assert [entry.label for entry in session.entries] == ["Bend the road: bend +3"]
    assert len(session.recipe().commands) == 1


def test_cancel_changes_nothing(tab):
    panel, opened = tab.elements.generation, tab.session.scenario

    def start_and_cancel() -> None:
        panel.regenerate()
        panel.result.cancel()

    tab.run(start_and_cancel)
    time.sleep(0.3)
    tab.run(lambda: None)
    assert tab.session.scenario is opened
    assert not tab.model.is_running


def test_two_tabs_have_sessions_of_their_own(app):
    with connected_tab(app) as one, connected_tab(app) as two:
        assert one.session is not two.session
        victim = one.session.scenario.agents.ids[1]
        one.run(lambda: one.session.apply(DeleteAgents(agent_ids=(victim,))))
        assert len(one.session.scenario.agents) == 1
        assert len(two.session.scenario.agents) == 2


def test_agents_come_and_go_in_the_picture(tab):
    victim = tab.session.scenario.agents.ids[1]
    tab.run(lambda: tab.session.apply(DeleteAgents(agent_ids=(victim,))))
    nodes = [tab.node(f"/agents/vehicle/{part}") for part in ("body", "dark")]
    assert [len(node.batched_positions) for node in nodes] == [1, 1]
    tab.hear("toolbar", kind="press", icon="undo")
    assert [len(node.batched_positions) for node in nodes] == [2, 2]
    assert [len(node.batched_scales) for node in nodes] == [2, 2]


def test_an_upload_of_another_kind_of_file_is_refused(tab):
    tab.upload(UPLOAD, "notes.txt", b"hello")
    until(lambda: tab.notices)
    title, text = tab.notices[-1]
    assert title == "Not opened: notes.txt"
    assert text.startswith("notes.txt: expected a .zip")


def test_an_upload_over_the_limit_is_refused_before_it_is_taken_in(tab):
    tab.upload(UPLOAD, "huge.zip", b"", size_bytes=10**9)
    until(lambda: tab.notices)
    assert tab.refusal() == "huge.zip has 954 MiB; at most 64 MiB are taken."


def test_the_page_may_ask_for_a_theme_and_keeps_a_choice(tab):
    box = tab.field("Dark theme")
    tab.hear("theme", isDark=True)
    assert tab.tab.workspace.is_dark
    assert box.value
    assert tab.shown("theme") is None
    tab.enter(box, False)
    assert not tab.tab.workspace.is_dark
    assert tab.shown("theme") == {"isDark": False}


def test_a_scene_plays_as_soon_as_the_page_can_draw(tab):
    """It played before, and a slow page had thousands of frames to catch up with."""
    playback = tab.tab.workspace.playback
    assert not playback.is_playing
    tab.hear("page", kind="ready")
    assert playback.is_playing


def test_themes_layers_and_views_switch(tab):
    tab.type("Dark theme", True)
    assert tab.tab.workspace.is_dark
    assert tab.is_drawn("/map/markings")
    tab.type("Lane marks", False)
    assert not tab.is_drawn("/map/markings")
    tab.run(tab.elements.viewpoint.switch)
    assert tab.ui.client.camera.fov < 0.2
    tab.run(tab.elements.viewpoint.switch)
    assert tab.ui.client.camera.fov > 0.5


def test_switching_views_there_and_back_looks_at_the_same_place(tab):
    before = np.array(tab.ui.client.camera.look_at)
    for _ in range(2):
        tab.run(tab.elements.viewpoint.switch)
    assert np.allclose(tab.ui.client.camera.look_at, before)


def test_inputs_of_a_refused_edit_return_to_the_agents_values(tab, monkeypatch):
    monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", 0.1)
    tab.run(lambda: tab.session.select((tab.session.scenario.focal_id,)))
    shown = tab.field(SIZE).value
    tab.type(SIZE, (-4.0, 2.0))
    assert tab.refusal().startswith("Size")
    until(lambda: tab.field(SIZE).value == shown)
    assert not labels(tab)


def test_nothing_of_a_refused_number_stays(tab, monkeypatch):
    """Of 45 m, which is too long for a car, 4 m stayed as an edit."""
    monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", 60.0)
    before = tab.session.scenario
    tab.run(lambda: tab.session.select((before.focal_id,)))
    shown = tab.field(SIZE).value
    tab.type(SIZE, (4.0, 1.9))
    assert not tab.notices
    tab.type(SIZE, (45.0, 1.9))
    assert tab.refusal().startswith("Size")
    # The field is left alone while the number may go on.
    assert tab.field(SIZE).value == (45.0, 1.9)
    assert tab.session.scenario is before
    tab.type(SIZE, (4.5, 1.9))
    assert tab.session.scenario.agents.size_m[0, 0] == 4.5
    tab.type(SIZE, (450.0, 1.9))
    assert tab.refusal().startswith("Size")
    monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", 0.0)
    tab.type(SIZE, (4500.0, 1.9))
    assert tab.refusal().startswith("Size")
    until(lambda: tab.field(SIZE).value == shown)
    assert tab.session.scenario is before
    assert not labels(tab)


def test_reset_forgets_the_shape_and_friction_and_undo_brings_them_back(tab):
    values = {"Waves": 3.0, "Starts after (m)": 20.0, "Friction": 0.3}
    for label, value in {**values, "Slow agents to the friction limit": True}.items():
        tab.type(label, value)
    tab.press("Reset road")
    assert not tab.field("Slow agents to the friction limit").value
    assert [tab.field(label).value for label in values] == [0.0, 5.0, 0.7]
    tab.hear("toolbar", kind="press", icon="undo")
    assert tab.field("Slow agents to the friction limit").value
    assert {label: tab.field(label).value for label in values} == values


def test_a_refused_anchor_leaves_the_one_in_force_chosen(tab):
    tab.run(lambda: tab.session.select(tab.session.scenario.agents.ids[:1]))

    def deselect_while_it_is_chosen() -> None:
        until(lambda: tab.field("Anchor").value == "Selected agent")
        tab.session.select(())

    tab.ui.post(deselect_while_it_is_chosen)
    tab.type("Anchor", "Selected agent")
    assert tab.refusal().startswith("Select the one agent")
    assert tab.field("Anchor").value == "Focal agent"


def test_an_absurd_drag_of_the_anchor_is_refused_and_over(tab):
    tab.type("Bend", 3.0)
    tab.type("Anchor", "A point that I drag")
    drag_anchor(tab, 3.0, 1.0)
    before = tab.session.scenario
    drag_anchor(tab, 1e9, 1.0)
    assert tab.refusal().startswith("Anchor x is 1e+09 m")
    assert tab.ui.gesture is None
    assert tab.session.scenario is before
    assert tuple(tab.node("/warp_anchor").position[:2]) == (3.0, 1.0)


def drag_anchor(tab: FakeTab, x_m: float, y_m: float) -> None:
    """A whole drag of the anchor's gizmo."""
    gizmo = {"name": "/warp_anchor", "owner": str(tab.ui.client.client_id)}
    pose = {"position": (x_m, y_m, 0.3), "wxyz": (1.0, 0.0, 0.0, 0.0)}
    tab.send({"type": "TransformControlsDragStartMessage", **gizmo})
    tab.send({"type": "TransformControlsUpdateMessage", **gizmo, **pose})
    tab.send({"type": "TransformControlsDragEndMessage", **gizmo})


def test_undo_and_redo_choose_the_anchor_in_force(tab):
    tab.type("S-bend", 3.0)
    tab.type("Anchor", "A point that I drag")
    drag_anchor(tab, 3.0, 1.0)
    drag_anchor(tab, 6.0, 1.0)
    assert tuple(tab.node("/warp_anchor").position[:2]) == (6.0, 1.0)
    tab.hear("toolbar", kind="press", icon="undo")
    assert tuple(tab.node("/warp_anchor").position[:2]) == (3.0, 1.0)
    tab.type("Anchor", "Focal agent")
    tab.hear("toolbar", kind="press", icon="undo")
    assert tab.field("Anchor").value == "A point that I drag"
    anchor = tab.session.scenario.applied_warp.warp.anchor
    assert (anchor.x_m, anchor.y_m) == (3.0, 1.0)
    assert tuple(tab.node("/warp_anchor").position[:2]) == (3.0, 1.0)
    tab.hear("toolbar", kind="press", icon="redo")
    assert tab.field("Anchor").value == "Focal agent"
    assert not tab.is_drawn("/warp_anchor")


def test_nothing_to_undo_or_redo_is_no_error(tab):
    tab.run(tab.elements.history.undo)
    tab.run(tab.elements.history.redo)
    assert not labels(tab)
