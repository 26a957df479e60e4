"""Footways on a street with a crosswalk, and people on them."""

import numpy as np
import pytest
import shapely

from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.road_network.footways import OUTSIDE_M, footways_of
from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions
from pd_editor.experiments.synthesis.traffic.pedestrians import sample_pedestrians
from pd_editor.experiments.synthesis.traffic.tracks import (
    overlapping_pairs,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import Crosswalk, DrivableArea, RoadMap
from tests.builders import straight_lane

STEP_S = 0.1
NUM_STEPS = 400
CROWD = DemandOptions(pedestrians_per_km=200.0, pedestrian_spread=0.0)


def street() -> RoadMap:
    """A lane of 120 m on paved ground 8 m wide, crossed in the middle."""
    ring = np.array([[0, -4, 0], [120, -4, 0], [120, 4, 0], [0, 4, 0]], float)
    crosswalk = Crosswalk(
        crosswalk_id=1,
        edge1=np.array([[58, -4, 0], [58, 4, 0]], float),
        edge2=np.array([[62, 4, 0], [62, -4, 0]], float),
    )
    return RoadMap(
        lanes=(straight_lane(1, (0, 0), (120, 0)),),
        crosswalks=(crosswalk,),
        drivable_areas=(DrivableArea(area_id=1, boundary=ring),),
    )


def cars(times_s: tuple[float, ...], speed_mps: float) -> TrafficTracks:
    """Cars that come to the street's start at some times."""
    first = np.rint(np.array(times_s) / STEP_S).astype(int)
    count = round(120 / speed_mps / STEP_S)
    x = np.tile(np.arange(count) * STEP_S * speed_mps, len(first))
    return TrafficTracks(
        ids=tuple(f"car-{n}" for n in range(len(first))),
        kinds=(AgentKind.VEHICLE,) * len(first),
        size_m=np.tile([4.6, 1.9], (len(first), 1)),
        first_step=first,
        first_row=np.arange(len(first) + 1) * count,
        position_m=np.column_stack([x, np.zeros(len(x))]),
        heading_rad=np.zeros(len(x)),
        velocity_mps=np.tile([speed_mps, 0.0], (len(x), 1)),
    )


def pedestrians(traffic: TrafficTracks, seed: int = 1) -> TrafficTracks:
    random = np.random.default_rng(seed)
    return sample_pedestrians(
        footways_of(street()), traffic, CROWD, NUM_STEPS, STEP_S, random
    )


def crossers(tracks: TrafficTracks) -> np.ndarray:
    """Steps at which somebody is on the paved ground."""
    return tracks.step[np.abs(tracks.position_m[:, 1]) < 4.0]


def test_footways_run_beside_the_paved_ground() -> None:
    found = footways_of(street())
    assert len(found.lines_m) == 2, "the ends of the road are no footways"
    ground = shapely.box(0, -4, 120, 4)
    for line in found.lines_m:
        away = shapely.distance(ground, shapely.points(line))
        assert away.min() > OUTSIDE_M - 0.1
        assert away.max() < OUTSIDE_M + 0.1
    (crossing,) = found.crossings
    assert set(crossing.footway) == {0, 1}
    for end, way, along in zip(
        crossing.line_m[[0, -1]], crossing.footway, crossing.along_m, strict=True
    ):
        line = shapely.LineString(found.lines_m[way])
        assert line.interpolate(along).distance(shapely.Point(end)) < 1e-9
        assert abs(end[0] - 60) < 1e-6


def test_a_map_without_lanes_has_no_footways() -> None:
    assert footways_of(RoadMap(lanes=())).lines_m == ()


def test_people_walk_on_footways_and_the_crosswalk() -> None:
    found = pedestrians(cars((), 10.0))
    assert len(found.ids) > 20
    speed = np.linalg.norm(found.velocity_mps, axis=1)
    assert speed.max() < 2.6
    assert (speed < 0.2).mean() > 0.05
    x, y = np.abs(found.position_m.T)
    on_crosswalk = np.abs(x - 60) < 3
    assert (on_crosswalk | (y > 4.0)).all()
    assert y.max() < 4.0 + 2 * OUTSIDE_M
    assert len(crossers(found))
    step = np.linalg.norm(np.diff(found.position_m, axis=0), axis=1)
    assert step[np.diff(found.agent) == 0].max() < 0.27
    assert found.step.min() >= 0
    assert found.step.max() < NUM_STEPS
    assert not len(overlapping_pairs(found, with_pedestrians=True))


def test_nobody_crosses_while_cars_stand_there() -> None:
    still = cars((0.0,), 120 / (NUM_STEPS * STEP_S))
    position = np.tile([60.0, 0.0], (NUM_STEPS, 1))
    parked = TrafficTracks(
        ids=still.ids, kinds=still.kinds, size_m=np.array([[4.6, 7.0]]),
        first_step=still.first_step, first_row=still.first_row, position_m=position,
        heading_rad=still.heading_rad, velocity_mps=np.zeros((NUM_STEPS, 2)),
    )  # fmt: skip
    assert not len(crossers(pedestrians(parked))), "they wait"


@pytest.mark.parametrize("seed", range(3))
def test_people_let_cars_pass(seed: int) -> None:
    traffic = cars((0.0, 9.0, 11.5, 20.0, 33.0), 15.0)
    found = pedestrians(traffic, seed)
    assert len(crossers(found))
    both = traffic.joined(found)
    assert not len(overlapping_pairs(both, with_pedestrians=True))
