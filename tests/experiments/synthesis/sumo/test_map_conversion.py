"""Laws that every generated map keeps."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Polygon

from pd_editor.experiments.synthesis.road_network.generator import FAMILIES
from pd_editor.scene.av2_io.map_file import map_bytes, read_map
from pd_editor.scene.formats.sumo_net import read_sumo_net
from pd_editor.scene.paths.lanes.lane_graph import lane_graph
from pd_editor.scene.road_map import LaneMark, RoadMap
from tests.experiments.synthesis.networks import network

CASES = [(family, seed) for family in FAMILIES for seed in (1, 2)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def road_map(request: pytest.FixtureRequest) -> RoadMap:
    return network(*request.param).road_map


def test_lanes_begin_where_the_ones_before_them_end(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        for name in lane.successors:
            after = road_map.lane_of[name]
            for end, start in (
                (lane.centerline_m, after.centerline_m),
                (lane.left_m, after.left_m),
                (lane.right_m, after.right_m),
            ):
                assert np.linalg.norm(end[-1] - start[0]) < 0.15


def test_links_hold_both_ways(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        assert all(
            lane.lane_id in road_map.lane_of[name].predecessors
            for name in lane.successors
        )
        assert all(
            lane.lane_id in road_map.lane_of[name].successors
            for name in lane.predecessors
        )
        if lane.left_neighbor is not None:
            beside = road_map.lane_of[lane.left_neighbor]
            assert beside.right_neighbor == lane.lane_id
        if lane.right_neighbor is not None:
            beside = road_map.lane_of[lane.right_neighbor]
            assert beside.left_neighbor == lane.lane_id
        if lane.is_intersection:
            assert lane.successors
            assert lane.predecessors


def test_neighbors_share_a_boundary(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        if lane.left_neighbor is not None:
            beside = LineString(road_map.lane_of[lane.left_neighbor].right_m)
            apart = shapely.distance(beside, shapely.points(lane.left_m[2:-2]))
            assert np.all(apart[apart.size // 4 :] < 0.4)


def test_boundaries_lie_left_and_right_and_cross_nowhere(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        ring = Polygon(lane.outline_m())
        assert ring.is_valid
        assert not ring.exterior.is_ccw
        assert ring.buffer(0.01).contains(LineString(lane.centerline_m))


def test_lines_have_neither_kinks_nor_long_steps(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        step = np.diff(lane.centerline_m, axis=0)
        length = np.linalg.norm(step, axis=-1)
        assert np.all(length < 2.01)
        assert length.sum() > 1.0
        heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        assert np.all(np.abs(np.diff(heading)) < 0.8)


def test_lanes_lie_on_drivable_ground(road_map: RoadMap) -> None:
    rings = [Polygon(area.boundary[:, :2]) for area in road_map.drivable_areas]
    assert all(ring.is_valid for ring in rings)
    ground = shapely.union_all(rings).buffer(0.3)
    shapely.prepare(ground)
    for lane in road_map.lanes:
        assert ground.contains(Polygon(lane.outline_m()))


def test_lanes_of_roads_do_not_overlap(road_map: RoadMap) -> None:
    lanes = [lane for lane in road_map.lanes if not lane.is_intersection]
    rings = [Polygon(lane.outline_m()).buffer(-0.2) for lane in lanes]
    for one, two in shapely.STRtree(rings).query(rings, predicate="intersects").T:
        a, b = lanes[one], lanes[two]
        forks = set(a.predecessors) & set(b.predecessors)
        merges = set(a.successors) & set(b.successors)
        in_row = b.lane_id in a.successors or a.lane_id in b.successors
        if one < two and not (forks or merges or in_row):
            assert rings[one].intersection(rings[two]).area < 2.0


def test_paint_agrees_with_what_lies_beside(road_map: RoadMap) -> None:
    for lane in road_map.lanes:
        if lane.is_intersection:
            assert lane.left_mark is lane.right_mark is LaneMark.NONE
        if lane.left_neighbor is not None:
            assert lane.left_mark in (LaneMark.DASHED_WHITE, LaneMark.SOLID_WHITE)
            beside = road_map.lane_of[lane.left_neighbor]
            assert beside.right_mark is lane.left_mark


@pytest.mark.parametrize("family", FAMILIES)
def test_every_lane_that_is_driven_on_is_in_the_map(family: str) -> None:
    generated = network(family, 1)
    net = read_sumo_net(generated.net_file)
    driven = {key for key, lane in net.lanes.items() if lane.kind is not None}
    assert set(generated.lane_of_sumo) == driven
    for key, ids in generated.lane_of_sumo.items():
        lines = [
            LineString(generated.road_map.lane_of[name].centerline_m) for name in ids
        ]
        points = shapely.points(net.lanes[key].shape_m)
        apart = np.min([shapely.distance(points, line) for line in lines], axis=0)
        assert np.all(apart < 1.5)
        for first, second in pairwise(ids):
            assert second in generated.road_map.lane_of[first].successors


@pytest.mark.parametrize("family", FAMILIES)
def test_our_lane_graph_has_every_link(family: str) -> None:
    road_map = network(family, 1).road_map
    graph = lane_graph(road_map)
    assert len(graph.lane_ids) == len(road_map.lanes)
    for row, name in enumerate(graph.lane_ids):
        linked = {graph.lane_ids[after] for after in graph.successors[row]}
        assert linked == set(road_map.lane_of[name].successors)


@pytest.mark.parametrize("family", FAMILIES)
def test_argoverse_reads_the_map(family: str, tmp_path: Path) -> None:
    from av2.map.map_api import ArgoverseStaticMap

    road_map = network(family, 1).road_map
    data = map_bytes(road_map, np.array([100.0, 200.0]))
    path = tmp_path / "log_map_archive_x.json"
    path.write_bytes(data)
    official = ArgoverseStaticMap.from_json(path)
    assert len(official.get_scenario_lane_segments()) == len(road_map.lanes)
    assert len(official.get_scenario_ped_crossings()) == len(road_map.crosswalks)
    again = read_map(data, path.name, np.array([100.0, 200.0]))
    for lane, written in zip(road_map.lanes, again.lanes, strict=True):
        assert np.allclose(lane.centerline, written.centerline, atol=1e-4)
        assert lane.successors == written.successors
