"""Rolling out in the whole tab, without a browser."""

import threading
from collections.abc import Callable, Iterator
from unittest import mock

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import AddGuidance, SetAgentKind, SetLocks
from pd_editor.experiments.closed_loop.policies import IdmOnRoute
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.locks import TRAJECTORY_LOCK, Lock
from pd_editor.viewer.generation import roll_out_panel
from pd_editor.viewer.generation.roll_out_panel import NOBODY
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until

MODEL = "lane-follower"


@pytest.fixture
def tab(tmp_path) -> Iterator[FakeTab]:
    with (
        running_app(tmp_path / "library", "roundabout") as app,
        connected_tab(app) as opened,
    ):
        opened.tab.workspace.playback.pause()
        set_input(opened, "Model", MODEL)
        set_input(opened, "Duration", "10 s")
        yield opened


def set_input(tab: FakeTab, label: str, value: object) -> None:
    (handle,) = (one for one in tab.inputs()[label] if hasattr(one, "options"))
    tab.enter(handle, value)


def press(tab: FakeTab, label: str) -> None:
    tab.enter(tab.inputs()[label][0], True)


def rolled(tab: FakeTab) -> None:
    press(tab, "Roll out")
    until(lambda: not tab.model.is_running)
    tab.run(lambda: None)


class Policy(IdmOnRoute):
    """The car-following policy, with something done at each of its plans."""

    name = "mine"

    def __init__(self, then: Callable[[], None]) -> None:
        super().__init__()
        self._then = then

    def plan(self, observation):
        self._then()
        return super().plan(observation)


def driven_by(then: Callable[[], None]):
    return mock.patch.object(roll_out_panel, "policy_of", return_value=Policy(then))


def test_the_scene_goes_on_as_one_step(tab):
    before, playback = tab.session.scenario, tab.tab.workspace.playback
    with mock.patch.object(tab.ui, "notify") as told:
        rolled(tab)
    (entry,) = tab.session.entries
    assert entry.command.policies == {"AV": "idm"}
    after = tab.session.scenario
    assert after.time_axis.num_steps == before.current_step + 101
    assert playback.axis == after.time_axis
    title, report, _ = told.call_args.args
    assert title == "10 s rolled out"
    assert " entered, " in report
    assert "idm (AV): " in report
    tab.run(tab.elements.history.undo)
    assert tab.session.scenario is before
    tab.run(tab.elements.history.redo)
    assert tab.session.scenario is after


def test_traffic_alone_and_the_selection(tab):
    set_input(tab, "Policy", NOBODY)
    rolled(tab)
    assert tab.session.entries[-1].command.policies == {}
    tab.run(tab.elements.history.undo)
    set_input(tab, "Policy", "constant-velocity")
    tab.run(lambda: tab.session.select(("car-0012",)))
    rolled(tab)
    assert tab.session.entries[-1].command.policies == {"car-0012": "constant-velocity"}


def test_locks_are_kept_or_told_before(tab):
    lock = SetLocks(agent_ids=("AV",), lock=TRAJECTORY_LOCK)
    tab.run(lambda: tab.session.apply(lock))
    with mock.patch.object(tab.elements.agent.locks, "offer") as told:
        press(tab, "Roll out")
    assert told.call_args.args[0].agent_ids == ("AV",)
    assert not tab.model.is_running
    before = tab.session.scenario.agents
    tab.run(lambda: tab.session.select(("car-0012",)))
    rolled(tab)
    after = tab.session.scenario.agents
    kept = after.position_m[after.row_of["AV"], : before.num_steps]
    np.testing.assert_array_equal(kept, before.position_m[before.row_of["AV"]])


def test_guidance_of_the_scene_is_told(tab):
    """It was forgotten after the first second."""
    goal = GoalPoint(agent_id="car-0012", point_m=(500.0, 0.0), at_s=9.0)
    tab.run(lambda: tab.session.apply(AddGuidance(term=goal)))
    with mock.patch.object(tab.ui, "notify") as told:
        rolled(tab)
    _, report, _ = told.call_args.args
    assert "Goal point of agent car-0012: " in report
    assert tab.session.scenario.guidance == (goal,)


def test_a_locked_beginning_is_left_to_the_model(tab):
    """It was refused whatever the model."""
    lock = SetLocks(agent_ids=("car-0012",), lock=Lock(kept_s=2.0))
    tab.run(lambda: tab.session.apply(lock))
    with mock.patch.object(tab.ui, "notify") as told:
        rolled(tab)
    assert "the lane follower cannot go on from" in told.call_args.args[1]


def test_cancel_at_any_moment_changes_nothing(tab):
    """Also while a policy does not come back."""
    before, inside, go_on = tab.session.scenario, threading.Event(), threading.Event()

    def hang() -> None:
        inside.set()
        assert go_on.wait(60)

    with driven_by(hang):
        press(tab, "Roll out")
        assert inside.wait(60)
        tab.hear("run", kind="cancel")
        assert not tab.model.is_running
        go_on.set()
    assert tab.session.scenario is before
    assert not tab.session.entries
    rolled(tab)
    assert len(tab.session.entries) == 1


def test_a_policy_that_fails_is_told_in_one_sentence(tab):
    def fail() -> None:
        raise ValueError("no battery")

    with driven_by(fail), mock.patch.object(tab.ui, "notify") as told:
        rolled(tab)
    _, report, tone = told.call_args.args
    assert "The policy mine failed" in report
    assert "no battery" in report
    assert tone == "warning"
    agents, now = tab.session.scenario.agents, tab.session.scenario.current_step
    assert not agents.is_valid[agents.row_of["AV"], now + 1 :].any()


def test_a_policy_that_cannot_be_made_changes_nothing(tab):
    missing = GenerationError("There is no policy idm.")
    with (
        mock.patch.object(roll_out_panel, "policy_of", side_effect=missing),
        mock.patch.object(tab.ui, "notify") as told,
    ):
        rolled(tab)
    assert "There is no policy idm." in told.call_args.args
    assert not tab.session.entries


def test_a_result_after_an_edit_waits_until_it_is_wanted(tab):
    edit = SetAgentKind(agent_ids=("car-0012",), kind=AgentKind.BUS)
    edited = threading.Event()

    def after_edit() -> None:
        if not edited.is_set():
            tab.run(lambda: tab.session.apply(edit))
            edited.set()

    with driven_by(after_edit):
        rolled(tab)
    assert len(tab.session.entries) == 1
    tab.hear("run", kind="use")
    assert tab.session.entries[-1].command.policies == {"AV": "mine"}
    steps = tab.session.scenario.time_axis.num_steps
    assert steps == tab.session.scenario.current_step + 101
    assert np.isfinite(tab.session.scenario.agents.position_m).all()
