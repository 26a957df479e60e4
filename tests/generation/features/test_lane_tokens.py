from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.generation.features.map_pieces import (
    CROSSWALK_KIND,
    MIRRORED_SHAPE,
    MIRRORED_SHAPE_SIGNS,
    PIECE_SHAPE,
    lane_pieces,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import Crosswalk, LaneKind, RoadMap
from tests.builders import straight_lane, two_lane_road


def column(pieces, name: str) -> np.ndarray:
    return pieces.shape[:, PIECE_SHAPE.index(name)]


def arc_lane(lane_id: int, radius_m: float, angle_rad: float):
    """A left bend from the origin, heading east."""
    straight = straight_lane(lane_id, (0, 0), (abs(radius_m * angle_rad), 0))

    def bent(points: np.ndarray) -> np.ndarray:
        turn = points[:, 0] / radius_m
        reach = radius_m - points[:, 1]
        return np.column_stack(
            [reach * np.sin(turn), radius_m - reach * np.cos(turn), points[:, 2]]
        )

    return replace(
        straight,
        centerline=bent(straight.centerline),
        left=bent(straight.left),
        right=bent(straight.right),
    )


def crosswalk(start: tuple[float, float], end: tuple[float, float]) -> Crosswalk:
    """4 m wide, its edges running against each other."""
    ends, side = np.array([[*start, 0], [*end, 0]], float), np.array([2.0, 0, 0])
    return Crosswalk(crosswalk_id=1, edge1=ends - side, edge2=ends[::-1] + side)


def test_a_straight_road_is_cut_evenly():
    pieces = lane_pieces(two_lane_road())
    assert len(pieces.pose) == 60
    assert np.allclose(pieces.pose[:15, 0], np.arange(-95, 50, 10))
    assert np.allclose(pieces.pose[:, 2], 0)
    assert np.allclose(column(pieces, "length"), 1)
    assert np.allclose(column(pieces, "left_width"), 1.75 / 2)
    assert np.allclose(column(pieces, "right_width"), 1.75 / 2)
    assert np.allclose(column(pieces, "turn"), 0)
    assert column(pieces, "has_left").tolist() == [1] * 30 + [0] * 30
    assert column(pieces, "has_successor").sum() == 58
    assert column(pieces, "has_predecessor").sum() == 58
    assert (pieces.kind == 0).all()
    assert lane_pieces(two_lane_road()) is not pieces


def test_pieces_of_a_map_are_cut_once():
    road_map = two_lane_road()
    assert lane_pieces(road_map) is lane_pieces(road_map)


@given(st.floats(12, 80), st.floats(0.5, 1.5))
@settings(max_examples=40, deadline=None)
def test_a_bend_turns_by_its_angle(radius, angle):
    pieces = lane_pieces(RoadMap(lanes=(arc_lane(1, radius, angle),)))
    turn = column(pieces, "turn")
    assert np.sum(turn) == pytest.approx(angle, rel=0.15)
    assert np.allclose(column(pieces, "turn_after")[:-1], turn[1:])
    assert np.allclose(column(pieces, "turn_before")[1:], turn[:-1])
    middle = np.hypot(pieces.pose[:, 0], pieces.pose[:, 1] - radius)
    assert np.allclose(middle, radius, atol=0.1)
    along = np.arctan2(pieces.pose[:, 0], radius - pieces.pose[:, 1])
    assert np.allclose(pieces.pose[:, 2], along, atol=0.05)
    assert np.allclose(column(pieces, "left_width"), 1.75 / 2, atol=0.05)


def test_the_straightest_lane_counts_where_a_road_branches():
    bend = replace(arc_lane(3, 20, 1.2), predecessors=(1,))
    road = RoadMap(
        lanes=(
            straight_lane(1, (-40, 0), (0, 0), successors=(3, 2)),
            straight_lane(2, (0, 0), (40, 0), predecessors=(1,)),
            bend,
        )
    )
    pieces = lane_pieces(road)
    last = 3
    assert column(pieces, "branches").tolist() == [0, 0, 0, 1] + [0] * 6
    assert column(pieces, "turn_after")[last] == pytest.approx(0)
    assert column(pieces, "has_predecessor")[[4, 8]].tolist() == [1, 1]
    assert column(pieces, "has_successor")[[7, 9]].tolist() == [0, 0]


def test_an_oncoming_lane_is_none_beside():
    road = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (20, 0), left_neighbor=2, right_neighbor=3),
            straight_lane(2, (20, 3.5), (0, 3.5), left_neighbor=1),
            straight_lane(3, (0, -3.5), (20, -3.5), left_neighbor=1, right_neighbor=9),
        )
    )
    pieces = lane_pieces(road)
    assert column(pieces, "has_left").tolist() == [0, 0, 0, 0, 1, 1]
    assert column(pieces, "has_right").tolist() == [1, 1, 0, 0, 0, 0]


