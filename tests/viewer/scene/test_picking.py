"""What lies under a pointer."""

import math

import numpy as np
import pytest

from pd_editor.viewer.meshes.agent_shapes import poses_at
from pd_editor.viewer.scene.picking import (
    PointerRay,
    agent_under,
    lane_under,
    number_of,
    point_of,
)
from tests.builders import LANE_WIDTH_M, two_agents_that_pass


def ray_to(x, y, z=0.0, origin=(0.0, -30.0, 30.0)):
    event = {"at": [1, 2], "ray": [list(origin), [x, y, z]]}
    ray = PointerRay.of_event(event)
    assert ray is not None
    return ray


def test_the_nearest_box_on_the_ray_counts():
    agents = two_agents_that_pass().agents
    poses = poses_at(agents, 49)
    above = (0.0, LANE_WIDTH_M, 80.0)
    assert agent_under(agents, poses, ray_to(0, LANE_WIDTH_M, origin=above)) == 1
    assert agent_under(agents, poses, ray_to(0, 0, 1.0)) == 0
    # From the side the first agent hides the second.
    assert agent_under(agents, poses, ray_to(0, 3.5, 1.0, (0.0, -9.0, 1.0))) == 0
    assert agent_under(agents, poses, ray_to(12, 0)) is None


def test_agents_that_are_not_there_are_not_hit():
    agents = two_agents_that_pass().agents
    poses = poses_at(agents, 49)
    gone = type(poses)(
        position_m=poses.position_m,
        heading_rad=poses.heading_rad,
        is_present=np.zeros(len(agents), bool),
    )
    assert agent_under(agents, gone, ray_to(0, 0, 1.0)) is None


def test_the_lane_under_a_point():
    road_map = two_agents_that_pass().road_map
    lane = lane_under(road_map, np.array([0.0, 0.2]))
    assert lane is not None
    assert abs(lane.centerline_m[0, 1]) < 0.1
    assert lane_under(road_map, np.array([0.0, 300.0])) is None


@pytest.mark.parametrize(
    "event",
    [
        {},
        {"at": [1, 2]},
        {"at": [1, 2], "ray": None},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0]]},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, 1]]},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, math.nan]]},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, 10**400]]},
        {"at": ["1", 2], "ray": [[0, 0, 1], [0, 0, 0]]},
        {"at": [True, 2], "ray": [[0, 0, 1], [0, 0, 0]]},
        {"at": "12", "ray": "12"},
    ],
)
def test_garbage_is_no_ray(event):
    assert PointerRay.of_event(event) is None


def test_numbers_and_points_of_a_page():
    assert number_of(1.5) == 1.5
    assert number_of(None) is None
    assert number_of(math.inf) is None
    assert point_of([1, 2.5]).tolist() == [1, 2.5]
    assert point_of({"x": 1}) is None
