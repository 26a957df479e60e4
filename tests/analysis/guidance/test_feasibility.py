"""Problems of guidance terms before a run, each told with what could be done."""

from dataclasses import replace

import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import KeepGap
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, StopAtLine, TargetSpeed
from pd_editor.analysis.guidance.report import guidance_problems, infeasible_terms
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import TRAJECTORY_LOCK
from tests.builders import scenario_with, straight_drivers
from tests.editor.command_strategies import ABSENT_ID, busy_scenario

SCENE = scenario_with(straight_drivers([(0, 0, 0, 10), (-30, 3.5, 0, 5)]))

FEASIBLE = (
    GoalPoint(agent_id="100", point_m=(55.0, 0.5)),
    GoalPoint(agent_id="100", point_m=(20.0, 0.0), at_s=2.5),
    GoalPoint(agent_id="100", point_m=(60.0, 3.5)),
    TargetSpeed(agent_ids=("100",), speed_mps=15.0),
    SpeedLimit(speed_mps=5.0),
    StopAtLine(agent_id="100", line_m=((40.0, -2.0), (40.0, 2.0))),
    FollowPath(agent_id="100", points_m=((0.0, 0.0), (60.0, 2.0))),
    FollowLane(agent_id="100", lane_ids=(3, 4)),
)


@pytest.mark.parametrize("term", FEASIBLE, ids=lambda term: term.kind)
def test_what_can_be_met_has_no_problem(term: GuidanceTerm):
    assert guidance_problems(SCENE, (term,), ("100", "101")) == ()


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (GoalPoint(agent_id="100", point_m=(150.0, 0.0)), "at most"),
        (GoalPoint(agent_id="100", point_m=(3.0, 0.0)), "to stop"),
        (GoalPoint(agent_id="100", point_m=(40.0, 80.0)), "off the road"),
        (GoalPoint(agent_id="100", point_m=(-30.0, 0.0)), "paths"),
        (GoalPoint(agent_id="100", point_m=(55.0, 0.0), at_s=20.0), "last 6.0 s"),
        (TargetSpeed(agent_ids=("100",), speed_mps=50.0), "ask for less"),
        (StopAtLine(agent_id="100", line_m=((5.0, -2.0), (5.0, 2.0))), "brake with"),
        (StopAtLine(agent_id="100", line_m=((1.0, -2.0), (1.0, 2.0))), "already"),
        (StopAtLine(agent_id="100", line_m=((40.0, 50.0), (40.0, 60.0))), "none of"),
        (
            FollowPath(agent_id="100", points_m=((0.0, 80.0), (50.0, 80.0))),
            "begins 80 m away",
        ),
        (
            FollowPath(
                agent_id="100", points_m=((0.0, 0.0), (15.0, 0.0), (15.0, 30.0))
            ),
            "too sharply",
        ),
        (FollowPath(agent_id="100", points_m=((-30.0, 0.0), (-10.0, 0.0))), "behind"),
        (FollowLane(agent_id="100", lane_ids=(1, 4)), "does not follow lane 1"),
    ],
)
def test_what_cannot_be_met_is_a_warning(term: GuidanceTerm, said: str):
    problems = guidance_problems(SCENE, (term,))
    assert {one.severity for one in problems} == {"warning"}
    assert any(said in one.message for one in problems), problems
    assert infeasible_terms(problems) == (term,)


QUEUE = scenario_with(
    straight_drivers([(0, 0, 0, 10), (30, 0, 0, 0), (37, 0.3, 0, 0), (30, 3.5, 0, 10)])
)


@pytest.mark.parametrize(
    ("goal", "others", "is_blocked"),
    [
        ((50.0, 0.0), (), True),
        ((28.0, 0.0), (), True),
        ((22.0, 0.0), (), False),
        ((50.0, 3.5), (), False),
        ((50.0, 0.0), (TargetSpeed(agent_ids=("101", "102"), speed_mps=9.0),), False),
        ((50.0, 0.0), (TargetSpeed(agent_ids=("101",), speed_mps=9.0),), True),
    ],
)
def test_a_goal_behind_agents_that_stand_is_a_warning(goal, others, is_blocked):
    """Agents that are asked to drive away block nothing."""
    term = GoalPoint(agent_id="100", point_m=goal)
    problems = guidance_problems(QUEUE, (term, *others))
    assert [one.term for one in problems] == [term] * is_blocked
    if is_blocked:
        first = "102" if others else "101"
        assert problems[0].message == (
            f"Agent {first} stands on the way of agent 100 to its goal; put the goal "
            "before it, or move it away."
        )


