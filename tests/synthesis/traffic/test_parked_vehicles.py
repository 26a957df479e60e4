"""Parked vehicles: apart from all that moves, at the angles of their places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import RoadMap
from pd_editor.synthesis.road_network.network import Network
from pd_editor.synthesis.traffic.demand_config import ParkingOptions
from pd_editor.synthesis.traffic.parked_vehicles import (
    ParkedVehicles,
    sample_parked_vehicles,
)
from pd_editor.synthesis.traffic.track_smoothing import TrafficTracks
from tests.builders import straight_lane

NOBODY = ParkingOptions(
    kerb_share=0.0, angled_share=0.0, driveways_per_km=0.0, lots_per_km=0.0
)
STREET_M = 400.0


def street(parking_strips_m: tuple[np.ndarray, ...] = ()) -> Network:
    """One lane along the x axis."""
    lane = straight_lane(1, (0, 0), (STREET_M, 0))
    return Network(
        name="street",
        family="street",
        folder=Path(),
        net_file=Path(),
        road_map=RoadMap(lanes=(lane,)),
        lane_of_sumo={},
        has_signals=False,
        parking_strips_m=parking_strips_m,
    )


def one_car(y_m: float) -> TrafficTracks:
    """A car that drives along the street."""
    x = np.arange(0.0, STREET_M, 1.0)
    return TrafficTracks(
        ids=("car",),
        kinds=(AgentKind.VEHICLE,),
        size_m=np.array([[4.6, 1.9]]),
        first_step=np.array([0]),
        first_row=np.array([0, len(x)]),
        position_m=np.column_stack([x, np.full(len(x), y_m)]),
        heading_rad=np.zeros(len(x)),
        velocity_mps=np.tile([10.0, 0.0], (len(x), 1)),
    )


def parked(options: ParkingOptions, seed: int, y_m: float = 0.0) -> ParkedVehicles:
    random = np.random.default_rng(seed)
    return sample_parked_vehicles(street(), one_car(y_m), options, random)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("y_m", [0.0, -2.5])
def test_nobody_parks_in_the_way(seed: int, y_m: float) -> None:
    options = ParkingOptions(kerb_share=0.5, angled_share=0.5, driveways_per_km=40.0)
    found = parked(options, seed, y_m)
    assert len(found.heading_rad)
    boxes = shapely.polygons(found.corners_m())
    one, other = shapely.STRtree(boxes).query(boxes, "intersects")
    assert (one == other).all()
    driven = shapely.box(-2.3, y_m - 0.95, STREET_M + 1.3, y_m + 0.95)
    assert not shapely.intersects(boxes, driven).any()


def test_nobody_parks_where_nothing_is_wanted() -> None:
    assert not len(parked(NOBODY, 1).heading_rad)


def test_vehicles_along_the_kerb_stand_close_and_with_gaps_of_any_length() -> None:
    options = replace(NOBODY, kerb_share=1.0, fullness=(0.5, 0.5))
    rows = [parked(options, seed) for seed in range(40)]
    gaps = np.concatenate([np.diff(np.sort(row.position_m[:, 0])) for row in rows])
    assert gaps.min() >= 5.2 + 0.5
    assert 0.4 < (gaps < 5.2 + 1.6).mean() < 0.6, "as full as asked for"
    free = gaps[gaps > 5.2 + 1.6]
    for low, high in ((7, 9), (9, 11), (11, 13), (13, 16)):
        assert ((free > low) & (free < high)).any()
    turned = np.abs(np.concatenate([row.heading_rad for row in rows])) > np.pi / 2
    assert 0 < turned.mean() < 0.03


def test_fuller_kerbs_hold_more() -> None:
    def count(share: float) -> int:
        options = replace(NOBODY, kerb_share=1.0, fullness=(share, share))
        return sum(len(parked(options, seed).heading_rad) for seed in range(10))

    assert count(0.2) < count(0.5) < count(0.95)


def test_rows_at_an_angle_lie_near_the_lane() -> None:
    options = replace(NOBODY, angled_share=1.0, fullness=(0.6, 0.6))
    rows = [parked(options, seed) for seed in range(60)]
    # Some would reach into the way of the car, all or most of them.
    rows = [row for row in rows if len(row.heading_rad) > 20]
    assert len(rows) > 25
    angles = [np.rad2deg(np.median(row.heading_rad)) for row in rows]
    is_across = np.abs(angles) > 70
    assert 0.1 < is_across.mean() < 0.45
    for row, across in zip(rows, is_across, strict=True):
        aside = -1.75 - np.median(row.position_m[:, 1])
        assert 0.8 < aside < (5.5 if across else 3.7)
        turn = np.rad2deg(row.heading_rad)
        if across:
            turn = np.where(turn > 0, turn - 180, turn)
            assert abs(np.median(turn) + 90) < 25
        else:
            assert -62 < np.median(turn) < -40
        assert np.median(np.abs(turn - np.median(turn))) < 5


def test_strips_beside_the_street_are_used() -> None:
    strip = np.array([[0.0, -3.0], [STREET_M, -3.0]])
    random = np.random.default_rng(3)
    found = sample_parked_vehicles(street((strip,)), one_car(0.0), NOBODY, random)
    assert len(found.heading_rad) > 10
    assert np.abs(found.position_m[:, 1] + 3.0).max() < 1.2
