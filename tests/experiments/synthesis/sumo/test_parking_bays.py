"""Parking bays: beside rightmost lanes outside junctions, part of the drivable area."""

from pathlib import Path

import numpy as np
import shapely

from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.sumo.parking_bays import (
    kerb_lanes,
    sample_parking_bays,
)
from tests.builders import straight_lane


def test_bays_are_beside_the_kerb_at_the_angles_of_places() -> None:
    lanes = [straight_lane(n, (0, 20 * n), (100, 20 * n)) for n in range(400)]
    bays = sample_parking_bays(lanes, np.random.default_rng(1))
    assert 20 < len(bays) < 65
    across = np.array([bay.is_perpendicular for bay in bays])
    assert 0.05 < across.mean() < 0.5
    for bay in bays:
        lane = lanes[bay.lane_id]
        area = bay.area()
        assert shapely.Polygon(lane.outline_m()).intersection(area).area < 0.1
        assert area.bounds[3] == lane.right_m[0, 1]
        assert area.bounds[3] - area.bounds[1] > bay.aside_m + 2.0
        assert -np.pi / 2 <= bay.angle_rad <= np.deg2rad(-42.0)


def test_short_lanes_have_no_bay() -> None:
    short = [straight_lane(n, (0, 20 * n), (15, 20 * n)) for n in range(200)]
    assert not sample_parking_bays(short, np.random.default_rng(1))


def test_generated_maps_include_their_bays_in_the_drivable_area(tmp_path: Path) -> None:
    network = generate_network("grid", 3, tmp_path)
    assert network.parking_bays
    kerbs = {lane.lane_id for lane in kerb_lanes(network.road_map.lanes)}
    paved = shapely.union_all(
        [
            shapely.Polygon(area.boundary[:, :2]).buffer(0.3)
            for area in network.road_map.drivable_areas
        ]
    )
    for bay in network.parking_bays:
        assert bay.lane_id in kerbs
        assert bay.area().difference(paved).area < 1.0
