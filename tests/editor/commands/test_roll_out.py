"""Longer scenes, and scenes that begin at another moment."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import EditError, LockedAgentError
from pd_editor.editor.commands import (
    AddGuidance,
    BeginAt,
    ChangeGuidance,
    ContinueScene,
    SetAgentSpeed,
    SetLocks,
    SetRoadWarp,
)
from pd_editor.editor.commands.roll_out import RolledMotion
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import exported_files, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.bundle import write_files
from pd_editor.scene.guidance_terms import LEAST_AT_S
from pd_editor.scene.locks import TRAJECTORY_LOCK, Lock
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.editor.same_scenario import same_tracks

BASE = open_scenario("roundabout")
NOW = BASE.current_step
BEND = RoadWarp(
    anchor=pose_of_anchor(BASE, "focal"),
    terms=(WarpTerm(kind="smooth-turn", power=4.0, length_m=30.0),),
)


def rolled(scenario: Scenario, seconds: float = 10.0) -> ContinueScene:
    """Everybody who is there drives straight on."""
    now, count = scenario.current_step, round(seconds / 0.1) + 1
    agents = scenario.agents.cut_to(slice(now, now + 1))
    agents = agents.taken(agents.is_valid[:, 0])
    longer = agents.without_future(0, count)
    every = np.ones((len(agents), count), bool)
    time = np.arange(count)[:, None] * 0.1
    longer = replace(
        longer,
        position_m=agents.position_m + agents.velocity_mps * time,
        velocity_mps=np.repeat(agents.velocity_mps, count, axis=1),
        heading_rad=np.repeat(agents.heading_rad, count, axis=1),
        is_valid=every,
    )
    return ContinueScene(motion=RolledMotion.of(longer), generator="test")


@given(steps=st.integers(-NOW, BASE.time_axis.num_future_steps - 1))
def test_another_moment_is_the_same_motion(steps: int):
    begun = BeginAt(time_s=steps * 0.1).apply(BASE)
    shift = max(steps, 0)
    assert begun.current_step == min(NOW + steps, 49)
    assert begun.time_axis.num_steps == BASE.time_axis.num_steps - shift
    for row, name in enumerate(begun.agents.ids):
        was = BASE.agents.row_of[name]
        for field in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
            np.testing.assert_array_equal(
                getattr(begun.agents, field)[row],
                getattr(BASE.agents, field)[was, shift:],
            )
    is_past = begun.time_axis.is_past
    np.testing.assert_array_equal(
        begun.agents.observed, begun.agents.is_valid & is_past
    )
    now = begun.current_step
    assert begun.agents.is_valid[begun.agents.row_of[begun.focal_id], now]
    # Nothing of the recording is held against the user.
    command = BeginAt(time_s=steps * 0.1)
    assert not edit_findings(begun, BASE, [command]).new


@pytest.mark.parametrize(
    ("time_s", "told"),
    [
        (7.0, "t = 7 s is not in the scene; expected -4.9 to 6.0 s."),
        (-6.0, "t = -6 s is not in the scene; expected -4.9 to 6.0 s."),
        (float("nan"), "t = nan s is no time; expected a number."),
        (float("inf"), "t = inf s is no time; expected a number."),
    ],
)
def test_no_such_moment(time_s: float, told: str):
    with pytest.raises(EditError) as caught:
        BeginAt(time_s=time_s).apply(BASE)
    assert str(caught.value) == told


def test_a_moment_without_anybody():
    alone = BASE.without_agents(BASE.agents.ids[1:])
    agents = alone.agents.without_future(NOW, alone.agents.num_steps)
    with pytest.raises(EditError, match=r"Nobody is there at t = 2 s\."):
        BeginAt(time_s=2.0).apply(replace(alone, agents=agents))


def test_roll_out_branch_and_roll_out_again():
    session = EditorSession(BASE)
    session.apply(rolled(BASE, 20.0))
    session.apply(BeginAt(time_s=18.0))
    begun = session.scenario
    assert (begun.current_step, begun.time_axis.num_future_steps) == (49, 20)
    assert not np.isin(session.original.agents.ids, begun.agents.ids).any()
    session.apply(rolled(begun, 20.0))
    assert session.scenario.time_axis.num_future_steps == 200
    assert session.name == "roundabout-rolled-out-s0-from-18s-rolled-out-s0"
    text = session.recipe().to_text()
    assert same_tracks(
        replay(Recipe.from_text(text), BASE).agents, session.scenario.agents
    )
    session.jump_to(0)
    assert session.scenario is BASE is session.original


def test_what_is_compared_is_the_same_moment():
    session = EditorSession(BASE)
    session.apply(BeginAt(time_s=2.0))
    assert same_tracks(session.original.agents, session.scenario.agents)
    first = session.original
    session.apply(SetAgentSpeed(agent_ids=(BASE.focal_id,), speed_mps=3.0))
    assert session.original is first


def test_a_bent_road_is_straightened_after_a_branch():
    session = EditorSession(BASE)
    session.apply(SetRoadWarp(warp=BEND, friction_coefficient=0.3))
    session.apply(BeginAt(time_s=2.0))
    session.apply(SetRoadWarp(warp=None))
    straight = BeginAt(time_s=2.0).apply(BASE)
    assert same_tracks(session.scenario.agents, straight.agents)


def test_a_roll_out_on_a_bent_road_is_straightened():
    """It failed, for the tracks had become longer."""
    session = EditorSession(BASE)
    session.apply(SetRoadWarp(warp=BEND))
    session.apply(rolled(session.scenario))
    bent = session.scenario.agents
    assert edit_findings(session.scenario, BASE, session.commands_in_force)
    session.apply(SetRoadWarp(warp=None))
    assert session.scenario.road_map is BASE.road_map
    again = SetRoadWarp(warp=BEND).apply(session.scenario).agents
    np.testing.assert_allclose(again.position_m, bent.position_m, atol=1e-6)


def test_locks_and_guidance():
    session, (first, second, *_) = EditorSession(BASE), BASE.agents.ids
    session.apply(SetLocks(agent_ids=(second,), lock=Lock(kept_s=2.0)))
    with pytest.raises(LockedAgentError):
        session.apply(rolled(session.scenario))
    session.undo()
    goal = GoalPoint(agent_id=first, point_m=(1.0, 2.0))
    session.apply(AddGuidance(term=goal))
    session.apply(SetLocks(agent_ids=(first,), lock=TRAJECTORY_LOCK))
    before = session.scenario.agents
    session.apply(rolled(session.scenario))
    after = session.scenario.agents
    np.testing.assert_array_equal(
        after.position_m[after.row_of[first], : before.num_steps],
        before.position_m[before.row_of[first]],
    )
    session.apply(BeginAt(time_s=1.0, keeps_guidance=True))
    assert dict(session.scenario.locks) == {first: TRAJECTORY_LOCK}
    assert session.scenario.guidance == (goal,)


def test_a_former_recipe_counts_terms_from_none():
    """It gives terms by their index, and its starts left guidance out."""
    first, second, *_ = BASE.agents.ids
    session = EditorSession(BASE)
    session.apply(AddGuidance(term=GoalPoint(agent_id=first, point_m=(1.0, 2.0))))
    session.apply(BeginAt(time_s=1.0))
    again = GoalPoint(agent_id=second, point_m=(3.0, 4.0))
    session.apply(AddGuidance(term=again))
    moved = replace(again, point_m=(5.0, 6.0))
    session.apply(ChangeGuidance(index=0, term=moved))
    text = session.recipe().to_text()
    former = re.sub(r'"keeps_guidance": false,?\s*', "", text)
    former = re.sub(r",(\s*})", r"\1", former)
    assert former != text
    found = replay(Recipe.from_text(former), BASE)
    assert found.guidance == (moved,)


@given(steps=st.integers(1, 50), at_s=st.floats(0.5, 6.0))
def test_guidance_goes_on_by_the_new_clock(steps: int, at_s: float):
    agents = BASE.agents
    goes = agents.is_valid[:, NOW:].all(axis=1) & (agents.speed_mps()[:, NOW] > 3)
    row, other = np.flatnonzero(goes)[:2].tolist()
    name, line = agents.ids[row], agents.position_m[row, NOW::10]
    goal = GoalPoint(agent_id=name, point_m=(1.0, 2.0), at_s=at_s)
    path = FollowPath(agent_id=name, points_m=tuple(map(tuple, line.tolist())))
    speed = TargetSpeed(agent_ids=(), speed_mps=5.0)
    gone = replace(goal, agent_id=agents.ids[other])
    is_past = np.arange(agents.num_steps) <= NOW
    left = agents.with_rows(
        np.array([other]), is_valid=agents.is_valid[[other]] & is_past
    )
    asked = replace(BASE, agents=left, guidance=(speed, goal, path, gone))
    begun = BeginAt(time_s=steps * 0.1, keeps_guidance=True).apply(asked)
    rest = {type(one): one for one in begun.guidance}
    assert rest[TargetSpeed] == speed
    now = begun.current_step
    place = begun.agents.position_m[begun.agents.row_of[name], now]
    if GoalPoint in rest:
        assert rest[GoalPoint].agent_id == name
        assert rest[GoalPoint].at_s == pytest.approx(at_s - steps * 0.1, abs=1e-3)
    else:
        assert at_s - steps * 0.1 < LEAST_AT_S + 1e-3
    # It begins at most a little behind the agent, and ends where it did.
    kept = rest[FollowPath].points_m
    assert np.linalg.norm(kept[0] - place) < 5 + 2.0
    assert kept[-1] == path.points_m[-1]
    before = replace(BASE, guidance=(speed, goal, path))
    back = BeginAt(time_s=-2.0, keeps_guidance=True).apply(before)
    assert back.guidance == (speed, replace(goal, at_s=round(at_s + 2, 3)), path)


def test_a_branch_is_exported(tmp_path):
    session = EditorSession(BASE)
    session.apply(BeginAt(time_s=2.0))
    files = exported_files(session.scenario, session.recipe(), BASE)
    folder = tmp_path / session.name
    write_files(files, folder, forbidden=None)
    check_with_official_loaders(folder)
    again = open_scenario(str(folder))
    assert again.current_step == session.scenario.current_step
    assert again.time_axis.num_steps == session.scenario.time_axis.num_steps
