"""Parked vehicles: apart from all that moves, at the angles of their places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo.parking_bays import ParkingBay
from pd_editor.experiments.synthesis.traffic.demand_config import ParkingOptions
from pd_editor.experiments.synthesis.traffic.parked_vehicles import (
    sample_parked_vehicles,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.road_map import RoadMap
from tests.builders import straight_lane

NO_PARKING = ParkingOptions(kerb_share=0.0, driveways_per_km=0.0, lots_per_km=0.0)
STREET_M = 400.0


def street(
    parking_strips_m: tuple[np.ndarray, ...] = (),
    parking_bays: tuple[ParkingBay, ...] = (),
) -> Network:
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
        parking_bays=parking_bays,
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


def parked(options: ParkingOptions, seed: int, y_m: float = 0.0) -> Boxes:
    random = np.random.default_rng(seed)
    return sample_parked_vehicles(street(), one_car(y_m), options, random)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("y_m", [0.0, -2.5])
def test_no_vehicle_parks_in_the_way(seed: int, y_m: float) -> None:
    options = ParkingOptions(kerb_share=0.5, driveways_per_km=40.0)
    found = parked(options, seed, y_m)
    assert len(found.heading_rad)
    boxes = shapely.polygons(found.corners_m())
    one, other = shapely.STRtree(boxes).query(boxes, "intersects")
    assert (one == other).all()
    driven = shapely.box(-2.3, y_m - 0.95, STREET_M + 1.3, y_m + 0.95)
    assert not shapely.intersects(boxes, driven).any()


def test_no_vehicle_parks_where_none_is_wanted() -> None:
    assert not len(parked(NO_PARKING, 1).heading_rad)


def test_vehicles_along_the_kerb_stand_close_and_with_gaps_of_any_length() -> None:
    options = replace(NO_PARKING, kerb_share=1.0, fullness=(0.5, 0.5))
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
        options = replace(NO_PARKING, kerb_share=1.0, fullness=(share, share))
        return sum(len(parked(options, seed).heading_rad) for seed in range(10))

    assert count(0.2) < count(0.5) < count(0.95)


def bay(angle_deg: float, aside_m: float, pitch_m: float) -> ParkingBay:
    return ParkingBay(
        lane_id=1,
        kerb_m=np.array([[10.0, -1.75], [STREET_M - 10.0, -1.75]]),
        angle_rad=np.deg2rad(angle_deg),
        aside_m=aside_m,
        pitch_m=pitch_m,
    )


@pytest.mark.parametrize("angle_deg", [-45.0, -60.0, -90.0])
def test_vehicles_stand_in_a_bay_at_its_angle(angle_deg: float) -> None:
    place = bay(angle_deg, 3.0, 3.5)
    options = replace(NO_PARKING, fullness=(0.6, 0.6))
    random = np.random.default_rng(4)
    found = sample_parked_vehicles(
        street(parking_bays=(place,)), one_car(0.0), options, random
    )
    assert len(found.heading_rad) > 40
    assert shapely.covers(
        place.area().buffer(0.5), shapely.points(found.position_m)
    ).all()
    turn = np.rad2deg(found.heading_rad)
    is_reversed = turn > 0
    assert is_reversed.any() == (angle_deg == -90.0)
    turn = np.where(is_reversed, turn - 180, turn)
    assert np.median(turn) == pytest.approx(angle_deg, abs=2.0)


def test_no_vehicle_parks_along_a_kerb_that_has_a_bay() -> None:
    options = replace(NO_PARKING, kerb_share=1.0, fullness=(0.6, 0.6))
    network = street(parking_bays=(bay(-50.0, 3.0, 3.5),))
    for seed in range(5):
        random = np.random.default_rng(seed)
        found = sample_parked_vehicles(network, one_car(0.0), options, random)
        assert np.abs(found.heading_rad).min() > np.deg2rad(20.0)


def test_strips_beside_the_street_are_used() -> None:
    strip = np.array([[0.0, -3.0], [STREET_M, -3.0]])
    random = np.random.default_rng(3)
    found = sample_parked_vehicles(street((strip,)), one_car(0.0), NO_PARKING, random)
    assert len(found.heading_rad) > 10
    assert np.abs(found.position_m[:, 1] + 3.0).max() < 1.2
