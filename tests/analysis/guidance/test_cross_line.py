"""Lines across lanes."""

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import cross_line
from pd_editor.scene.road_map import RoadMap
from tests.builders import LANE_WIDTH_M, straight_lane, two_lane_road


def test_the_line_joins_the_boundaries_of_the_nearest_lane_at_the_foot_of_the_point():
    found = cross_line(two_lane_road(), np.array([20.3, 1.1]))
    assert found is not None
    line, lane_id = found
    assert lane_id == 1
    assert line == pytest.approx(np.array([[20.3, 1.75], [20.3, -1.75]]))


@pytest.mark.parametrize("angle", [0.4, 2.0, -1.3])
def test_it_crosses_at_a_right_angle_whichever_way_the_lane_leads(angle):
    ahead = np.array([np.cos(angle), np.sin(angle)])
    lane = straight_lane(7, (0.0, 0.0), tuple(60.0 * ahead))
    found = cross_line(RoadMap(lanes=(lane,)), 30.0 * ahead + [0.2, 0.1])
    assert found is not None
    across = found[0][1] - found[0][0]
    assert np.linalg.norm(across) == pytest.approx(LANE_WIDTH_M)
    assert across @ ahead == pytest.approx(0.0, abs=1e-9)


def test_before_a_lane_the_line_is_at_its_start():
    lane = straight_lane(7, (0.0, 0.0), (60.0, 0.0))
    found = cross_line(RoadMap(lanes=(lane,)), np.array([-3.0, 0.5]))
    assert found is not None
    assert found[0][:, 0] == pytest.approx([0.0, 0.0])


def test_far_from_every_lane_there_is_none():
    road = two_lane_road()
    assert cross_line(road, np.array([0.0, 30.0]), max_distance_m=6.0) is None
    assert cross_line(RoadMap(lanes=()), np.zeros(2)) is None