def test_a_gap_of_named_agents_that_stand_behind_others_is_a_warning():
    """Without names it is of those that can keep it."""
    gap = KeepGap(agent_ids=("101",), gap_m=4.0)
    (problem,) = guidance_problems(QUEUE, (gap,))
    assert "stands 2.4 m behind an agent" in problem.message
    for other in (
        replace(gap, agent_ids=()),
        replace(gap, agent_ids=("100", "102", "103")),
        replace(gap, gap_m=2.0),
    ):
        assert guidance_problems(QUEUE, (other,)) == ()


def test_agents_that_are_gone_absent_locked_or_left_out_are_told():
    goal = GoalPoint(agent_id="100", point_m=(55.0, 0.0))
    (gone,) = guidance_problems(SCENE, (replace(goal, agent_id="9"),))
    assert gone.severity == "error"
    assert "is gone" in gone.message
    (absent,) = guidance_problems(busy_scenario(), (replace(goal, agent_id=ABSENT_ID),))
    assert "not there at t = 0" in absent.message
    locked = replace(SCENE, locks={"100": TRAJECTORY_LOCK})
    (problem,) = guidance_problems(locked, (goal,))
    assert problem.severity == "error"
    assert "unlock it" in problem.message
    (left_out,) = guidance_problems(SCENE, (goal,), ("101",))
    assert "not regenerated" in left_out.message


def test_contradictions_are_told_once():
    fast = TargetSpeed(agent_ids=("100",), speed_mps=12.0)
    limit = SpeedLimit(speed_mps=8.0)
    (found,) = guidance_problems(SCENE, (fast, limit))
    assert found.term == limit
    assert "12 m/s above its speed limit of 8 m/s" in found.message
    slow = TargetSpeed(speed_mps=3.0)
    (found,) = guidance_problems(SCENE, (fast, slow))
    assert "keep one" in found.message
    assert guidance_problems(SCENE, (fast, replace(slow, is_on=False))) == ()


def told(*terms: GuidanceTerm) -> str:
    return " ".join(
        one.message for one in guidance_problems(SCENE, terms, SCENE.agents.ids)
    )


def test_a_goal_beyond_what_a_speed_limit_allows_is_told():
    goal = GoalPoint(agent_id="100", point_m=(55.0, 0.0))
    words = "at its speed limit of 3 m/s it gets at most"
    assert words in told(goal, SpeedLimit(speed_mps=3.0))
    assert words in told(SpeedLimit(agent_ids=("100",), speed_mps=3.0), goal)
    assert words not in told(goal, SpeedLimit(agent_ids=("101",), speed_mps=3.0))
    assert words not in told(goal, SpeedLimit(speed_mps=9.5))
    near = GoalPoint(agent_id="100", point_m=(22.0, 0.0))
    assert words not in told(near, SpeedLimit(speed_mps=3.0))


def test_a_goal_beyond_a_stop_line_is_told():
    line = StopAtLine(agent_id="100", line_m=((40.0, -2.0), (40.0, 2.0)))
    assert "beyond the line" in told(
        GoalPoint(agent_id="100", point_m=(55.0, 0.0)), line
    )
    assert "beyond" not in told(GoalPoint(agent_id="100", point_m=(35.0, 0.0)), line)
    assert "beyond" not in told(GoalPoint(agent_id="101", point_m=(0.0, 3.5)), line)


def test_a_speed_to_keep_contradicts_a_stop_line():
    line = StopAtLine(agent_id="100", line_m=((40.0, -2.0), (40.0, 2.0)))
    words = "is asked to keep 8.5 m/s and to stop at a line"
    assert words in told(TargetSpeed(agent_ids=("100",), speed_mps=8.5), line)
    assert words in told(line, TargetSpeed(speed_mps=8.5))
    assert words not in told(line, TargetSpeed(agent_ids=("101",), speed_mps=8.5))
    assert words not in told(line, SpeedLimit(speed_mps=8.5))
