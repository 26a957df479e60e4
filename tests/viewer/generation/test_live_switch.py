"""Live regeneration in the whole tab, without a browser."""

import threading
from dataclasses import replace

import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.editor.commands import (
    AddGuidance,
    PullSpeed,
    RegeneratedEdit,
    SetAgentSpeed,
    SetLocks,
    TransformAgents,
)
from pd_editor.generation import generators as registry
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.generation import GeneratorSpec
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.viewer.generation.run_bar import (
    ALL,
    GENERATED,
    nearest_to_edit,
    retimed_ids,
)
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass
from tests.editor.fake_generators import DriftGenerator
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until


@pytest.fixture
def drift(monkeypatch) -> DriftGenerator:
    generator = DriftGenerator(num_steps=2)
    offers = {"drift": GeneratorSpec(make=lambda: generator, default_num_steps=4)}
    monkeypatch.setattr(registry, "GENERATORS", offers)
    return generator


@pytest.fixture
def app(tmp_path, drift):
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with running_app(tmp_path / "library", str(folder)) as running:
        yield running


@pytest.fixture
def tab(app):
    with connected_tab(app) as opened:
        opened.tab.workspace.playback.pause()
        yield opened


def reacting(tab: FakeTab) -> tuple[str, ...]:
    switch = tab.elements.generation.live_switch
    return tab.run(lambda: switch.reacting_ids(tab.session.scenario))


def choose(tab: FakeTab, scope: str) -> None:
    tab.type("React live", scope)


def move(tab: FakeTab, agent_id: str, dx_m: float) -> None:
    command = TransformAgents(agent_ids=(agent_id,), dx_m=dx_m)
    tab.run(lambda: tab.ui.preview("drag 1", command))


def generate(tab: FakeTab) -> None:
    position = tab.session.state.position
    tab.run(tab.elements.generation.regenerate)
    until(lambda: tab.session.state.position == position + 1)
    # The position changes before the scenario: wait for the end of the message.
    tab.run(lambda: None)


def test_recorded_agents_stay_unless_they_are_guided_or_all_shall_react(tab: FakeTab):
    first, second = tab.session.scenario.agents.ids
    assert reacting(tab) == ()
    goal = AddGuidance(term=GoalPoint(agent_id=first, point_m=(0.0, 0.0)))
    tab.run(lambda: tab.ui.apply(goal))
    assert reacting(tab) == (first,)
    choose(tab, ALL)
    assert reacting(tab) == (first, second)
    lock = SetLocks(agent_ids=(second,), lock=TRAJECTORY_LOCK)
    tab.run(lambda: tab.ui.apply(lock))
    assert reacting(tab) == (first,)
    choose(tab, GENERATED)
    tab.run(tab.session.undo)
    tab.run(tab.session.undo)
    generate(tab)
    assert reacting(tab) == (first, second)


def test_an_edit_of_guidance_is_about_the_agents_that_it_guides(tab: FakeTab):
    """A goal of one agent regenerated all generated ones."""
    generate(tab)
    first, second = tab.session.scenario.agents.ids
    switch = tab.elements.generation.live_switch

    def reacting_to(*terms: GuidanceTerm) -> tuple[str, ...]:
        edited = replace(tab.session.scenario, guidance=terms)
        return tab.run(lambda: switch.reacting_ids(edited))

    assert reacting_to(GoalPoint(agent_id=second, point_m=(0.0, 0.0))) == (second,)
    assert reacting_to(TargetSpeed(agent_ids=(), speed_mps=3.0)) == (first, second)
    choose(tab, ALL)
    goal = GoalPoint(agent_id=second, point_m=(0.0, 0.0))
    assert reacting_to(goal) == (first, second)


def test_a_gesture_becomes_one_entry_with_the_reaction(tab: FakeTab):
    generate(tab)
    before = tab.session.scenario
    first, _ = before.agents.ids
    for dx in (0.5, 1.0, 1.5):
        move(tab, first, dx)
    tab.run(tab.ui.end_gesture)
    until(lambda: len(tab.session.entries) == 2 and tab.ui.gesture is None)
    tab.run(lambda: None)
    entry = tab.session.entries[1]
    assert isinstance(entry.command, RegeneratedEdit)
    assert entry.command.edit == TransformAgents(agent_ids=(first,), dx_m=1.5)
    assert tab.model.run is None
    tab.run(tab.elements.history.undo)
    assert tab.session.scenario is before


def test_who_reacts_is_not_said_to_be_locked(tab: FakeTab):
    """While the only one was dragged, its own reaction was taken for what the edit sets."""
    generate(tab)
    first, second = tab.session.scenario.agents.ids
    lock = SetLocks(agent_ids=(second,), lock=TRAJECTORY_LOCK)
    tab.run(lambda: tab.ui.apply(lock))
    before = tab.session.scenario
    move(tab, first, 1.0)
    until(lambda: retimed_ids(before, tab.session.scenario))
    tab.run(tab.elements.generation.show)
    assert "Nothing reacts" not in tab.shown("run")["text"]
    tab.run(tab.ui.end_gesture)


