"""Outcomes and costs of guided samples."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import StayOnRoad
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.analysis.guidance.report import (
    AgentRealism,
    guidance_reports,
    motion_problems,
    term_outcomes,
)
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm
from tests.builders import scenario_with, straight_drivers

SCENE = scenario_with(straight_drivers([(0, 0, 0, 10), (-30, 3.5, 0, 5)]))


def recorded(shift_m: float = 0.0, pace: float = 1.0) -> TrafficSample:
    """The recorded trajectories from the current step on, drifting aside, at a pace."""
    agents, now = SCENE.agents, SCENE.current_step
    position = agents.position_m[:, now:].copy()
    share = np.linspace(0, 1, position.shape[1])
    position = position[:, :1] + pace * (position - position[:, :1])
    position[..., 1] += shift_m * share
    return TrafficSample(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        position_m=position,
        heading_rad=agents.heading_rad[:, now:],
        velocity_mps=pace * agents.velocity_mps[:, now:],
    )


def braking() -> TrafficSample:
    """The same, but the second agent stops within a second."""
    sample = recorded()
    position = sample.position_m.copy()
    time = np.minimum(0.1 * np.arange(position.shape[1]), 1.0)
    position[1, :, 0] = -30 + 5 * time - 2.5 * time**2
    return replace(sample, position_m=position)


@pytest.mark.parametrize(
    ("term", "error", "is_obeyed"),
    [
        (GoalPoint(agent_id="100", point_m=(60.0, 0.0)), 0.0, True),
        (GoalPoint(agent_id="100", point_m=(60.0, 2.0)), 2.0, False),
        (GoalPoint(agent_id="100", point_m=(20.0, 0.0), at_s=2.0), 0.0, True),
        (TargetSpeed(agent_ids=("101",), speed_mps=5.0), 0.0, True),
        (TargetSpeed(speed_mps=5.0), 5.0, False),
        (SpeedLimit(speed_mps=10.2), 0.0, True),
        (SpeedLimit(agent_ids=("101",), speed_mps=2.0), 3.0, False),
        (StopAtLine(agent_id="101", line_m=((9.0, 2.0), (9.0, 5.0))), 0.0, True),
        (FollowLane(agent_id="100", lane_ids=(1, 2)), 0.0, True),
        (FollowPath(agent_id="100", points_m=((0.0, 0.0), (61.0, 0.0))), 0.0, True),
        (ComfortLimits(), 0.0, True),
        (StayOnRoad(), 0.0, True),
    ],
)
def test_errors_are_those_of_the_motion(term: GuidanceTerm, error, is_obeyed):
    (found,) = term_outcomes(SCENE, recorded(), (term,))
    assert found.error == pytest.approx(error, abs=0.15)
    assert found.is_obeyed is is_obeyed
    assert found.asked
    assert found.achieved


@pytest.mark.parametrize(
    ("start_mps", "braking_mps2", "achieved", "is_obeyed"),
    [
        (10.0, 2.0, "at most 8.0 m/s once braked from 10.0 m/s", True),
        (25.0, 2.0, "still braking from 25.0 m/s at the end", True),
        (
            10.0,
            0.5,
            "at most 9.5 m/s, 1.5 more than braking from 10.0 m/s allows",
            False,
        ),
        (7.0, -0.5, "at most 10.0 m/s", False),
        (7.0, 0.0, "at most 7.0 m/s", True),
    ],
)
def test_a_limit_below_a_speed_of_now_tells_what_was_braked_from(
    start_mps, braking_mps2, achieved, is_obeyed
):
    """The speed before the braking was told as what an obeyed limit had achieved."""
    sample = recorded()
    velocity = sample.velocity_mps.copy()
    time = 0.1 * np.arange(velocity.shape[1])
    least = min(start_mps, 8.0)
    velocity[0, :, 0] = np.maximum(start_mps - braking_mps2 * time, least)
    term = SpeedLimit(agent_ids=("100",), speed_mps=8.0)
    (found,) = term_outcomes(SCENE, replace(sample, velocity_mps=velocity), (term,))
    assert found.achieved == achieved
    assert found.is_obeyed is is_obeyed


def test_an_overrun_is_measured_at_the_front():
    line = StopAtLine(agent_id="100", line_m=((50.0, -2.0), (50.0, 2.0)))
    (found,) = term_outcomes(SCENE, recorded(), (line,))
    length = SCENE.agents.size_m[0, 0]
    assert found.error == pytest.approx(60.0 + length / 2 - 50.0, abs=0.01)
    assert "crosses it by" in found.achieved


@pytest.mark.parametrize(
    ("line_x_m", "is_obeyed"), [(63.0, False), (71.0, False), (76.0, True)]
)
def test_an_agent_that_is_too_fast_to_stop_before_the_line_does_not_obey(
    line_x_m, is_obeyed
):
    """Agent 100 ends with 10 m/s, which takes 10 m to stop at 5 m/s2."""
    line = StopAtLine(agent_id="100", line_m=((line_x_m, -2.0), (line_x_m, 2.0)))
    (found,) = term_outcomes(SCENE, recorded(), (line,))
    assert found.is_obeyed is is_obeyed
    assert ("too fast to stop there" in found.achieved) is not is_obeyed
    length = SCENE.agents.size_m[0, 0]
    past = 60.0 + length / 2 + 10.0 - line_x_m
    assert found.error == pytest.approx(max(past, 0.0), abs=0.1)


def test_slowed_agents_and_absent_ones():
    goal = GoalPoint(agent_id="100", point_m=(60.0, 0.0))
    (found,) = term_outcomes(SCENE, recorded(), (goal,), (goal,), ("100",))
    assert "slowed to avoid a collision" in found.achieved
    assert not found.is_feasible
    (found,) = term_outcomes(SCENE, braking(), (ComfortLimits(),), (), ("101",))
    assert "more braking, slowed to avoid a collision" in found.achieved
    (found,) = term_outcomes(SCENE, braking(), (ComfortLimits(),), (), ("100",))
    assert "slowed" not in found.achieved
    only = recorded()
    only = TrafficSample(
        ids=only.ids[1:],
        kinds=only.kinds[1:],
        size_m=only.size_m[1:],
        position_m=only.position_m[1:],
        heading_rad=only.heading_rad[1:],
        velocity_mps=only.velocity_mps[1:],
    )
    (found,) = term_outcomes(SCENE, only, (goal,))
    assert not found.is_run
    assert "agent 100 is not regenerated" in found.achieved


def test_a_worse_sample_holds_the_best_unguided_one():
    """A drift off the road is worse; the unguided sample is offered."""
    goal = GoalPoint(agent_id="100", point_m=(60.0, 30.0))
    good, bad = recorded(), recorded(shift_m=30.0)
    _, report = guidance_reports(SCENE, (bad, bad), (goal,), (bad, good))
    assert report.cost is not None
    assert report.cost.is_worse
    assert any("off the road" in one for one in report.cost.worse())
    assert report.unguided is good
    (same,) = guidance_reports(SCENE, (good,), (goal,), (good,))
    assert same.cost is not None
    assert not same.cost.is_worse
    assert same.unguided is None


def test_realism_counts_collisions_and_distance():
    near = recorded(pace=4.0)
    assert AgentRealism.of(SCENE, recorded()).over().num_collisions == 0
    together = replace(near, position_m=near.position_m.copy())
    together.position_m[1, 20:] = together.position_m[0, 20:]
    assert AgentRealism.of(SCENE, together).over().num_collisions == 2
    assert (
        AgentRealism.of(SCENE, recorded(shift_m=8.0)).over().lateral_deviation_m > 1.0
    )


def test_impossible_motion_is_told():
    assert motion_problems(SCENE, recorded()) == ()
    swerve = recorded()
    position = swerve.position_m.copy()
    position[0, :, 1] += 8 * np.sin(np.arange(position.shape[1]) / 4)
    (found,) = motion_problems(SCENE, replace(swerve, position_m=position))
    assert "Agent 100" in found
    back = replace(swerve, position_m=swerve.position_m.copy())
    back.position_m[0, :, 0] = 20 * np.sin(np.linspace(0, 2.5, 61))
    assert any("backwards" in one for one in motion_problems(SCENE, back))


def test_the_cost_of_a_term_is_that_of_its_agents():
    terms = (
        GoalPoint(agent_id="100", point_m=(60.0, 0.0)),
        TargetSpeed(agent_ids=("101",), speed_mps=5.0),
        SpeedLimit(speed_mps=30.0),
    )
    moved = recorded(shift_m=3.0)
    position = moved.position_m.copy()
    position[1] = recorded().position_m[1]
    (report,) = guidance_reports(
        SCENE, [replace(moved, position_m=position)], terms, [recorded()]
    )
    costs = [one.cost for one in report.outcomes]
    assert all(cost is not None for cost in costs)
    first, second, every = (cost for cost in costs if cost is not None)
    # Only the first agent drifted aside.
    further = [c.guided.lateral_deviation_m - c.unguided.lateral_deviation_m
               for c in (first, second, every)]  # fmt: skip
    assert further[0] > 0.9
    assert further[1] == 0.0
    assert further[2] == pytest.approx(further[0] / 2, rel=0.01)
    assert first.is_worse
    assert not second.is_worse
    assert every == report.cost
    (alone,) = guidance_reports(SCENE, [moved], terms)
    assert all(one.cost is None for one in alone.outcomes)
