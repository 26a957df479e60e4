"""Chains of lanes."""

from pd_editor.scene.paths.lanes.lane_graph import lane_chain
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES
from pd_editor.scene.road_map import LaneKind, RoadMap
from tests.builders import straight_lane, two_lane_road


def test_lanes_that_follow_one_another():
    road = two_lane_road()
    assert lane_chain(road, 1, 2, kinds=DRIVING_LANES) == (1, 2)
    assert lane_chain(road, 2, 2, kinds=DRIVING_LANES) == (2,)


def test_none_against_the_direction_or_across_lanes():
    road = two_lane_road()
    assert lane_chain(road, 2, 1, kinds=DRIVING_LANES) is None
    assert lane_chain(road, 1, 4, kinds=DRIVING_LANES) is None
    assert lane_chain(road, 1, 99, kinds=DRIVING_LANES) is None


def test_the_fewest_lanes_are_taken_and_only_allowed_ones():
    road = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (10, 0), successors=(2, 3)),
            straight_lane(2, (10, 0), (20, 0), successors=(4,)),
            straight_lane(3, (10, 0), (30, 0), successors=(5,), kind=LaneKind.BIKE),
            straight_lane(4, (20, 0), (30, 0), successors=(5,)),
            straight_lane(5, (30, 0), (40, 0)),
        )
    )
    both = (*DRIVING_LANES, LaneKind.BIKE)
    assert lane_chain(road, 1, 5, kinds=both) == (1, 3, 5)
    assert lane_chain(road, 1, 5, kinds=DRIVING_LANES) == (1, 2, 4, 5)
