"""Guidance and locks hold in a roll-out, from window to window."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, StopAtLine, TargetSpeed
from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import AddGuidance, SetLocks
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.roll_out import RollOutRequest, guidance_now
from pd_editor.experiments.closed_loop.world import HORIZON, World
from pd_editor.scene.locks import Lock
from tests.builders import scenario_with, straight_drivers
from tests.experiments.closed_loop.test_roll_out import rolled

TIMES = st.floats(0.1, 40.0).map(lambda one: round(one, 1))
DRIVERS = straight_drivers([(0, 0, 0, 5), (-50, 0, 0, 5)])


@pytest.fixture(scope="module")
def junction():
    return open_scenario("signalised-junction")


@given(TIMES, TIMES, TIMES)
def test_two_delays_are_one(at_s, first, second):
    goal = GoalPoint(agent_id="a", point_m=(0.0, 0.0), at_s=at_s)
    path = FollowPath(
        agent_id="a",
        points_m=((0.0, 0.0), (5.0, 0.0), (9.0, 0.0)),
        times_s=(None, at_s, at_s + 3),
    )
    for term in (goal, path, TargetSpeed(speed_mps=3.0)):
        once = term.later(first + second)
        twice = term.later(first)
        assert (twice and twice.later(second)) == once
    if at_s - first > 0.05:
        assert goal.later(first).at_s == pytest.approx(at_s - first)
    else:
        assert goal.later(first) is None


def later(*terms, steps: int, moves_m: float = 0.0) -> tuple:
    """What is left of terms of the first driver when it has moved straight on."""
    scene = replace(scenario_with(DRIVERS), guidance=terms)
    world = World.beginning(scene, 400, seed=0)
    agents, now = world.scenario.agents, scene.current_step
    position = np.repeat(agents.position_m[:, [now]], agents.num_steps, axis=1)
    way = np.linspace(0, moves_m, steps + 1)
    position[0, now : now + steps + 1, 0] += way
    agents = agents.with_rows(
        np.arange(len(agents)),
        position_m=position,
        is_valid=np.ones_like(agents.is_valid),
    )
    world = replace(
        world, step=now + steps, scenario=replace(world.scenario, agents=agents)
    )
    return guidance_now(world, world.window(), agents.ids)


def goal(at_s: float | None, x: float = 60.0) -> GoalPoint:
    return GoalPoint(agent_id=DRIVERS.ids[0], point_m=(x, 0.0), at_s=at_s)


def test_a_far_goal_is_a_path_with_a_time_until_it_is_near():
    (way,) = later(goal(20.0), steps=0)
    assert isinstance(way, FollowPath)
    assert (way.points_m[-1], way.times_s[-1]) == ((60.0, 0.0), 20.0)
    (near,) = later(goal(20.0), steps=150, moves_m=30.0)
    assert near == goal(5.0)
    assert not later(goal(20.0), steps=200)
    (end,) = later(goal(None), steps=0)
    assert end.times_s[-1] == 40.0


def test_who_is_at_its_goal_early_stays():
    (stays,) = later(goal(20.0), steps=100, moves_m=60.0)
    assert stays == goal(HORIZON / 10)


def test_one_goal_comes_after_the_other():
    first, second = goal(3.0, 10.0), goal(20.0)
    assert later(second, first, steps=0) == (first,)
    (way,) = later(second, first, steps=30)
    assert isinstance(way, FollowPath)
    assert later(second, goal(12.0, 30.0), steps=0)[0].times_s[-1] == 12.0


def test_of_a_path_that_crosses_itself_the_rest_is_left():
    """At the crossing the agent would have turned back onto its beginning."""
    line = ((0, 0), (100, 0), (100, 60), (40, 60), (40, -40))
    path = FollowPath(
        agent_id=DRIVERS.ids[0], points_m=tuple((float(x), float(y)) for x, y in line)
    )
    assert later(path, steps=0) == (path,)
    (rest,) = later(path, steps=60, moves_m=41.0)
    assert rest.points_m[0][0] == pytest.approx(36.0, abs=1.0)
    assert rest.points_m[1:] == path.points_m[1:]
    short = replace(path, points_m=((0.0, 0.0), (30.0, 0.0)))
    assert not later(short, steps=60, moves_m=40.0)


def test_terms_of_agents_that_are_not_generated_are_left_out():
    gone = replace(goal(3.0), agent_id="gone")
    limit = SpeedLimit(speed_mps=3.0)
    assert later(gone, replace(goal(3.0), is_on=False), limit, steps=0) == (limit,)


def test_guidance_and_locks_hold(junction):
    """A window began without any."""
    agents, now = junction.agents, junction.current_step
    speed = np.where(
        agents.is_valid[:, now:].all(axis=1), agents.speed_mps()[:, now], 0
    )
    fast, other, locked = (agents.ids[row] for row in np.argsort(-speed)[:3])
    free = rolled(junction, model="path-diffuser", duration_s=10.0)
    aim = free.scenario.agents
    assert free.guidance == ()
    row = aim.row_of[fast]
    place = aim.position_m[row, now + 80]
    assert aim.is_valid[row, now + 80]
    # A bit later than it would be there.
    asked = GoalPoint(
        agent_id=fast, point_m=(float(place[0]), float(place[1])), at_s=9.0
    )
    session = EditorSession(junction)
    session.apply(SetLocks(agent_ids=(locked,), lock=Lock(kept_s=3.0)))
    session.apply(AddGuidance(term=asked))
    session.apply(AddGuidance(term=SpeedLimit(agent_ids=(other,), speed_mps=2.0)))
    found = rolled(session.scenario, model="path-diffuser", duration_s=10.0)
    reached, limited = found.guidance
    assert reached.is_obeyed
    assert reached.asked.endswith("after 9.0 s")
    assert reached.error < 1.0
    assert limited.is_obeyed
    session.apply(found.command)
    after = session.scenario.agents
    for field in ("position_m", "heading_rad", "velocity_mps"):
        kept = getattr(after, field)[after.row_of[locked], : now + 31]
        was = getattr(agents, field)[agents.row_of[locked], : now + 31]
        np.testing.assert_array_equal(kept, was)
    late = np.linalg.norm(
        after.position_m[after.row_of[fast], now + 80] - np.array(asked.point_m)
    )
    assert late > 1.0


def test_who_leaves_is_judged_up_to_then(junction):
    now = junction.current_step
    stop = StopAtLine(agent_id="AV", line_m=((500.0, 0.0), (503.0, 0.0)))
    scene = replace(junction, guidance=(stop,))
    found = rolled(scene, duration_s=12.0)
    there = found.scenario.agents
    left = int(there.is_valid[there.row_of["AV"], now:].sum())
    (one,) = found.guidance
    assert one.achieved.endswith(f"; left the map at {left / 10:.1f} s")


def test_a_policy_drives_nobody_that_is_locked(junction):
    scene = SetLocks(agent_ids=("AV",), lock=Lock(kept_s=2.0)).apply(junction)
    with pytest.raises(GenerationError, match="first 2 s of agent AV is locked, so no"):
        RollOutRequest(scenario=scene, policies={"AV": policy_of("idm")})


@pytest.mark.slow
def test_a_goal_at_fifteen_seconds_is_reached(av2_root):
    scene = open_scenario(sorted((av2_root / "val").iterdir())[0])
    options = {"model": "path-diffuser", "duration_s": 16.0}
    other, at = (
        rolled(scene, seed=1, **options).scenario.agents,
        scene.current_step + 150,
    )
    terms = tuple(
        GoalPoint(
            agent_id=name,
            point_m=tuple(map(float, other.position_m[other.row_of[name], at])),
            at_s=15.0,
        )
        for name in ("78037", "78104")
    )
    for one in rolled(replace(scene, guidance=terms), **options).guidance:
        assert one.error < 1.0
