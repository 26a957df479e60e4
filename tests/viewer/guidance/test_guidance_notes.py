"""What the panel says of a guided run, and the unguided sample instead of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, TargetSpeed
from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import (
    AddGuidance,
    ChangeGuidance,
    RegeneratedEdit,
    RemoveGuidance,
    traffic_command,
)
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    GuidanceReport,
    TrafficSample,
)
from pd_editor.scene.guidance_terms import GuidanceCost, Realism, TermOutcome
from pd_editor.viewer.generation.generation_run import GenerationInput
from pd_editor.viewer.guidance.guidance_notes import NOT_RUN, TAKE_UNGUIDED
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import ReadyGenerator
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until

TERM = TargetSpeed(agent_ids=("100",), speed_mps=5.0)


def realism(collisions: int) -> Realism:
    return Realism(
        off_road=0.01 * collisions,
        num_collisions=collisions,
        lateral_deviation_m=0.4,
        acceleration_mps2=0.8,
    )


def sample_at(scenario, agent_id: str, speed_mps: float) -> TrafficSample:
    """An agent that drives straight ahead at a constant speed."""
    agents, now = scenario.agents, scenario.current_step
    (row,) = agents.rows([agent_id])
    count = scenario.time_axis.num_future_steps + 1
    seconds = np.arange(count) * scenario.time_axis.step_s
    position = agents.position_m[row, now] + np.outer(seconds, [speed_mps, 0.0])
    return TrafficSample(
        ids=(agent_id,),
        kinds=(agents.kinds[row],),
        size_m=agents.size_m[[row]],
        position_m=position[None],
        heading_rad=np.full((1, count), agents.heading_rad[row, now]),
        velocity_mps=np.tile([speed_mps, 0.0], (1, count, 1)),
    )


@pytest.fixture
def guided(tab: FakeTab) -> FakeTab:
    """A tab after a guided run that made the scene worse."""
    agent_id = tab.session.scenario.agents.ids[0]
    assert agent_id == "100"
    tab.run(lambda: tab.ui.apply(AddGuidance(term=TERM)))
    scenario = tab.session.scenario
    outcome = TermOutcome(
        term=TERM,
        is_feasible=True,
        asked="5.0 m/s",
        achieved="4.9 m/s",
        error=0.1,
        unit="m/s",
        is_obeyed=True,
    )
    report = GuidanceReport(
        outcomes=(outcome,),
        cost=GuidanceCost(guided=realism(2), unguided=realism(0)),
        unguided=sample_at(scenario, agent_id, 3.0),
        motion_problems=("Agent 100 brakes with 9.1 m/s².",),
    )
    ready: Any = ReadyGenerator((sample_at(scenario, agent_id, 5.0),), (report,))
    run = tab.elements.generation.result
    task = GenerationInput(
        base=scenario,
        request=GenerationRequest(scenario=scenario, agent_ids=(agent_id,)),
    )
    tab.run(lambda: run.start("ready", lambda: ready, task))
    until(lambda: not tab.model.is_running)
    tab.run(lambda: None)
    return tab


def panel(tab: FakeTab) -> dict:
    return tab.shown("guidance_panel")


def speed(tab: FakeTab) -> float:
    scenario = tab.session.scenario
    return float(scenario.agents.velocity_mps[0, scenario.current_step + 5, 0])


def test_a_run_tells_asked_and_achieved_and_what_it_cost(guided: FakeTab):
    state = panel(guided)
    assert speed(guided) == 5.0
    (row,) = state["rows"]
    assert row["notes"] == [
        # What the trajectories in the scene achieve, not what a run once said.
        {
            "tone": "good",
            "text": "Asked: 5.0 m/s over the last second. Achieved: 5.0 m/s.",
        }
    ]
    tones = {line["text"]: line["tone"] for line in state["report"]}
    assert tones["Guidance met: 1 of 1"] == "good"
    assert tones["Agent 100 brakes with 9.1 m/s²."] == "warn"
    (worse,) = (text for text in tones if text.startswith("Guidance made the scene"))
    assert "2 instead of 0 agents collide" in worse
    (collisions,) = (row for row in state["figures"] if "collide" in row[0])
    # It said "new collisions", and nowhere what is new.
    assert collisions[:3] == ["Agents that collide after t = 0", "2", "0"]
    assert "overlap at t = 0 already" in collisions[3]
    assert state["action"] == TAKE_UNGUIDED


def test_the_unguided_sample_is_taken_and_undone(guided: FakeTab):
    count = len(guided.session.entries)
    guided.hear("guidance_panel", kind="take", version=None, count=0)
    assert speed(guided) == 3.0
    assert len(guided.session.entries) == count + 1
    # (W15) In the history both runs had the same name.
    assert guided.session.entries[-1].label.endswith("unguided)")
    assert guided.session.scenario.guidance == (TERM,)
    assert panel(guided)["action"] is None
    (note,) = panel(guided)["rows"][0]["notes"]
    assert note == {
        "tone": "bad",
        "text": "Asked: 5.0 m/s over the last second. Achieved: 3.0 m/s.",
    }
    guided.run(guided.session.undo)
    # The guided traffic is back, and with it its report.
    assert speed(guided) == 5.0
    assert panel(guided)["action"] == TAKE_UNGUIDED
    guided.run(guided.session.undo)
    assert panel(guided)["report"] == []


def test_a_term_that_changes_after_the_run_has_no_outcome(guided: FakeTab):
    changed = TargetSpeed(agent_ids=("100",), speed_mps=6.0)
    guided.run(lambda: guided.ui.apply(ChangeGuidance(index=0, term=changed)))
    state = panel(guided)
    assert state["rows"][0]["notes"] == [{"tone": "warn", "text": NOT_RUN}]
    # Where Generate is open, its bar alone can tell.
    assert guided.shown("run")["text"] == NOT_RUN
    assert state["action"] == TAKE_UNGUIDED
    # (W20) "Guidance met: 1 of 1" stood there as if it were of the present terms.
    head, *former = state["report"]
    assert head["text"].startswith("1 of 1 not run yet.")
    assert {"tone": "plain", "text": "Guidance met: 1 of 1"} in former
    guided.run(guided.session.undo)
    assert panel(guided)["report"][0]["text"] == "Guidance met: 1 of 1"


def test_contradictions_are_told_beside_the_terms_and_before_a_run(
    tab: FakeTab, monkeypatch
):
    for term in (
        TargetSpeed(agent_ids=("100",), speed_mps=9.0),
        SpeedLimit(agent_ids=("100",), speed_mps=5.0),
    ):
        tab.run(lambda term=term: tab.ui.apply(AddGuidance(term=term)))
    notes = [row["notes"] for row in panel(tab)["rows"]]
    assert notes[0] == []
    (note,) = notes[1]
    assert note["tone"] == "warn"
    assert "above its speed limit of 5 m/s" in note["text"]
    told: list[str] = []
    monkeypatch.setattr(tab.ui, "notify", lambda _title, body="", *_: told.append(body))
    monkeypatch.setattr(
        tab.elements.generation.result, "start", lambda *_: told.append("started")
    )
    tab.run(tab.elements.generation.regenerate)
    assert "above its speed limit" in told[0]
    assert told[1] == "started"
    # A term that is switched off contradicts nothing.
    off = SpeedLimit(agent_ids=("100",), speed_mps=5.0, is_on=False)
    tab.run(lambda: tab.ui.apply(ChangeGuidance(index=1, term=off)))
    assert [row["notes"] for row in panel(tab)["rows"]] == [[], []]


def test_a_goal_that_is_dragged_too_far_is_told_during_the_drag(tab: FakeTab):
    scenario = tab.session.scenario
    place = scenario.agents.position_m[0, scenario.current_step]
    near, far = (
        GoalPoint(agent_id="100", point_m=(float(place[0]) + ahead, float(place[1])))
        for ahead in (25.0, 190.0)
    )
    tab.run(lambda: tab.ui.apply(AddGuidance(term=near)))
    assert panel(tab)["rows"][0]["notes"] == []
    command = ChangeGuidance(index=0, term=far)
    tab.run(lambda: tab.ui.preview("a drag", command))
    (note,) = panel(tab)["rows"][0]["notes"]
    assert "move it" in note["text"]
    (mark,) = tab.shown("guidance_marks")["marks"]
    assert mark["isBad"]
    assert note["text"] in mark["lines"]
    tab.run(tab.ui.abort_gesture)
    assert panel(tab)["rows"][0]["notes"] == []


def test_threats_are_checked_in_a_pause_and_stay_told_meanwhile(tab: FakeTab):
    threat = Threaten(agent_id="100", other_id="101", approach="head-on")
    speed = TargetSpeed(agent_ids=("100",), speed_mps=55.0)
    tab.run(lambda: tab.ui.apply(AddGuidance(term=speed)))
    tab.run(lambda: tab.ui.apply(AddGuidance(term=threat)))
    # Nothing told that it is checked, nor when that was over.
    assert panel(tab)["rows"][1]["notes"] == [{"tone": "plain", "text": "Checking ..."}]
    until(lambda: panel(tab)["rows"][1]["notes"][0]["tone"] == "bad")
    notes = [row["notes"] for row in panel(tab)["rows"]]
    assert "ask for less" in notes[0][0]["text"]
    assert "head-on" in notes[1][0]["text"]
    # The other term goes; the threat keeps what is said of it in its new place.
    tab.run(lambda: tab.ui.apply(RemoveGuidance(index=0)))
    until(lambda: [row["notes"] for row in panel(tab)["rows"]] == [notes[1]])


def test_a_run_is_told_again_after_its_work_was_continued(tmp_path: Path):
    """Nothing was said of it: a report was kept no longer than the editor ran."""
    write_files(scenario_files(two_agents_that_pass()), tmp_path / "s", forbidden=None)
    library, reference = tmp_path / "library", str(tmp_path / "s")
    with running_app(library, reference) as app, connected_tab(app) as tab:
        tab.ui.live = None
        scenario = tab.session.scenario
        agent_id = scenario.agents.ids[0]
        term = TargetSpeed(agent_ids=(agent_id,), speed_mps=5.0)
        tab.run(lambda: tab.ui.apply(AddGuidance(term=term)))
        request = GenerationRequest(
            scenario=tab.session.scenario, agent_ids=(agent_id,)
        )
        for generator in ("lane-follower", SHIPPED_MODEL):
            traffic = GeneratedTraffic(
                samples=(sample_at(scenario, agent_id, 5.0),), generator=generator
            )
            command = traffic_command(request, traffic, 0)
            tab.run(lambda command=command: tab.ui.apply(command))
        (note,) = panel(tab)["rows"][0]["notes"]
        assert note["tone"] == "good"
    with running_app(library, reference) as app, connected_tab(app) as tab:
        (work,) = tab.ui.workspace.shelf.unfinished()
        tab.run(lambda: tab.ui.workspace.resume(work))
        state = panel(tab)
        (note,) = state["rows"][0]["notes"]
        assert note["text"].startswith("Asked: 5.0 m/s")
        assert [line["text"] for line in state["report"]] == ["Guidance met: 1 of 1"]
        # Nothing is known of the unguided sample.
        assert state["figures"] == []
        assert state["action"] is None
        # The rule-based generator takes no guidance.
        tab.run(tab.session.undo)
        assert panel(tab)["report"] == []
        tab.run(tab.session.redo)
        assert panel(tab)["report"] == state["report"]


def test_nothing_is_generated_that_could_obey_nothing(tab: FakeTab, monkeypatch):
    """A run was made for a threat that cannot be, and its result looked obeyed."""
    threat = Threaten(agent_id="100", other_id="101", approach="head-on")
    tab.run(lambda: tab.ui.apply(AddGuidance(term=threat)))
    generation, started = tab.elements.generation, []
    monkeypatch.setattr(generation.result, "start", lambda *_: started.append(1))
    with pytest.raises(GenerationError, match=r"head-on.*switch it off to regenerate"):
        tab.run(generation.regenerate)
    assert not started
    # With something else that can be met, or without the threat, there is a run.
    tab.run(lambda: tab.ui.apply(AddGuidance(term=TERM)))
    tab.run(generation.regenerate)
    off = replace(threat, is_on=False)
    tab.run(lambda: tab.ui.apply(ChangeGuidance(index=0, term=off)))
    tab.run(generation.regenerate)
    assert len(started) == 2


def test_trajectories_of_a_live_edit_are_judged_like_those_of_a_run(guided: FakeTab):
    """A goal that was dragged live had no line, and its miss was nowhere told."""
    scenario, name = guided.session.scenario, "100"
    x, y = scenario.agents.position_m[0, -1].tolist()
    goal = GoalPoint(agent_id=name, point_m=(x + 23.0, y))
    edit = AddGuidance(term=goal)
    after = edit.apply(scenario)
    request = GenerationRequest(scenario=after, agent_ids=(name,))
    traffic = GeneratedTraffic(
        samples=(sample_at(scenario, name, 5.0),), generator="live"
    )
    live = RegeneratedEdit(edit=edit, traffic=traffic_command(request, traffic))
    guided.run(lambda: guided.ui.apply(live))
    last = panel(guided)["rows"][1]["notes"][-1]
    assert last["tone"] == "bad"
    assert last["text"].startswith("Asked: at (")
    assert "m away" in last["text"]
    watch = guided.model.findings
    guided.run(lambda: watch.check(with_future=True))
    (found,) = [one for one in watch.new if one.kind == "guidance-not-met"]
    assert found.agent_ids == (name,)
    assert found.source == "guidance"
    assert found.message.split("achieved ")[1].rstrip(".") in last["text"]
