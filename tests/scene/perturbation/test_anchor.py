from dataclasses import replace

import numpy as np
import pytest

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import DeleteAgents, DuplicateAgents, SetRoadWarp
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import (
    pose_of_anchor,
    pose_on_original_road,
)
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers

SCENARIO = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0.5, 10)]))
BEND = SetRoadWarp(
    warp=RoadWarp(
        anchor=RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0),
        terms=(WarpTerm(kind="smooth-turn", power=5.0, length_m=10.0),),
    )
)


def test_it_is_the_current_pose():
    pose = pose_on_original_road(SCENARIO, "101")
    assert (pose.x_m, pose.y_m, pose.rotation_rad) == (40, 0, 0.5)


def test_a_warp_in_force_does_not_move_it():
    bent = BEND.apply(SCENARIO)
    assert bent.agents.position_m[1, bent.current_step, 1] > 10
    assert pose_on_original_road(bent, "101") == pose_on_original_road(SCENARIO, "101")


def test_who_came_after_the_warp_is_taken_back_as_well():
    bent = BEND.apply(SCENARIO)
    more = DuplicateAgents(agent_ids=("101",), new_ids=("new",)).apply(bent)
    pose = pose_on_original_road(more, "new")
    np.testing.assert_allclose(
        (pose.x_m, pose.y_m, pose.rotation_rad), (40, 0, 0.5), atol=1e-9
    )


def test_anchors_by_name():
    agents = replace(SCENARIO.agents, ids=("AV", "101"))
    scenario = replace(SCENARIO, agents=agents, focal_id="101")
    assert pose_of_anchor(scenario, "focal") == pose_on_original_road(scenario, "101")
    assert pose_of_anchor(scenario, "101") == pose_on_original_road(scenario, "101")
    assert pose_of_anchor(scenario, "ego") == pose_on_original_road(scenario, "AV")


def test_missing_anchors_are_refused():
    with pytest.raises(EditError, match=r"no ego vehicle \(track id AV\)"):
        pose_of_anchor(SCENARIO, "ego")
    with pytest.raises(EditError, match="has no focal agent"):
        pose_of_anchor(replace(SCENARIO, focal_id=""), "focal")
    gone = DeleteAgents(agent_ids=("101",)).apply(SCENARIO)
    with pytest.raises(EditError, match="There is no agent '101' here"):
        pose_of_anchor(gone, "101")
    is_valid = np.array(SCENARIO.agents.is_valid)
    is_valid[0, 49] = False
    absent = replace(SCENARIO, agents=replace(SCENARIO.agents, is_valid=is_valid))
    with pytest.raises(EditError, match="Agent 100 is not there at the current step"):
        pose_of_anchor(absent, "focal")
