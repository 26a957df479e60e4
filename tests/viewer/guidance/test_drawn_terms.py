"""Terms made from points and lines on the road."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import (
    MAX_DRAWN_POINTS,
    FollowLane,
    FollowPath,
)
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, StopAtLine, TargetSpeed
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.guidance.guidance_panel import about_in_words
from tests.builders import scenario_with, straight_drivers


@pytest.fixture
def scenario():
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN)
    states = [(0.0, 0.0, 0.0, 8.2), (5.0, 8.0, 0.0, 1.0)]
    return scenario_with(straight_drivers(states, kinds=kinds))


def test_a_goal_is_taken_on_the_road_and_refused_off_the_map(scenario):
    assert GoalPoint.drawn(scenario, "100", np.array([40.001, 2.0])[None]).point_m == (
        40.0,
        2.0,
    )
    with pytest.raises(EditError, match="45 m off the road"):
        GoalPoint.drawn(scenario, "100", np.array([40.0, 50.0])[None])
    # Pavements are no part of the drivable area.
    assert GoalPoint.drawn(scenario, "101", np.array([40.0, 15.0])[None]).point_m == (
        40.0,
        15.0,
    )
    with pytest.raises(EditError, match="10 m off the road"):
        GoalPoint.drawn(scenario, "100", np.array([40.0, 15.0])[None])


def test_terms_of_other_agents_are_told_of(scenario):
    """Without a word, a term seemed lost when another agent was selected."""
    goal = GoalPoint.drawn(scenario, "100", np.array([40.0, 2.0])[None])
    guided = replace(scenario, guidance=(goal, SpeedLimit(speed_mps=8.0)))
    assert about_in_words(guided, ("100",)) == "Guidance of vehicle 100"
    assert about_in_words(guided, ("101",)).endswith("101; 1 more of other agents")


def test_a_drawn_line_becomes_a_path_of_few_points(scenario):
    along = np.linspace(0.0, 60.0, 400)
    drawn = np.column_stack([along, 1.5 * np.sin(along / 12.0)])
    term = FollowPath.drawn(
        scenario, "100", drawn + 0.02 * np.sin(97.0 * along)[:, None]
    )
    assert 4 <= len(term.points_m) <= 12
    ends = np.array(term.points_m)[[0, -1]]
    assert np.abs(ends - drawn[[0, -1]]).max() < 0.1
    rough = drawn + np.random.default_rng(0).normal(0.0, 1.0, drawn.shape)
    assert len(FollowPath.drawn(scenario, "100", rough).points_m) <= MAX_DRAWN_POINTS


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0.0, 0.0], [2.0, 0.0]], "too short"),
        ([[0.0, 0.0]], "too short"),
        ([[0.0, 0.0], [20.0, 0.0], [20.0, 40.0]], "35 m off the road"),
    ],
)
def test_lines_that_are_no_path_are_refused(scenario, points, words):
    with pytest.raises(EditError, match=words):
        FollowPath.drawn(scenario, "100", np.array(points).reshape(-1, 2))


def test_a_stop_line_crosses_the_lane_that_is_clicked(scenario):
    term = StopAtLine.drawn(scenario, "100", np.array([30.0, 3.0])[None])
    assert term == StopAtLine(agent_id="100", line_m=((30.0, 5.25), (30.0, 1.75)))
    with pytest.raises(EditError, match="no lane here"):
        StopAtLine.drawn(scenario, "100", np.array([30.0, 20.0])[None])


def test_lanes_lead_from_the_agent_to_the_clicked_one(scenario):
    term = FollowLane.drawn(scenario, "100", np.array([120.0, 0.3])[None])
    assert term == FollowLane(agent_id="100", lane_ids=(1, 2))
    with pytest.raises(EditError, match="without a lane change"):
        FollowLane.drawn(scenario, "100", np.array([120.0, 3.4])[None])
    with pytest.raises(EditError, match="no lane here"):
        FollowLane.drawn(scenario, "100", np.array([120.0, 30.0])[None])


def test_terms_of_the_form_start_from_the_traffic(scenario):
    speed = KINDS["target-speed"].usual_term(scenario, ("100",))
    assert speed == TargetSpeed(agent_ids=("100",), speed_mps=8.0)
    limit = KINDS["speed-limit"].usual_term(scenario, ())
    assert limit == SpeedLimit(agent_ids=(), speed_mps=8.0)


def test_every_kind_of_term_can_be_made_by_hand(scenario):
    for name, kind in KINDS.items():
        if kind.tool is None:
            term = kind.usual_term(scenario, ("100",))
            assert (term.kind, term.guided_ids) == (name, ("100",))
        else:
            assert (kind.tool.draw is None) == (kind.tool.gesture == "pick")


def test_on_a_warped_road_the_map_is_where_it_is_drawn(scenario):
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    warp = RoadWarp(
        anchor=anchor, terms=(WarpTerm(kind="smooth-turn", power=8.0, length_m=10.0),)
    )
    warped = warp_scenario(scenario, warp)
    lane = warped.road_map.lane_of[2]
    point = lane.centerline_m[-1]
    assert abs(point[1]) > 20.0
    assert GoalPoint.drawn(warped, "100", point[None]).point_m == pytest.approx(
        tuple(point), abs=0.01
    )
    with pytest.raises(EditError, match="off the road"):
        GoalPoint.drawn(warped, "100", np.array([point[0], 0.0])[None])
