"""Poses that show a part of the scene."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.editor.scenario_store import open_scenario
from pd_editor.viewer.scene import framing
from pd_editor.viewer.scene.framing import (
    FreePart,
    agents_extent,
    facing_square,
    fitted,
    framing_direction,
    from_above,
    map_extent,
)
from pd_editor.viewer.state.view_memory import ViewPose

MARGIN = 1e-6


@pytest.fixture(scope="module")
def scenario():
    return open_scenario("signalised-junction")


def in_picture(pose: ViewPose, points_m: np.ndarray, aspect: float) -> np.ndarray:
    """Places of points in the picture, -1..1 to the right and up."""
    ahead = np.subtract(pose.look_at_m, pose.position_m)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, pose.up)
    right /= np.linalg.norm(right)
    local = points_m - np.array(pose.position_m)
    depth = local @ ahead
    assert (depth > 0).all()
    tan = np.tan(pose.fov_rad / 2)
    up = np.cross(right, ahead)
    return (
        np.stack([local @ right / (tan * aspect), local @ up / tan], -1)
        / depth[:, None]
    )


boxes = st.tuples(
    st.floats(-900, 900), st.floats(-900, 900), st.floats(2, 700), st.floats(2, 700)
)


@settings(deadline=None)
@given(boxes, st.floats(0.4, 3.0), st.floats(-3.1, 3.1), st.floats(0.5, 1.5))
def test_a_fitted_pose_shows_all_points_in_the_free_part_and_no_smaller_than_need_be(
    box, aspect, heading, elevation
):
    """(D22) Everything framed is in sight, and touches two sides of the free part."""
    x, y, width, height = box
    sides = [(x, x + width), (y, y + height), (0.0, framing.TALLEST_M)]
    points = np.array(list(itertools.product(*sides)))
    forward = np.array(
        [
            np.cos(elevation) * np.cos(heading),
            np.cos(elevation) * np.sin(heading),
            -np.sin(elevation),
        ]
    )
    pose = fitted(points, forward=forward, up=(0, 0, 1.0), fov_rad=0.7, aspect=aspect)
    seen = in_picture(pose, points, aspect)
    low = np.array([framing.FREE_PART.left, framing.FREE_PART.bottom])
    high = np.array([framing.FREE_PART.right, framing.FREE_PART.top])
    assert (seen >= low - MARGIN).all()
    assert (seen <= high + MARGIN).all()
    slack = np.maximum(seen.min(axis=0) - low, high - seen.max(axis=0))
    assert slack.min() < 1e-3
    assert pose.look_at_m[2] == 0.0
    assert np.allclose(
        np.cross(np.subtract(pose.look_at_m, pose.position_m), forward), 0, atol=1e-4
    )


@pytest.mark.parametrize("share", [0.2, 0.55, 1.0])
@pytest.mark.parametrize("elevation", [0.6, 1.1, np.pi / 2])
def test_a_framed_place_is_in_the_middle_of_what_a_list_leaves_free(share, elevation):
    """A place at a slant was above the middle, and half under the list of problems."""
    place = np.array([30.0, -12.0, 0.0])
    forward = np.array([0.0, np.cos(elevation), -np.sin(elevation)])
    up = (0.0, 1.0, 0.0) if elevation == np.pi / 2 else (0.0, 0.0, 1.0)
    free = FreePart.left_of(share)
    square = facing_square(place, 13.0, forward=forward, up=up)
    pose = fitted(square, forward=forward, up=up, fov_rad=0.7, aspect=1.26, free=free)
    (seen,) = in_picture(pose, place[None], 1.26)
    assert np.allclose(
        seen, [(free.left + free.right) / 2, (free.bottom + free.top) / 2]
    )
    covered = 2 * max(share, framing.NARROWEST_FREE) - 1
    assert in_picture(pose, square, 1.26)[:, 0].max() < covered


def test_the_extent_of_agents_holds_their_trajectories(scenario):
    """(D22) Past and future belong to what F frames, not the state alone."""
    agents = scenario.agents
    speeds = agents.speed_mps().mean(axis=1)
    agent_id = agents.ids[int(speeds.argmax())]
    corners = agents_extent(scenario, (agent_id,))
    assert corners is not None
    row = agents.row_of[agent_id]
    track = agents.position_m[row][agents.is_valid[row]]
    assert (corners[:, :2].min(axis=0) < track.min(axis=0)).all()
    assert (corners[:, :2].max(axis=0) > track.max(axis=0)).all()
    assert agents_extent(scenario, ("nothing",)) is None


def test_without_trajectories_the_extent_is_about_the_agent(scenario):
    """In 3-D, F put a fast agent into a corner of the picture."""
    agents = scenario.agents
    agent_id = agents.ids[int(agents.speed_mps().mean(axis=1).argmax())]
    corners = agents_extent(scenario, (agent_id,), with_tracks=False)
    assert corners is not None
    place = agents.position_m[agents.row_of[agent_id], scenario.current_step]
    assert np.allclose(corners.mean(axis=0)[:2], place)


def test_one_parked_car_does_not_fill_the_picture(scenario):
    agents = scenario.agents
    still = agents.ids[int(agents.speed_mps().max(axis=1).argmin())]
    corners = agents_extent(scenario, (still,))
    assert corners is not None
    size = corners.max(axis=0) - corners.min(axis=0)
    assert (size[:2] >= framing.MIN_EXTENT_M - 1e-9).all()


def test_of_a_huge_map_the_traffic_is_shown(scenario, monkeypatch):
    whole = map_extent(scenario)
    points = np.concatenate(scenario.road_map.polylines)[:, :2]
    assert np.allclose(whole[:, :2].min(axis=0), points.min(axis=0))
    monkeypatch.setattr(framing, "MAX_WHOLE_MAP_M", 50.0)
    traffic = agents_extent(scenario, scenario.agents.ids)
    assert traffic is not None
    assert np.allclose(map_extent(scenario), traffic)


def test_a_part_is_framed_neither_from_too_flat_nor_from_straight_above():
    flat = ViewPose(
        position_m=(0.0, -100.0, 1.0),
        look_at_m=(0.0, 0.0, 0.0),
        up=(0.0, 0.0, 1.0),
        fov_rad=0.7,
    )
    assert np.isclose(-framing_direction(flat)[2], np.sin(framing.LOWEST_RAD))
    above = from_above(np.zeros(2), 0.3)
    direction = framing_direction(above)
    assert np.isclose(-direction[2], np.sin(framing.HIGHEST_RAD))
    assert np.isclose(np.arctan2(direction[1], direction[0]), 0.3)


def test_half_height_is_what_the_picture_shows():
    pose = from_above(np.array([3.0, 4.0]), np.pi / 2, 40.0)
    assert np.isclose(pose.half_height_m, 40.0)
    edge = np.array([[3.0, 44.0, 0.0]])
    assert np.allclose(in_picture(pose, edge, 1.0), [[0.0, 1.0]], atol=1e-6)
