"""Terms made from points and lines on the road."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.guidance_terms import (
    GUIDANCE_KINDS,
    FollowLane,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.guidance.drawn_terms import (
    MAX_PATH_POINTS,
    goal_term,
    lane_term,
    path_term,
    stop_term,
    usual_term,
)
from pd_editor.viewer.guidance.guidance_panel import FORM_KINDS, about_in_words
from pd_editor.viewer.guidance.guiding import TOOLS
from tests.builders import scenario_with, straight_drivers


@pytest.fixture
def scenario():
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN)
    states = [(0.0, 0.0, 0.0, 8.2), (5.0, 8.0, 0.0, 1.0)]
    return scenario_with(straight_drivers(states, kinds=kinds))


def test_a_goal_is_taken_on_the_road_and_refused_off_the_map(scenario):
    assert goal_term(scenario, "100", np.array([40.001, 2.0])).point_m == (40.0, 2.0)
    with pytest.raises(EditError, match="45 m off the road"):
        goal_term(scenario, "100", np.array([40.0, 50.0]))
    # Pavements are no part of the drivable area.
    assert goal_term(scenario, "101", np.array([40.0, 15.0])).point_m == (40.0, 15.0)
    with pytest.raises(EditError, match="10 m off the road"):
        goal_term(scenario, "100", np.array([40.0, 15.0]))


def test_terms_of_other_agents_are_told_of(scenario):
    """Without a word, a term seemed lost when another agent was selected."""
    goal = goal_term(scenario, "100", np.array([40.0, 2.0]))
    guided = replace(scenario, guidance=(goal, SpeedLimit(speed_mps=8.0)))
    assert about_in_words(guided, ("100",)) == "Guidance of vehicle 100"
    assert about_in_words(guided, ("101",)).endswith("101; 1 more of other agents")


def test_a_drawn_line_becomes_a_path_of_few_points(scenario):
    along = np.linspace(0.0, 60.0, 400)
    drawn = np.column_stack([along, 1.5 * np.sin(along / 12.0)])
    term = path_term(scenario, "100", drawn + 0.02 * np.sin(97.0 * along)[:, None])
    assert 4 <= len(term.points_m) <= 12
    ends = np.array(term.points_m)[[0, -1]]
    assert np.abs(ends - drawn[[0, -1]]).max() < 0.1
    rough = drawn + np.random.default_rng(0).normal(0.0, 1.0, drawn.shape)
    assert len(path_term(scenario, "100", rough).points_m) <= MAX_PATH_POINTS


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
        path_term(scenario, "100", np.array(points).reshape(-1, 2))


def test_a_stop_line_crosses_the_lane_that_is_clicked(scenario):
    term = stop_term(scenario, "100", np.array([30.0, 3.0]))
    assert term == StopAtLine(agent_id="100", line_m=((30.0, 5.25), (30.0, 1.75)))
    with pytest.raises(EditError, match="no lane here"):
        stop_term(scenario, "100", np.array([30.0, 20.0]))


def test_lanes_lead_from_the_agent_to_the_clicked_one(scenario):
    term = lane_term(scenario, "100", np.array([120.0, 0.3]))
    assert term == FollowLane(agent_id="100", lane_ids=(1, 2))
    with pytest.raises(EditError, match="without a lane change"):
        lane_term(scenario, "100", np.array([120.0, 3.4]))
    with pytest.raises(EditError, match="no lane here"):
        lane_term(scenario, "100", np.array([120.0, 30.0]))


def test_terms_of_the_form_start_from_the_traffic(scenario):
    speed = usual_term("target-speed", scenario, ("100",))
    assert speed == TargetSpeed(agent_ids=("100",), speed_mps=8.0)
    limit = usual_term("speed-limit", scenario, ())
    assert limit == SpeedLimit(agent_ids=(), speed_mps=8.0)
    assert usual_term("goal-point", scenario, ()) is None


def test_every_kind_of_term_can_be_made_by_hand(scenario):
    assert set(TOOLS) | set(FORM_KINDS) == set(GUIDANCE_KINDS)
    for kind in FORM_KINDS:
        assert usual_term(kind, scenario, ("100",)) is not None


def test_on_a_warped_road_the_map_is_where_it_is_drawn(scenario):
    anchor = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
    warp = RoadWarp(
        anchor=anchor, terms=(WarpTerm(kind="smooth-turn", power=8.0, length_m=10.0),)
    )
    warped = warp_scenario(scenario, warp)
    lane = warped.road_map.lane_of[2]
    point = lane.centerline_m[-1]
    assert abs(point[1]) > 20.0
    assert goal_term(warped, "100", point).point_m == pytest.approx(
        tuple(point), abs=0.01
    )
    with pytest.raises(EditError, match="off the road"):
        goal_term(warped, "100", np.array([point[0], 0.0]))