def test_a_crosswalk_is_a_piece_each_way():
    road = RoadMap(
        lanes=(straight_lane(1, (0, 0), (20, 0), kind=LaneKind.BIKE),),
        crosswalks=(crosswalk((10, -6), (10, 6)),),
    )
    pieces = lane_pieces(road)
    assert pieces.kind.tolist() == [1, 1, CROSSWALK_KIND, CROSSWALK_KIND]
    assert np.allclose(pieces.pose[2:, :2], [10, 0])
    assert np.allclose(np.abs(pieces.pose[2:, 2]), np.pi / 2)
    assert pieces.pose[2, 2] == -pieces.pose[3, 2]
    assert np.allclose(column(pieces, "length")[2:], 1.2)
    assert np.allclose(column(pieces, "left_width")[2:], 1)


def test_a_road_without_anything_has_no_pieces():
    assert lane_pieces(RoadMap(lanes=())).pose.shape == (0, 3)


def test_damaged_lanes_do_not_harm():
    point = straight_lane(5, (0, 0), (1, 0))
    bad = np.full((3, 3), np.nan)
    flat = np.zeros((2, 3))
    road = RoadMap(
        lanes=(
            replace(point, centerline=point.centerline[:1]),
            replace(straight_lane(6, (0, 0), (30, 0)), left=bad, right=flat[:0]),
            replace(straight_lane(7, (0, 4), (30, 4)), centerline=bad),
            replace(straight_lane(8, (0, 8), (30, 8)), left=flat[:1]),
        ),
        crosswalks=(
            Crosswalk(crosswalk_id=1, edge1=flat, edge2=flat),
            Crosswalk(crosswalk_id=2, edge1=bad, edge2=bad),
        ),
    )
    pieces = lane_pieces(road)
    assert len(pieces.pose) == 6
    assert np.isfinite(pieces.pose).all()
    assert np.isfinite(pieces.shape).all()


def test_a_mirrored_map_has_mirrored_pieces():
    lanes = (arc_lane(1, 25, 1.0), straight_lane(2, (0, 9), (60, 12), right_neighbor=1))
    mirrored = tuple(
        replace(
            lane,
            left=lane.right * [1, -1, 1],
            right=lane.left * [1, -1, 1],
            centerline=lane.centerline * [1, -1, 1],
            left_neighbor=lane.right_neighbor,
            right_neighbor=lane.left_neighbor,
        )
        for lane in lanes
    )
    one = lane_pieces(RoadMap(lanes=lanes))
    two = lane_pieces(RoadMap(lanes=mirrored))
    assert np.allclose(one.pose * [1, -1, -1], two.pose)
    expected = one.shape[:, list(MIRRORED_SHAPE)] * MIRRORED_SHAPE_SIGNS
    assert np.allclose(expected, two.shape)


def test_pieces_lie_on_real_lanes(av2_scenario_folders):
    for folder in av2_scenario_folders[::8]:
        road_map = read_scenario(folder).road_map
        pieces, graph = lane_pieces(road_map), lane_graph(road_map)
        on_lane = pieces.kind != CROSSWALK_KIND
        lines = shapely.MultiLineString(list(graph.centerlines_m))
        points = shapely.points(pieces.pose[on_lane, :2])
        assert shapely.distance(points, lines).max() < 1e-6
        assert np.isfinite(pieces.shape).all()
        assert column(pieces, "length")[on_lane].max() < 1.51
        total = column(pieces, "length")[on_lane].sum() * 10
        assert total == pytest.approx(graph.lengths_m.sum())
        width = shapely.distance(
            points,
            shapely.MultiLineString(
                [lane.left_m for lane in road_map.lanes]
                + [lane.right_m for lane in road_map.lanes]
            ),
        )
        narrow = np.minimum(column(pieces, "left_width"), column(pieces, "right_width"))
        assert (2 * narrow[on_lane] > width - 0.6).mean() > 0.98
