"""Traffic that reacts while an edit is being made."""

import queue
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pd_editor.base.errors import EditError, GenerationError
from pd_editor.editor.commands import RegeneratedEdit, TransformAgents
from pd_editor.editor.live_regeneration import LiveRegeneration, LiveRequests
from pd_editor.editor.session import EditorSession
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import busy_scenario
from tests.editor.fake_generators import DriftGenerator

IDS = ("100", "101")


class Bench:
    """A session with live traffic, whose thread is the test's."""

    def __init__(self) -> None:
        self.session = EditorSession(busy_scenario())
        self.posted: queue.Queue = queue.Queue()
        self.generator = DriftGenerator(num_steps=2)
        self.asked: list[GenerationRequest] = []
        self.ends, self.errors = 0, []
        self.is_on = True
        self.live = LiveRegeneration(
            self.session,
            lambda action, _key: self.posted.put(action),
            self._requests,
            on_end=self._ended,
            on_error=self.errors.append,
        )

    def _requests(self, scenario: Scenario) -> LiveRequests | None:
        if not self.is_on:
            return None

        def request(edited: Scenario, seed: int) -> GenerationRequest:
            self.asked.append(
                GenerationRequest(scenario=edited, agent_ids=IDS, seed=seed)
            )
            return self.asked[-1]

        return LiveRequests(
            generator=self.generator,
            draft=lambda edited: request(edited, 1),
            result=lambda edited: request(edited, 2),
        )

    def _ended(self) -> None:
        self.ends += 1

    def take(self) -> None:
        """Run the next message of the generator's thread."""
        self.posted.get(timeout=10)()

    def future_of(self, agent_id: str) -> np.ndarray:
        scenario = self.session.scenario
        agents = scenario.agents
        return agents.position_m[agents.row_of[agent_id], scenario.current_step :]


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.live.close()


def moved(dx_m: float) -> TransformAgents:
    return TransformAgents(agent_ids=("100",), dx_m=dx_m)


def test_previews_come_before_the_end_and_one_entry_after(bench):
    session, base = bench.session, bench.session.scenario
    bench.live.preview(moved(1.0))
    plain = session.scenario
    bench.take()
    assert session.scenario is not plain
    assert session.state.is_previewing
    assert session.entries == ()
    drift = np.diff(bench.future_of("101"), axis=0)
    assert np.ptp(drift[:, 0]) < 1e-5, "regenerated at constant speed"
    assert np.allclose(drift[:, 1], 0, atol=1e-6)

    assert bench.live.finish()
    assert bench.live.is_refining
    bench.take()
    assert not bench.live.is_refining
    assert bench.ends == 1
    (entry,) = session.entries
    assert isinstance(entry.command, RegeneratedEdit)
    assert entry.label == "Move agent 100 by 1.0 m, 2 agents regenerated"
    assert [one.seed for one in bench.asked] == [1, 2]
    assert entry.command.traffic.seed == 2, "the usual settings at the end"
    session.undo()
    assert session.scenario is base


def test_requests_have_the_edited_scenario_and_the_one_before(bench):
    base = bench.session.scenario
    for dx in (1.0, 2.0):
        bench.live.preview(moved(dx))
        bench.take()
    first, second = bench.asked
    assert first.before_edit is None, "set by the module, not by the maker"
    for request, dx in ((first, 1.0), (second, 2.0)):
        shift = request.scenario.agents.position_m - base.agents.position_m
        assert np.isclose(shift[0, base.current_step], [dx, 0]).all()
        unmoved = request.scenario.agents.row_of["101"]
        assert not shift[unmoved].any(), "without the traffic of the last preview"


def test_until_new_trajectories_arrive_the_last_ones_move_along(bench):
    bench.live.preview(moved(1.0))
    bench.take()
    before = bench.future_of("100").copy()
    bench.live.preview(moved(3.5))
    assert np.allclose(bench.future_of("100"), before + np.array([2.5, 0]), atol=1e-4)


def test_an_edit_that_changes_nothing_makes_no_entry(bench):
    bench.live.preview(moved(1.0))
    bench.take()
    bench.live.preview(moved(0.0))
    assert bench.session.scenario is bench.session.base
    assert not bench.live.finish()
    bench.session.commit_gesture()
    assert bench.session.entries == ()


def test_another_commit_keeps_what_is_shown_and_later_results_are_ignored(bench):
    session = bench.session
    bench.live.preview(moved(1.0))
    bench.take()
    assert bench.live.finish()
    session.commit_gesture()
    shown = session.scenario
    assert not bench.live.is_refining
    bench.take()
    assert session.scenario is shown
    assert len(session.entries) == 1
    assert session.entries[0].command.traffic.seed == 1
    assert bench.ends == 0


def test_an_aborted_gesture_leaves_the_scenario_as_it_was(bench):
    base = bench.session.scenario
    bench.live.preview(moved(1.0))
    bench.take()
    bench.live.preview(moved(2.0))
    bench.live.drop()
    bench.session.abort_gesture()
    while not bench.posted.empty():
        bench.take()
    assert bench.session.scenario is base
    assert not bench.session.state.is_previewing


def test_a_failing_generator_is_told_once_and_the_edit_is_kept(bench):
    def refuse(_step: int) -> None:
        raise GenerationError("No.")

    bench.generator.on_step = refuse
    bench.live.preview(moved(1.0))
    bench.take()
    bench.live.preview(moved(2.0))
    assert [str(one) for one in bench.errors] == ["No."]
    assert not bench.live.finish(), "committed by the caller"
    bench.session.commit_gesture()
    assert bench.session.entries[0].command == moved(2.0)


def test_a_result_that_fails_at_the_end_commits_what_is_shown(bench):
    bench.live.preview(moved(1.0))
    bench.take()

    def refuse(_step: int) -> None:
        raise GenerationError("No.")

    bench.generator.on_step = refuse
    assert bench.live.finish()
    bench.take()
    assert bench.ends == 1
    assert isinstance(bench.session.entries[0].command, RegeneratedEdit)
    assert not bench.session.state.is_previewing


def test_without_reacting_agents_an_edit_is_plain(bench):
    bench.is_on = False
    bench.live.preview(moved(1.0))
    assert not bench.live.finish()
    bench.session.commit_gesture()
    assert bench.asked == []
    assert bench.session.entries[0].command == moved(1.0)


def test_an_invalid_edit_leaves_the_last_preview(bench):
    bench.live.preview(moved(1.0))
    bench.take()
    shown = bench.session.scenario
    with pytest.raises(EditError):
        bench.live.preview(replace(moved(1.0), agent_ids=("ghost",)))
    assert bench.session.scenario is shown
