"""What lies under a pointer."""

import math

import numpy as np
import pytest

from pd_editor.viewer.meshes.agent_shapes import poses_at
from pd_editor.viewer.scene.picking import PointerRay, agent_under, lane_under, point_of
from tests.builders import LANE_WIDTH_M, two_agents_that_pass
from tests.viewer.fake_page import FakePage


def ray_to(x, y, z=0.0, origin=(0.0, -30.0, 30.0)):
    ray = PointerRay.of((1.0, 2.0), (origin, (x, y, z)))
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
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, math.nan]]},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, math.inf]]},
        {"at": [1, 2], "ray": [[0, 0, 1], [0, 0, 10**400]]},
        {"at": ["1", 2], "ray": [[0, 0, 1], [0, 0, 0]]},
        {"at": [True, 2], "ray": [[0, 0, 1], [0, 0, 0]]},
        {"at": "12", "ray": "12"},
    ],
)
def test_no_element_hears_of_a_garbage_ray(event):
    page, heard = FakePage(), []
    page.on("tooltip", heard.append)
    page.send("tooltip", {"ask": 1} | event)
    assert heard == []
    page.send("tooltip", {"ask": 1, "at": [1, 2], "ray": [[0, 0, 1], [0, 0, 0.5]]})
    (one,) = heard
    assert one.ray == ((0.0, 0.0, 1.0), (0.0, 0.0, 0.5))


def test_what_the_horizon_has_is_no_place():
    assert PointerRay.of((1.0, 2.0), ((0.0, 0.0, 1.0), (0.0, 1e8, 0.0))) is None
    assert point_of((1e8, 0.0)) is point_of(None) is None
    assert point_of((1.0, 2.5)).tolist() == [1.0, 2.5]


def test_a_ray_without_a_direction_is_none():
    assert PointerRay.of((1.0, 2.0), None) is None
    assert PointerRay.of((1.0, 2.0), ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))) is None
