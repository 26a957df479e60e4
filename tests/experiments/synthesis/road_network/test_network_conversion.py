"""Argoverse 2 maps as SUMO networks, against SUMO's own reader of nets."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import sumolib

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.road_network.map_network import (
    Av2Network,
    network_of_map,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.road_map import LaneKind, RoadMap
from tests.builders import straight_lane


def links_in_map(road_map: RoadMap) -> set[tuple[int, int]]:
    known = road_map.lane_of
    return {(n.lane_id, s) for n in road_map.lanes for s in n.successors if s in known}


def links_by_sumolib(network: Av2Network) -> set[tuple[int, int]]:
    """Links as SUMO's own reader follows them from lane to lane."""
    net = sumolib.net.readNet(str(network.net_file), withInternal=True)
    found: set[tuple[int, int]] = set()
    for edge in net.getEdges():
        for lane in edge.getLanes():
            here = network.lane_intervals[lane.getID()]
            ids = [part.lane_id for part in here]
            for connection in lane.getOutgoing():
                following = connection.getViaLaneID() or connection.getToLane().getID()
                ids_there = [part.lane_id for part in network.lane_intervals[following]]
                found.add((ids[-1], ids_there[0]))
            found |= set(pairwise(ids))
    return {(one, other) for one, other in found if one != other}


def check_lies_on_map(network: Av2Network) -> None:
    """Every SUMO lane runs on the centre lines of its lanes, and they join up."""
    net = sumolib.net.readNet(str(network.net_file), withInternal=True)
    lanes = {lane.getID(): lane for edge in net.getEdges() for lane in edge.getLanes()}
    assert set(lanes) == set(network.lane_intervals) == set(network.lane_of_sumo)
    for name, lane in lanes.items():
        ids = network.lane_of_sumo[name]
        lines = [network.road_map.lane_of[n].centerline_m for n in ids]
        merged = shapely.union_all([shapely.LineString(line) for line in lines])
        points = shapely.points(np.array(lane.getShape()))
        assert shapely.distance(merged, points).max() < 1e-3
        for connection in lane.getOutgoing():
            following = connection.getViaLaneID() or connection.getToLane().getID()
            gap = np.subtract(lane.getShape()[-1], lanes[following].getShape()[0])
            assert np.hypot(*gap) < 2e-3


def crossroads() -> RoadMap:
    """A street to the east and one to the north that cross, with one right turn."""
    return RoadMap(
        lanes=(
            straight_lane(1, (-80, 0), (-8, 0), successors=(2, 7)),
            straight_lane(2, (-8, 0), (8, 0), predecessors=(1,), successors=(3,), is_intersection=True),
            straight_lane(3, (8, 0), (80, 0), predecessors=(2,)),
            straight_lane(4, (4, -80), (4, -8), successors=(5,)),
            straight_lane(5, (4, -8), (4, 8), predecessors=(4,), successors=(6,), is_intersection=True),
            straight_lane(6, (4, 8), (4, 80), predecessors=(5,)),
            straight_lane(7, (-8, 0), (-5, -8), predecessors=(1,), successors=(8,), is_intersection=True),
            straight_lane(8, (-5, -8), (-5, -80), predecessors=(7,)),
        )
    )  # fmt: skip


def test_crossroads(tmp_path: Path) -> None:
    network = network_of_map(crossroads(), "crossroads", tmp_path)
    assert links_by_sumolib(network) == links_in_map(crossroads())
    check_lies_on_map(network)
    net = sumolib.net.readNet(str(network.net_file), withInternal=True)
    straight_on = {
        network.lane_of_sumo[c.getViaLaneID()]: c
        for edge in net.getEdges(withInternal=False)
        for lane in edge.getLanes()
        for c in lane.getOutgoing()
    }
    east, north = straight_on[1, 2, 3], straight_on[4, 5, 6]
    assert east.getJunction() == north.getJunction()
    assert east.getJunction().areFoes(
        east.getJunctionIndex(), north.getJunctionIndex()
    ), "ways that cross must know of each other"


def test_a_chain_loop_and_lanes_at_the_rim(tmp_path: Path) -> None:
    road_map = RoadMap(
        lanes=(
            straight_lane(1, (0, 0), (30, 0), successors=(2,), is_intersection=True),
            straight_lane(2, (30, 0), (30, 30), predecessors=(1, 4), successors=(3,)),
            straight_lane(3, (30, 30), (0, 30), predecessors=(2,), successors=(4,),
                          is_intersection=True),
            straight_lane(4, (0, 30), (30, 0), predecessors=(3,), successors=(2,),
                          is_intersection=True),
            straight_lane(9, (90, 0), (90.6, 0), is_intersection=True),
            straight_lane(10, (90, 9), (90.6, 9), kind=LaneKind.BIKE),
        )
    )  # fmt: skip
    network = network_of_map(road_map, "loop", tmp_path)
    assert links_by_sumolib(network) == links_in_map(road_map)
    check_lies_on_map(network)


def test_ring_of_junction_lanes(tmp_path: Path) -> None:
    points = [(0, 0), (30, 0), (30, 30), (0, 30)]
    ring = tuple(
        straight_lane(
            n, points[n], points[(n + 1) % 4], successors=((n + 1) % 4,),
            predecessors=((n - 1) % 4,), is_intersection=True,
        )
        for n in range(4)
    )  # fmt: skip
    enter = straight_lane(7, (-30, 0), (0, 0), successors=(0,))
    road_map = RoadMap(lanes=(*ring, enter))
    network = network_of_map(road_map, "ring", tmp_path)
    assert links_by_sumolib(network) == links_in_map(road_map)


def test_map_without_lanes(tmp_path: Path) -> None:
    with pytest.raises(SynthesisError, match="no lanes"):
        network_of_map(RoadMap(lanes=()), "empty", tmp_path)


def check_real(folder: Path, work: Path) -> int:
    road_map = read_scenario(folder).road_map
    network = network_of_map(road_map, folder.name, work / folder.name)
    assert links_by_sumolib(network) == links_in_map(road_map)
    check_lies_on_map(network)
    assert network.road_map is road_map
    return len(links_in_map(road_map))


def test_a_few_real_maps(av2_scenario_folders: list[Path], tmp_path: Path) -> None:
    for folder in av2_scenario_folders[::20]:
        check_real(folder, tmp_path)


@pytest.mark.slow
def test_all_real_maps(av2_scenario_folders: list[Path], tmp_path: Path) -> None:
    assert sum(check_real(folder, tmp_path) for folder in av2_scenario_folders) == 5225
