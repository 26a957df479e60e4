"""The road panel: shape that follows undo, anchors that can be, agents slowed."""

import time

import numpy as np
import pytest

from pd_editor.analysis.findings.check import scene_problems
from pd_editor.editor.commands import SetAgentSpeed, TransformAgents
from pd_editor.editor.cures import cures
from pd_editor.scene.perturbation.friction import SlowedAgent
from pd_editor.scene.scenario import EGO_ID
from pd_editor.viewer.road.road_panel import (
    EGO,
    FOCAL,
    POINT,
    SELECTED,
    slowed_in_words,
)
from pd_editor.viewer.tab import ui_context as ui_module
from tests.viewer.fake_browser import FakeTab, until


@pytest.fixture
def panel(tab: FakeTab):
    return tab.elements.road


def bend(tab: FakeTab, power: float = 4.0, length_m: float | None = None):
    tab.type("Waves", power)
    if length_m is not None:
        tab.type("Wave length (m)", length_m)
    tab.run(tab.ui.commit_gesture)
    tab.run(tab.model.shown.emit)


def test_shape_follows_undo_and_redo(tab: FakeTab, panel):
    """(D27)"""
    length = tab.field("Wave length (m)")
    bend(tab)
    bend(tab, length_m=5.0)
    history = tab.elements.history
    tab.run(history.undo)
    assert length.value == 60.0
    tab.run(history.undo)
    assert (tab.field("Waves").value, length.value) == (0.0, 60.0)
    tab.run(history.redo)
    tab.run(history.redo)
    assert length.value == 5.0
    tab.run(history.undo)
    tab.run(history.undo)
    assert length.value == 60.0


def test_a_slider_that_rests_while_it_is_held_makes_one_edit(
    tab: FakeTab, panel, monkeypatch
):
    """A rest of a second within one drag made two; a drag of its own is one of its own."""
    session = tab.session
    num_edits = len(session.entries)
    monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", 0.1)
    monkeypatch.setattr(ui_module, "LAST_VALUE_S", 60.0)

    def slide(value: float) -> None:
        tab.type("Waves", value)

    tab.hear("panel", kind="hold")
    slide(2.0)
    time.sleep(0.8)
    slide(3.0)
    tab.hear("panel", kind="release")
    assert len(session.entries) == num_edits
    # The browser may send the last value after it has told of the end.
    slide(4.0)
    until(lambda: len(session.entries) > num_edits)
    assert len(session.entries) == num_edits + 1
    assert session.scenario.applied_warp.warp.terms[0].power == 4.0

    # The next drag ends the former gesture, however soon it comes.
    monkeypatch.setattr(ui_module, "GESTURE_PAUSE_S", 60.0)
    slide(5.0)
    tab.hear("panel", kind="hold")
    assert len(session.entries) == num_edits + 2
    slide(6.0)
    monkeypatch.setattr(ui_module, "LAST_VALUE_S", 0.1)
    tab.hear("panel", kind="release")
    until(lambda: len(session.entries) == num_edits + 3)


def test_shape_does_not_leak_into_another_scenario(tab: FakeTab, panel):
    """(D27)"""
    tab.type("Wave length (m)", 5.0)
    tab.run(tab.ui.commit_gesture)
    # A shape that waits for a bend outlives a selection ...
    tab.run(lambda: tab.session.select(tab.session.scenario.agents.ids[:1]))
    assert tab.field("Wave length (m)").value == 5.0
    # ... but not another scenario.
    tab.run(lambda: tab.tab.workspace.open_reference("merge"))
    assert tab.field("Wave length (m)").value == 60.0


def test_resets_are_offered_whenever_anything_differs(tab: FakeTab, panel):
    """(D27)"""
    tab.run(tab.model.shown.emit)
    assert tab.field("Reset road").disabled
    assert tab.field("Reset shape").disabled
    tab.type("Wave length (m)", 5.0)
    assert not tab.field("Reset road").disabled
    assert not tab.field("Reset shape").disabled
    tab.run(panel.reset_shape)
    assert tab.field("Wave length (m)").value == 60.0
    assert tab.field("Reset road").disabled
    bend(tab, length_m=7.0)
    tab.run(panel.reset_shape)
    (term,) = tab.session.scenario.applied_warp.warp.terms
    assert (term.power, term.length_m) == (4.0, 60.0)
    tab.run(panel.reset)
    assert tab.session.scenario.applied_warp is None
    assert tab.field("Reset road").disabled


def test_only_anchors_that_can_be_are_offered(tab: FakeTab, panel):
    """(D29)"""
    agents = tab.session.scenario.agents
    tab.run(lambda: tab.session.select(()))
    tab.run(tab.model.shown.emit)
    assert tab.field("Anchor").options == (FOCAL, POINT)
    assert EGO_ID not in agents.row_of
    assert "ego (there is none)" in tab.text()
    assert "selected agent (select one)" in tab.text()
    tab.run(lambda: tab.session.select(agents.ids[1:]))
    assert tab.field("Anchor").options == (FOCAL, SELECTED, POINT)
    tab.type("Anchor", SELECTED)
    x, y = agents.position_m[1, tab.session.scenario.current_step]
    assert tab.field("Anchor at (m)").value == (round(float(x), 1), round(float(y), 1))
    assert tab.is_drawn("/warp_start")
    # What is chosen goes with the selection while nothing is bent.
    tab.run(lambda: tab.session.select(()))
    assert tab.field("Anchor").value == FOCAL
    assert EGO not in tab.field("Anchor").options


def test_the_mark_of_the_anchor_goes_with_the_bend(tab: FakeTab, panel):
    """(W18) It stayed on the road as recorded when the bend was undone."""
    bend(tab)
    tab.run(tab.ui.commit_gesture)
    assert tab.is_drawn("/warp_start")
    tab.run(tab.session.undo)
    assert not tab.is_drawn("/warp_start")


