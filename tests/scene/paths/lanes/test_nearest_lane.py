from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.road_map import LaneKind, RoadMap
from tests.builders import straight_lane, two_lane_road


@given(st.floats(-150, 250), st.floats(-20, 20))
def test_nearest_centre_line_agrees_with_shapely(x, y):
    road_map = two_lane_road()
    match = nearest_lanes(road_map, np.array([[x, y]]))
    lines = [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
    distance = shapely.distance(lines, shapely.Point(x, y))
    assert match.distance_m[0] == pytest.approx(distance.min(), abs=1e-9)
    lane = [lane.lane_id for lane in road_map.lanes].index(match.lane_id[0])
    assert distance[lane] == pytest.approx(distance.min(), abs=1e-9)
    assert match.along_m[0] == pytest.approx(
        lines[lane].project(shapely.Point(x, y)), abs=1e-6
    )


def test_offset_is_positive_to_the_left():
    match = nearest_lanes(two_lane_road(), np.array([[0.0, 0.5], [0.0, -0.5]]))
    assert match.offset_m.tolist() == [0.5, -0.5]
    assert match.lane_id.tolist() == [1, 1]
    assert match.along_m.tolist() == [100.0, 100.0]


def test_heading_prefers_the_lane_that_runs_its_way():
    both_ways = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (100, 0)),
            straight_lane(2, (100, 3.5), (0, 3.5)),
        )
    )
    points = np.array([[50.0, 1.0], [50.0, 1.0], [50.0, 9.0]])
    heading = np.array([0.0, np.pi, 0.0])
    match = nearest_lanes(both_ways, points, heading_rad=heading)
    assert match.lane_id.tolist() == [1, 2, 1]
    far_away = nearest_lanes(
        both_ways, np.array([[-20.0, 3.5]]), heading_rad=np.array([0.0])
    )
    assert far_away.lane_id.tolist() == [1]


def test_only_lanes_of_the_kinds_count():
    road_map = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (100, 0), kind=LaneKind.BIKE),
            straight_lane(2, (0, 8), (100, 8)),
        )
    )
    point = np.array([[50.0, 1.0]])
    assert nearest_lanes(road_map, point).lane_id[0] == 2
    bike = nearest_lanes(road_map, point, kinds=(LaneKind.BIKE,))
    assert bike.lane_id[0] == 1
    assert not nearest_lanes(road_map, point, kinds=(LaneKind.BUS,)).is_valid.any()
    assert not nearest_lanes(RoadMap(lanes=()), point).is_valid.any()


def test_lanes_without_direction_are_left_out():
    good = straight_lane(1, (0, 8), (100, 8))
    one_point = replace(good, lane_id=2, centerline=np.array([[5.0, 0.0, 0.0]]))
    repeated = replace(good, lane_id=3, centerline=np.zeros((4, 3)))
    broken = replace(good, lane_id=4, centerline=np.full((3, 3), np.nan))
    road_map = RoadMap(lanes=(one_point, repeated, broken, good))
    assert nearest_lanes(road_map, np.zeros((1, 2))).lane_id[0] == 1


def test_many_points_give_what_each_gives_alone(av2_scenario_folders):
    road_map = read_scenario(av2_scenario_folders[0]).road_map
    points = np.random.default_rng(0).uniform(-80, 80, (3000, 2))
    together = nearest_lanes(road_map, points)
    for row in (0, 1499, 2999):
        alone = nearest_lanes(road_map, points[row : row + 1])
        assert alone.lane_id[0] == together.lane_id[row]
        assert alone.offset_m[0] == pytest.approx(together.offset_m[row], abs=1e-9)
