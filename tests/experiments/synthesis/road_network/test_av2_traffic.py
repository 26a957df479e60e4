"""Traffic on real maps stays on the maps' own lanes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.box_overlaps import boxes_touch
from pd_editor.experiments.synthesis.road_network.map_network import (
    network_of_map,
    parking_strips,
)
from pd_editor.experiments.synthesis.traffic.demand_config import MAP_DEMAND
from pd_editor.experiments.synthesis.traffic.simulation import simulate
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.road_map import DrivableArea, RoadMap
from tests.builders import straight_lane


@pytest.fixture(scope="module")
def folders(av2_scenario_folders: list[Path]) -> list[Path]:
    return [path for path in av2_scenario_folders if path.parent.name == "train"]


def test_traffic_on_real_maps(folders: list[Path], tmp_path: Path) -> None:
    for folder in folders[:2]:
        road_map = read_scenario(folder).road_map
        network = network_of_map(road_map, folder.name, tmp_path / folder.name)
        recording = simulate(network, 3, duration_s=40.0)
        assert recording.road_map is road_map
        drives = np.array([kind in MOTOR_VEHICLE_KINDS for kind in recording.kinds])
        drives &= ~recording.is_parked
        assert drives.sum() > 5
        agent = np.repeat(np.arange(len(drives)), np.diff(recording.first_row))
        step = np.linalg.norm(np.diff(recording.position_m, axis=0), axis=1)
        assert step[np.diff(agent) == 0].max() < 3.0
        lines = shapely.union_all(
            [shapely.LineString(lane.centerline_m) for lane in road_map.lanes]
        )
        points = shapely.points(recording.position_m[drives[agent]][::5])
        off = shapely.distance(lines, points)
        assert np.median(off) < 0.5
        assert np.percentile(off, 99) < 2.5, "but for changes of lane"


def test_strips_lie_on_paved_ground_beside_lanes() -> None:
    lane = straight_lane(1, (0, 0), (60, 0))

    def strips(room_m: float) -> list[np.ndarray]:
        edge = -1.75 - room_m
        ring = np.array([[0, edge, 0], [40, edge, 0], [40, 5, 0], [0, 5, 0]], float)
        area = DrivableArea(area_id=1, boundary=ring)
        return list(parking_strips(RoadMap(lanes=(lane,), drivable_areas=(area,))))

    (strip,) = strips(2.5)
    np.testing.assert_allclose(strip[:, 1], -1.75 - 2.5 + 1.15, atol=0.21)
    assert arc_length(strip)[-1] > 35
    assert strip[:, 0].max() <= 40
    assert strips(1.0) == strips(9.0) == []
    assert parking_strips(RoadMap(lanes=(lane,))) == ()


@pytest.mark.parametrize(("width_m", "count"), [(3.5, 0), (5.4, 1)])
def test_vehicles_park_on_wide_lanes(width_m: float, count: int) -> None:
    half = width_m / 2
    lane = straight_lane(1, (0, 0), (60, 0))
    lane = replace(
        lane,
        left=lane.centerline + np.array([0, half, 0]),
        right=lane.centerline - np.array([0, half, 0]),
    )
    ring = np.array([[0, -half, 0], [60, -half, 0], [60, half, 0], [0, half, 0]], float)
    area = DrivableArea(area_id=1, boundary=ring)
    strips = parking_strips(RoadMap(lanes=(lane,), drivable_areas=(area,)))
    assert len(strips) == count
    for strip in strips:
        np.testing.assert_allclose(strip[:, 1], 1.15 - half)


def test_people_walk_beside_real_roads(folders: list[Path], tmp_path: Path) -> None:
    folder = folders[1]
    road_map = read_scenario(folder).road_map
    network = network_of_map(road_map, folder.name, tmp_path)
    recording = simulate(network, 3, duration_s=30.0, demand=MAP_DEMAND)
    walks = np.array([kind is AgentKind.PEDESTRIAN for kind in recording.kinds])
    assert walks.any()
    agent = np.repeat(np.arange(len(walks)), np.diff(recording.first_row))
    lanes = shapely.union_all(
        [shapely.Polygon(lane.outline_m()).buffer(0.0) for lane in road_map.lanes]
    )
    on_lane = shapely.contains_xy(lanes, *recording.position_m[walks[agent]].T)
    assert on_lane.mean() < 0.4, "on crosswalks only"
    step = recording.first_step[agent] + np.arange(len(agent))
    step -= recording.first_row[agent]
    for now in (50, 200):
        rows = np.flatnonzero(step == now)
        boxes = Boxes(
            position_m=recording.position_m[rows],
            heading_rad=recording.heading_rad[rows],
            size_m=recording.size_m[agent[rows]],
        )
        one, other = np.triu_indices(len(rows), 1)
        assert not boxes_touch(boxes[one], boxes[other]).any()