def test_while_the_reaction_is_awaited_another_edit_commits_what_is_shown(
    tab: FakeTab, drift: DriftGenerator
):
    generate(tab)
    first, second = tab.session.scenario.agents.ids
    gate = threading.Event()
    drift.on_step = lambda _step: gate.wait(10) and None
    move(tab, first, 1.0)
    tab.run(tab.ui.end_gesture)
    assert tab.ui.gesture == "refining"
    assert tab.model.run.text == "Refining ..."
    move(tab, second, 2.0)
    assert [one.command for one in tab.session.entries[1:]] == [
        TransformAgents(agent_ids=(first,), dx_m=1.0)
    ]
    tab.run(tab.elements.escape)
    gate.set()
    assert len(tab.session.entries) == 2
    assert not tab.session.state.is_previewing

    # A new selection commits it, and Escape then clears the selection.
    gate.clear()
    move(tab, first, 3.0)
    tab.run(tab.ui.end_gesture)
    tab.run(lambda: tab.session.select((second,)))
    assert len(tab.session.entries) == 3
    assert tab.ui.gesture is None
    tab.run(tab.elements.escape)
    assert tab.session.selection == ()
    assert len(tab.session.entries) == 3
    gate.set()


def test_escape_while_the_reaction_is_awaited_leaves_the_edit(
    tab: FakeTab, drift: DriftGenerator
):
    generate(tab)
    first, _ = tab.session.scenario.agents.ids
    gate = threading.Event()
    drift.on_step = lambda _step: gate.wait(10) and None
    before = tab.session.scenario
    move(tab, first, 3.0)
    tab.run(tab.ui.end_gesture)
    tab.run(tab.elements.escape)
    gate.set()
    assert tab.session.entries[-1].command == TransformAgents(
        agent_ids=(first,), dx_m=3.0
    )
    assert tab.ui.gesture is None
    assert tab.model.run is None
    tab.run(tab.elements.history.undo)
    assert tab.session.scenario is before


def test_the_next_value_of_a_slider_is_shown_while_the_reaction_is_awaited(
    tab: FakeTab, drift: DriftGenerator
):
    generate(tab)
    gate = threading.Event()
    drift.on_step = lambda _step: gate.wait(10) and None
    tab.type("Bend", 4.0)
    tab.run(tab.ui.end_gesture)
    assert tab.ui.gesture == "refining"
    tab.type("Bend", -6.0)
    assert tab.field("Bend").value == -6.0
    assert tab.session.scenario.applied_warp.warp.terms[0].power == -6.0
    assert tab.session.entries[-1].label == "Bend the road: bend +4"
    gate.set()


def test_the_next_number_is_shown_while_the_reaction_is_awaited(
    tab: FakeTab, drift: DriftGenerator
):
    generate(tab)
    tab.run(lambda: tab.session.select(tab.session.scenario.agents.ids[:1]))
    gate = threading.Event()
    drift.on_step = lambda _step: gate.wait(10) and None
    tab.type("Speed (m/s)", 4.0)
    tab.run(tab.ui.end_gesture)
    assert tab.ui.gesture == "refining"
    tab.type("Speed (m/s)", 6.0)
    assert tab.field("Speed (m/s)").value == 6.0
    assert tab.session.entries[-1].label.endswith("4.0 m/s")
    gate.set()


def test_switched_off_nothing_reacts_and_the_workspace_remembers_it(tab: FakeTab):
    generate(tab)
    first, _ = tab.session.scenario.agents.ids
    tab.run(tab.elements.generation.live_switch.toggle)
    move(tab, first, 1.0)
    tab.run(tab.ui.end_gesture)
    assert tab.session.entries[1].command == TransformAgents(
        agent_ids=(first,), dx_m=1.0
    )
    assert not tab.tab.workspace.view.is_live
    tools = tab.shown("toolbar")["tools"]
    (live,) = [one for one in tools if one["icon"] == "live"]
    assert live["isActive"] is False


def test_of_very_many_agents_the_nearest_to_the_edit_react():
    states = [(10.0 * row, 0.0, 0.0, 5.0) for row in range(100)]
    before = scenario_with(straight_drivers(states))
    ids = before.agents.ids
    dragged = TransformAgents(agent_ids=(ids[50],), dx_m=1.0, dy_m=1.0)
    edited = dragged.apply(before)
    found = nearest_to_edit(before, edited, ids)
    assert len(found) == 16
    assert {ids[49], ids[50], ids[51]} < set(found) < set(ids[40:61])
    assert nearest_to_edit(before, edited, ids[:60]) == ids[:60], "not so many"
    assert nearest_to_edit(before, before, ids) == ids, "no agent was edited"
    new_road = replace(edited, road_map=replace(edited.road_map))
    assert nearest_to_edit(before, new_road, ids) == ids


def test_whose_later_motion_an_edit_sets_does_not_react_to_it():
    """A pull of a generated agent's speed would be generated away."""
    before = two_agents_that_pass()
    one = before.agents.ids[0]
    pulled = PullSpeed(agent_id=one, time_s=2.0, speed_mps=1.0).apply(before)
    assert retimed_ids(before, pulled) == {one}
    faster = SetAgentSpeed(agent_ids=(one,), speed_mps=1.0).apply(before)
    moved = TransformAgents(
        agent_ids=(one,), dx_m=1.0, dy_m=0.0, rotation_rad=0.0
    ).apply(before)
    assert retimed_ids(before, faster) == retimed_ids(before, moved) == set()