def test_an_agent_that_is_moved_leaves_the_anchor_behind(tab: FakeTab, panel):
    """The label said that the road still bends ahead of the focal agent."""
    bend(tab)
    assert tab.field("Anchor").value == FOCAL
    move = TransformAgents(agent_ids=(tab.session.scenario.focal_id,), dx_m=9.0)
    tab.run(lambda: tab.ui.apply(move))
    assert tab.field("Anchor").value == POINT


@pytest.mark.parametrize("is_bent", [False, True])
def test_an_absurd_anchor_is_refused_in_the_words_of_the_panel(
    tab: FakeTab, is_bent, monkeypatch
):
    told: list[str] = []
    if is_bent:
        bend(tab)
    shown = tab.field("Anchor at (m)").value
    monkeypatch.setattr(tab.ui, "notify", lambda _title, body, *_: told.append(body))
    tab.type("Anchor at (m)", (1e9, 3.0))
    assert told.pop().startswith("Anchor x is 1e+09 m; expected")
    tab.run(tab.model.shown.emit)
    assert tab.field("Anchor at (m)").value == shown
    # The heading is not refused for it.
    tab.type("Anchor heading (deg)", 30.0)
    assert tab.field("Anchor at (m)").value == shown
    tab.type("Anchor heading (deg)", 1e9)
    assert told.pop().startswith("Anchor heading is 1e+09 deg; expected")
    assert not told


def test_a_friction_that_no_road_has_is_not_taken(tab: FakeTab):
    """A number below zero, or the 0 that 0.4 begins with."""
    bend(tab)
    tab.type("Friction", 0.4)
    for value in (-1.0, 0.0):
        tab.type("Friction", value)
        assert "at friction 0.40" in tab.text()
    tab.type("Slow agents to the friction limit", True)
    assert tab.session.scenario.applied_warp.friction_coefficient == 0.4


def test_the_anchor_can_be_typed(tab: FakeTab, panel):
    """(D29)"""
    bend(tab)
    tab.type("Anchor at (m)", (12.0, 3.0))
    tab.type("Anchor heading (deg)", 30.0)
    tab.run(tab.ui.commit_gesture)
    anchor = tab.session.scenario.applied_warp.warp.anchor
    assert (anchor.x_m, anchor.y_m) == (12.0, 3.0)
    assert anchor.rotation_rad == pytest.approx(np.radians(30.0))
    assert tab.field("Anchor").value == POINT
    # 223.3 degrees were shown where -136.7 had been typed.
    tab.type("Anchor heading (deg)", 223.3)
    tab.run(tab.ui.commit_gesture)
    tab.run(tab.model.shown.emit)
    assert tab.field("Anchor heading (deg)").value == pytest.approx(-136.7)
    label = tab.session.entries[-2].label
    assert "anchor moved" in label
    assert "anchor turned" in label


def test_agents_that_friction_slows_are_named_with_their_speeds(tab: FakeTab, panel):
    """(D10)"""
    ids = tab.session.scenario.agents.ids
    tab.run(lambda: tab.ui.apply(SetAgentSpeed(agent_ids=ids, speed_mps=20.0)))
    tab.type("Bend", 10.0)
    tab.type("Slow agents to the friction limit", True)
    tab.run(tab.ui.commit_gesture)
    tab.run(tab.model.shown.emit)
    applied = tab.session.scenario.applied_warp
    now = tab.session.scenario.current_step
    text = tab.text()
    assert "slowed:" in text
    slowest = applied.warped_agents.speed_mps()[:, now:].min(axis=1)
    named = [row for row, name in enumerate(ids) if name in text]
    assert named
    assert all(slowest[row] < 20.0 for row in named)
    tab.run(panel.reset)
    assert "slowed" not in tab.text()


def test_a_repair_that_slows_agents_shows_in_the_setting(tab: FakeTab, panel):
    """The setting said that speeds stay as they are."""
    ids = tab.session.scenario.agents.ids
    tab.run(lambda: tab.ui.apply(SetAgentSpeed(agent_ids=ids, speed_mps=20.0)))
    tab.type("Bend", 10.0)
    tab.run(tab.ui.commit_gesture)
    problems = [p for p in scene_problems(tab.session.scenario) if p.kind == "friction"]
    assert len(problems) == 2
    offered = cures(tab.session.scenario, problems[0], problems)
    one, every = (cure for cure in offered if cure.label.endswith("to the limit"))
    assert every.label == "Slow all 2 to the limit"
    (slowed_id,) = problems[0].agent_ids
    tab.run(lambda: tab.ui.apply(one.command))
    assert tab.field("Slow agents to the friction limit").value is False
    assert f"Off; a repair has slowed {slowed_id} alone." in tab.text()
    tab.run(tab.session.undo)
    assert "slowed" not in tab.text()
    tab.run(lambda: tab.ui.apply(every.command))
    assert tab.field("Slow agents to the friction limit").value is True
    assert all(name in tab.text() for name in ids)
    assert not [p for p in scene_problems(tab.session.scenario) if p.kind == "friction"]


def test_words_about_slowed_agents_have_their_plural():
    one = SlowedAgent(agent_id="7", before_mps=12.5, after_mps=11.7, time_s=0.0)
    later = SlowedAgent(agent_id="8", before_mps=16.0, after_mps=5.9, time_s=2.3)
    assert slowed_in_words([one], most=3) == (
        "1 agent slowed:",
        "7 12.5 to 11.7 m/s at t = 0",
    )
    title, text = slowed_in_words([one, later, later], most=2)
    assert title == "3 agents slowed:"
    assert text.endswith("8 16.0 to 5.9 m/s at t = 2.3 s; 1 more")
