from dataclasses import replace

import numpy as np
import pytest

from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import RoadMap
from tests.builders import straight_lane, two_lane_road


def test_segments_cover_each_lane_once():
    graph = lane_graph(two_lane_road())
    for row, line in enumerate(graph.centerlines_m):
        mine = graph.search.lane == row
        assert np.allclose(graph.search.start_m[mine], line[:-1])
        assert np.allclose(graph.search.along_m[mine], arc_length(line)[:-1])
        assert graph.lengths_m[row] == pytest.approx(arc_length(line)[-1])
        assert graph.search.first_of_lane[row] == np.flatnonzero(mine)[0]


def test_a_map_is_indexed_once_and_a_changed_map_anew():
    road_map = two_lane_road()
    assert lane_graph(road_map) is lane_graph(road_map)
    assert lane_graph(replace(road_map)) is not lane_graph(road_map)


def test_links_out_of_the_map_or_over_wide_gaps_are_dropped():
    road_map = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (50, 0), successors=(2, 3, 99)),
            straight_lane(2, (52.5, 0), (100, 0), left_neighbor=77),
            straight_lane(3, (54, 0), (100, 0)),
        )
    )
    graph = lane_graph(road_map)
    assert graph.successors == ((1,), (), ())
    assert graph.neighbors == ((), (), ())


def test_a_link_named_by_one_side_only_counts():
    road_map = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (50, 0)),
            straight_lane(2, (50, 0), (100, 0), predecessors=(1,)),
        )
    )
    assert lane_graph(road_map).successors == ((1,), ())
