"""The drawing mode, its marks and its list, without a browser."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.speed import StopAtLine, TargetSpeed
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import AddGuidance
from pd_editor.scene.generation import GenerationRequest
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.viewer.guidance.guidance_panel import listed
from pd_editor.viewer.guidance.guiding import like, replaced_index
from pd_editor.viewer.guidance.term_marks import OFFER
from tests.viewer.fake_browser import FakeTab


def target(tab: FakeTab) -> str:
    """Whom the run bar would regenerate."""
    return tab.shown("run")["verbs"][0]["target"]


def ray_to(point) -> dict:
    """A ray straight down on a point of the ground."""
    x, y = map(float, point)
    return {"at": [0.0, 0.0], "ray": [[x, y, 50.0], [x, y, 0.0]]}


def by(place: np.ndarray, ahead: float, left: float) -> np.ndarray:
    """A point of the straight road beside another one."""
    return place + np.array([ahead, left])


def focal(tab: FakeTab) -> tuple[str, np.ndarray]:
    scenario = tab.session.scenario
    row = scenario.agents.row_of[scenario.focal_id]
    return scenario.focal_id, scenario.agents.position_m[row, scenario.current_step]


def guidance(tab: FakeTab) -> tuple:
    return tab.session.scenario.guidance


def draw(tab: FakeTab, tool: str, /, **event) -> None:
    mode = tab.elements.steering.mode
    tab.run(lambda: mode.toggle(tool))
    tab.hear("guiding", tool=tool, **event)


def test_a_goal_is_clicked_moved_and_undone(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    draw(tab, "goal-point", kind="click", **ray_to(by(place, 20.0, 0.0)))
    assert not tab.elements.steering.mode.is_active
    (term,) = guidance(tab)
    assert term.point_m == pytest.approx(tuple(by(place, 20.0, 0.0)), abs=0.01)
    # A second goal of the agent replaces the first and keeps its strength.
    event = {"kind": "weight", "index": 0, "stop": 7, "isEnd": True, "version": 1}
    tab.hear("guidance_panel", **event, count=0)
    draw(tab, "goal-point", kind="click", **ray_to(by(place, 30.0, 0.0)))
    (moved,) = guidance(tab)
    assert moved.point_m[0] == pytest.approx(place[0] + 30.0, abs=0.01)
    assert moved.weight == 2.0
    assert [type(entry.command).__name__ for entry in tab.session.entries] == [
        "AddGuidance",
        "ChangeGuidance",
        "ChangeGuidance",
    ]
    tab.run(tab.session.undo)
    tab.run(tab.session.undo)
    assert guidance(tab) == (term,)


def test_a_goal_off_the_map_is_refused_and_the_mode_stays(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    before = tab.session.scenario
    draw(tab, "goal-point", kind="click", **ray_to(by(place, 0.0, 400.0)))
    assert tab.session.scenario is before
    assert tab.elements.steering.mode.is_active
    tab.run(tab.elements.escape)
    assert not tab.elements.steering.mode.is_active
    assert tab.session.selection == (agent_id,)


def test_without_one_selected_agent_nothing_is_drawn(tab: FakeTab):
    mode = tab.elements.steering.mode
    for selection in ((), tab.session.scenario.agents.ids):
        tab.run(lambda selection=selection: tab.session.select(selection))
        with pytest.raises(EditError, match="Select one agent"):
            mode.toggle("goal-point")
    assert not mode.is_active


def test_a_late_event_of_another_tool_changes_nothing(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    mode = tab.elements.steering.mode
    tab.run(lambda: mode.toggle("stop-at-line"))
    event = {"kind": "click", "tool": "goal-point", **ray_to(by(place, 9.0, 0.0))}
    tab.hear("guiding", **event)
    assert guidance(tab) == ()
    tab.run(mode.stop)
    tab.hear("guiding", **{**event, "tool": "stop-at-line"})
    assert guidance(tab) == ()


def test_another_agent_is_picked_and_itself_is_not(tab: FakeTab):
    agents, step = tab.session.scenario.agents, tab.session.scenario.current_step
    one, other = agents.ids[:2]
    tab.run(lambda: tab.session.select((one,)))
    here, there = agents.position_m[:2, step]
    draw(tab, "yield-to", kind="click", **ray_to(here))
    assert guidance(tab) == ()
    assert tab.elements.steering.mode.is_active
    tab.hear("guiding", tool="yield-to", kind="point", **ray_to(there))
    assert tab.shown("guiding")["ghost"]["text"] == f"vehicle {other}"
    tab.hear("guiding", tool="yield-to", kind="click", **ray_to(there))
    assert guidance(tab) == (YieldTo(agent_id=one, other_id=other),)


def test_a_line_is_drawn_and_garbage_of_the_page_is_left_out(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    points = [[float(place[0] + d), float(place[1])] for d in range(0, 30, 2)]
    draw(tab, "follow-path", kind="drawn", points=[*points, [1e99, 0]])
    (term,) = guidance(tab)
    assert isinstance(term, FollowPath)
    assert len(term.points_m) == 2
    draw(tab, "follow-path", kind="drawn", points=[*points, "x"])
    assert guidance(tab) == (term,)
    draw(tab, "follow-path", kind="drawn")
    assert guidance(tab) == (term,)


def drag(tab: FakeTab, index: int, *points, drop=None, kind="drop") -> None:
    tab.hear("guidance_marks", kind="grab", index=index)
    for point in points:
        place = list(map(float, point))
        tab.hear("guidance_marks", kind="drag", index=index, point=place)
    last = {} if drop is None else {"point": list(map(float, drop))}
    tab.hear("guidance_marks", kind=kind, index=index, **last)


def test_marks_are_not_drawn_beside_the_road_of_another_branch(tab: FakeTab):
    agent_id, _ = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    anchor = RigidMotion(x_m=-20.0, y_m=0.0, rotation_rad=0.0)
    term = WarpTerm(kind="smooth-turn", power=3.0, length_m=40.0)
    bent = warp_scenario(tab.session.scenario, RoadWarp(anchor=anchor, terms=(term,)))
    for sample, count in ((bent, 0), (None, 1), (tab.session.scenario, 1)):
        tab.run(partial(tab.ui.model.preview, sample))
        assert len(tab.shown("guidance_marks")["marks"]) == count


def test_the_flag_at_the_end_of_a_trajectory_is_dragged_as_one_edit(tab: FakeTab):
    tab.run(tab.elements.generation.live_switch.toggle)
    agent_id, place = focal(tab)
    assert not any(m["index"] == OFFER for m in tab.shown("guidance_marks")["marks"])
    tab.run(lambda: tab.session.select((agent_id,)))
    (offer,) = tab.shown("guidance_marks")["marks"]
    assert offer["index"] == OFFER
    goals = [by(place, d, 0.5) for d in (20.0, 22.0, 25.0)]
    drag(tab, OFFER, *goals, drop=goals[-1])
    (term,) = guidance(tab)
    assert isinstance(term, GoalPoint)
    assert term.point_m == pytest.approx(tuple(goals[-1]), abs=0.01)
    assert len(tab.session.entries) == 1
    (mark,) = tab.shown("guidance_marks")["marks"]
    assert (mark["shape"], mark["isChosen"]) == ("flag", True)
    drag(tab, 0, goals[0], drop=goals[1])
    assert len(tab.session.entries) == 2
    assert guidance(tab)[0].point_m == pytest.approx(tuple(goals[1]), abs=0.01)


@pytest.mark.parametrize("kind", ["drop", "cancel"])
def test_a_drag_that_is_refused_or_cancelled_changes_nothing(tab: FakeTab, kind):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    before = tab.session.scenario
    off = by(place, 0.0, 500.0)
    drag(tab, OFFER, by(place, 20.0, 0.0), off, drop=off, kind=kind)
    assert tab.session.scenario is before
    assert not tab.session.entries
    assert not tab.session.state.is_previewing
    assert tab.shown("guidance_marks")["refusal"] == ""


def test_an_undo_during_a_drag_ends_it(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    event = {"index": OFFER, "point": list(map(float, by(place, 20.0, 0.0)))}
    tab.hear("guidance_marks", kind="grab", index=OFFER)
    tab.hear("guidance_marks", kind="drag", **event)
    assert len(guidance(tab)) == 1
    tab.hear("toolbar", kind="press", icon="undo")
    before = tab.session.scenario
    tab.hear("guidance_marks", kind="drop", **event)
    assert tab.session.scenario is before
    assert guidance(tab) == ()


def test_a_stop_line_follows_the_lane_when_it_is_dragged(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    draw(tab, "stop-at-line", kind="click", **ray_to(by(place, 20.0, 0.0)))
    (term,) = guidance(tab)
    assert isinstance(term, StopAtLine)
    drag(tab, 0, by(place, 26.0, 0.4), drop=by(place, 28.0, 0.4))
    (moved,) = guidance(tab)
    assert np.mean(moved.line_m, axis=0)[0] == pytest.approx(place[0] + 28.0, abs=0.1)


def test_the_list_shows_terms_of_the_selection(tab: FakeTab):
    one, other = tab.session.scenario.agents.ids[:2]
    terms = (
        TargetSpeed(agent_ids=(one,), speed_mps=5.0),
        TargetSpeed(agent_ids=(), speed_mps=6.0),
        Threaten(agent_id=other, other_id=one),
        TargetSpeed(agent_ids=(other,), speed_mps=7.0, is_on=False),
    )
    assert listed(terms, (one,)) == [0, 1, 2]
    assert listed(terms, (other,)) == [1, 2, 3]
    assert listed(terms, ()) == [0, 1, 2, 3]
    for term in terms:
        tab.run(lambda term=term: tab.ui.apply(AddGuidance(term=term)))
    rows = tab.shown("guidance_panel")["rows"]
    assert [row["name"] for row in rows] == [
        f"Target speed of vehicle {one}",
        "Target speed of all agents",
        f"Threaten {one} of vehicle {other}",
        f"Target speed of vehicle {other}",
    ]
    assert [row["isOn"] for row in rows] == [True, True, True, False]
    marks = tab.shown("guidance_marks")["marks"]
    assert sorted(mark["shape"] for mark in marks) == ["arrow", "badge", "badge"]


def heard(tab: FakeTab, **event) -> None:
    version = tab.shown("guidance_panel")["version"]
    tab.hear("guidance_panel", **{"version": version, "count": 0, **event})


def test_terms_of_the_form_are_added_changed_switched_and_removed(tab: FakeTab):
    agent_id, _ = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    heard(tab, kind="tool", tool="target-speed")
    (term,) = guidance(tab)
    assert term.agent_ids == (agent_id,)
    # The same tool once more chooses the term that is there.
    heard(tab, kind="tool", tool="target-speed")
    assert len(tab.session.entries) == 1
    heard(tab, kind="input", index=0, name="speed_mps", value=4.5)
    assert guidance(tab) == (replace(term, speed_mps=4.5),)
    for count, (name, value) in enumerate(
        (("speed_mps", 900), ("speed_mps", "x"), ("weight", 2)), start=5
    ):
        heard(tab, kind="input", index=0, name=name, value=value, count=count)
        assert tab.shown("guidance_panel")["answered"] == count
    assert guidance(tab) == (replace(term, speed_mps=4.5),)
    heard(tab, kind="switch", index=0, isOn=False)
    assert not guidance(tab)[0].is_on
    count = len(tab.session.entries)
    for stop in (1, 2, 3):
        heard(tab, kind="weight", index=0, stop=stop, isEnd=stop == 3)
    assert guidance(tab)[0].weight == 0.5
    assert len(tab.session.entries) == count + 1
    heard(tab, kind="remove", index=0)
    assert guidance(tab) == ()
    tab.run(tab.session.undo)
    assert len(guidance(tab)) == 1


def test_an_input_of_a_list_that_is_gone_changes_nothing(tab: FakeTab):
    agent_id, _ = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    heard(tab, kind="tool", tool="target-speed")
    before = tab.session.scenario
    version = tab.shown("guidance_panel")["version"]
    tab.hear("guidance_panel", kind="remove", index=0, version=version - 1, count=0)
    heard(tab, kind="remove", index=7)
    heard(tab, kind="remove", index="0")
    assert tab.session.scenario is before


def test_a_regeneration_carries_the_terms_of_the_scenario(tab: FakeTab, monkeypatch):
    agent_id, _ = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    heard(tab, kind="tool", tool="target-speed")
    panel = tab.elements.generation
    requests: list[GenerationRequest] = []
    monkeypatch.setattr(
        panel.result, "start", lambda _n, _m, task: requests.append(task.request)
    )
    tab.hear("run", kind="regenerate")
    (request,) = requests
    assert request.scenario.guidance == guidance(tab)
    # It regenerated everybody, whatever was guided.
    assert target(tab) == agent_id
    assert request.agent_ids == (agent_id,)
    tab.run(lambda: tab.session.select(()))
    assert target(tab) == agent_id
    tab.hear("run", kind="regenerate")
    assert requests[-1].agent_ids == (agent_id,)
    tab.hear("run", kind="scope", value="All agents")
    tab.hear("run", kind="regenerate")
    everybody = drivable_agent_ids(tab.session.scenario)
    assert requests[-1].agent_ids == everybody
    assert len(everybody) > 1
    tab.hear("run", kind="scope", value="The selection, else the guided, else all")
    assert target(tab) == agent_id
    heard(tab, kind="remove", index=0)
    assert target(tab) == "everybody"


def test_what_a_new_term_replaces():
    goal = GoalPoint(agent_id="a", point_m=(0.0, 0.0), at_s=3.0, weight=2.0)
    other = GoalPoint(agent_id="b", point_m=(0.0, 0.0))
    one_pair = YieldTo(agent_id="a", other_id="b")
    terms = (goal, other, one_pair)
    new = GoalPoint(agent_id="a", point_m=(9.0, 0.0))
    assert replaced_index(terms, new) == 0
    assert like(new, goal) == replace(new, at_s=3.0, weight=2.0)
    assert replaced_index(terms, YieldTo(agent_id="a", other_id="c")) is None
    assert replaced_index(terms, YieldTo(agent_id="a", other_id="b")) == 2


def test_an_agent_is_guided_along_a_possible_trajectory(tab: FakeTab):
    agent_id, place = focal(tab)
    tab.run(lambda: tab.session.select((agent_id,)))
    tab.press("Show possible trajectories")
    tab.type("Trajectory", tab.field("Trajectory").options[1])
    tab.press("Guide along this trajectory")
    (term,) = guidance(tab)
    assert isinstance(term, FollowPath)
    assert np.linalg.norm(np.array(term.points_m[0]) - place) < 1.0
    assert not tab.elements.candidates.shows_candidates


def test_a_row_of_the_list_is_picked_like_an_agent_of_the_picture(tab: FakeTab):
    """It was selected instead, and the mode stayed on."""
    agent_id, _ = focal(tab)
    scenario, mode = tab.session.scenario, tab.elements.steering.mode
    other = next(name for name in scenario.agents.ids if name != agent_id)
    tab.run(lambda: tab.session.select((agent_id,)))
    tab.hear("agents", kind="open")

    def choose(name: str) -> None:
        rows = [scenario.agents.row_of[name]]
        number = tab.shown("agents")["number"]
        tab.hear("agents", kind="select", number=number, rows=rows)

    tab.run(lambda: mode.toggle("threaten"))
    choose(agent_id)
    assert mode.is_active
    assert not guidance(tab)
    choose(other)
    (term,) = guidance(tab)
    assert (term.agent_id, term.other_id) == (agent_id, other)
    assert not mode.is_active
    assert tab.session.selection == (agent_id,)
    # Modes that ask for a place leave the list as it is.
    tab.run(lambda: mode.toggle("goal-point"))
    choose(other)
    assert tab.session.selection == (other,)
