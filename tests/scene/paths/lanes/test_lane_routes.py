from itertools import pairwise

import numpy as np
import pytest

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.paths.lanes.lane_graph import MAX_GAP_M
from pd_editor.scene.paths.lanes.lane_routes import (
    MAX_ROUTES_PER_LANE,
    SAMPLE_SPACING_M,
    SAMPLED_BEHIND_M,
    lane_routes,
)
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES
from pd_editor.scene.road_map import LaneKind, RoadMap
from tests.builders import straight_lane, two_lane_road


def ring(num_lanes: int = 8, radius: float = 12.0) -> RoadMap:
    angle = np.linspace(0, 2 * np.pi, num_lanes + 1)
    corners = radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    return RoadMap(
        lanes=tuple(
            straight_lane(
                row,
                (corners[row][0], corners[row][1]),
                (corners[row + 1][0], corners[row + 1][1]),
                successors=((row + 1) % num_lanes,),
            )
            for row in range(num_lanes)
        )
    )


def test_a_route_joins_lanes_without_repeated_points():
    (route,) = lane_routes(two_lane_road()).from_lane(1, 200, DRIVING_LANES)
    assert route.lane_ids == (1, 2)
    assert route.lane_ends_m == pytest.approx((150, 300))
    assert route.is_dead_end
    assert np.linalg.norm(np.diff(route.points_m, axis=0), axis=-1).min() > 0.1


def test_a_dead_end_goes_straight_on():
    (route,) = lane_routes(two_lane_road()).from_lane(2, 500, DRIVING_LANES)
    assert route.extends_m == pytest.approx(150)
    grid = np.arange(len(route.samples_m)) * SAMPLE_SPACING_M - SAMPLED_BEHIND_M
    assert np.allclose(route.samples_m[:, 0], 50 + grid)
    assert np.allclose(route.samples_m[:, 1], 0)
    assert grid[-1] > route.extends_m


def test_a_loop_is_driven_round_and_ends():
    (route,) = lane_routes(ring()).from_lane(0, 200, DRIVING_LANES)
    assert route.extends_m >= 200
    assert not route.is_dead_end
    assert np.linalg.norm(route.points_m, axis=-1).max() < 12.1


def test_small_gaps_are_bridged_and_wide_ones_break():
    lanes = (
        straight_lane(1, (0, 0), (50, 0), successors=(2,)),
        straight_lane(2, (52, 0), (100, 0), successors=(3,)),
        straight_lane(3, (104, 0), (200, 0)),
    )
    (route,) = lane_routes(RoadMap(lanes=lanes)).from_lane(1, 300, DRIVING_LANES)
    assert route.lane_ids == (1, 2)
    assert route.extends_m == pytest.approx(100)


def test_branches_come_straightest_first_and_are_capped():
    lanes = [straight_lane(0, (0, 0), (30, 0), successors=tuple(range(1, 21)))]
    for index in range(1, 21):
        angle = 0.06 * (index - 10)
        end = (30 + 80 * np.cos(angle), 80 * np.sin(angle))
        lanes.append(straight_lane(index, (30, 0), end))
    routes = lane_routes(RoadMap(lanes=tuple(lanes))).from_lane(0, 80, DRIVING_LANES)
    assert len(routes) == MAX_ROUTES_PER_LANE
    assert routes[0].lane_ids == (0, 10)
    assert len({route.lane_ids for route in routes}) == len(routes)


def test_routes_keep_to_the_kinds_of_lanes():
    lanes = (
        straight_lane(1, (0, 0), (50, 0), successors=(2, 3)),
        straight_lane(2, (50, 0), (100, 0), kind=LaneKind.BIKE),
        straight_lane(3, (50, 0), (100, 5)),
    )
    routes = lane_routes(RoadMap(lanes=lanes))
    assert [r.lane_ids for r in routes.from_lane(1, 90, DRIVING_LANES)] == [(1, 3)]
    all_kinds = (*DRIVING_LANES, LaneKind.BIKE)
    assert len(routes.from_lane(1, 90, all_kinds)) == 2


def test_routes_of_real_maps_are_chains_of_successors(av2_scenario_folders):
    for folder in av2_scenario_folders[::12]:
        road_map = read_scenario(folder).road_map
        for lane in road_map.lanes[::5]:
            for route in lane_routes(road_map).from_lane(
                lane.lane_id, 100, tuple(LaneKind)
            ):
                lanes = [road_map.lane_of[one] for one in route.lane_ids]
                for before, after in pairwise(lanes):
                    assert (
                        after.lane_id in before.successors
                        or before.lane_id in after.predecessors
                    )
                step = np.diff(route.points_m, axis=0)
                assert np.linalg.norm(step, axis=-1).max() < MAX_GAP_M + 2.1
                assert route.is_dead_end or route.extends_m >= 100
