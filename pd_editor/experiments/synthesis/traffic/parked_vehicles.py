"""Samples parked vehicles: along the kerb, in bays, in driveways, on small lots.

They are sampled after the simulation, where no agent drove or walked.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.experiments.recordings.recording import TrafficTracks
from pd_editor.experiments.synthesis.road_network.network import Network
from pd_editor.experiments.synthesis.sumo.parking_bays import (
    ParkingBay,
    kerb_lanes,
)
from pd_editor.experiments.synthesis.traffic.demand_config import ParkingOptions
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.geometry.lines import Lines
from pd_editor.scene.geometry.oriented_box import Boxes, box_corners
from pd_editor.scene.geometry.polyline import arc_length, point_at
from pd_editor.scene.road_map import Crosswalk, Lane, RoadMap

SWEEP_SPACING_M: Final = 0.6
"""Distance between the boxes that approximate the area swept by a vehicle."""

CLEARANCE_M: Final = 0.15
"""Least gap between a parked vehicle and the area swept by traffic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Places:
    """Possible poses of parked vehicles."""

    position_m: Float[np.ndarray, "K 2"]
    heading_rad: Float[np.ndarray, "K"]
    is_on_road: bool
    """Whether vehicles may reach into a lane."""


def sample_parked_vehicles(
    network: Network,
    traffic: TrafficTracks,
    options: ParkingOptions,
    random: np.random.Generator,
) -> Boxes:
    """Sample parked vehicles that touch neither traffic nor each other."""
    places = [
        _along(line, options, options.strip_end_m, random.uniform(-0.35, 0.45), random)
        for line in network.parking_strips_m
    ]
    places += [_in_bay(bay, options, random) for bay in network.parking_bays]
    has_bay = {bay.lane_id for bay in network.parking_bays}
    for lane in kerb_lanes(network.road_map.lanes):
        kerb = lane.right_m
        if lane.lane_id not in has_bay and random.random() < options.kerb_share:
            aside = random.uniform(-0.9, 1.2)
            places.append(_along(kerb, options, options.kerb_end_m, aside, random))
        places.append(_driveways(kerb, options, random))
        places.append(_lots(kerb, options, random))
    count = sum(len(one.heading_rad) for one in places)
    size = np.column_stack(
        [
            np.clip(random.normal(4.75, 0.35, count), 3.9, 5.9),
            np.clip(random.normal(1.92, 0.08, count), 1.7, 2.15),
        ]
    )
    parked = Boxes(
        size_m=size,
        position_m=np.concatenate([np.zeros((0, 2)), *(p.position_m for p in places)]),
        heading_rad=np.concatenate([np.zeros(0), *(p.heading_rad for p in places)]),
    )
    on_road = np.repeat(
        [one.is_on_road for one in places], [len(one.heading_rad) for one in places]
    ).astype(bool)
    return parked[_is_free(parked, on_road, network.road_map, traffic)]


def _along(
    line: Float[np.ndarray, "N 2"],
    options: ParkingOptions,
    end_m: float,
    aside_m: float,
    random: np.random.Generator,
) -> _Places:
    """Places in a row, ``aside_m`` to the right of a line."""
    length = arc_length(line)[-1] - 2 * end_m
    num_slots = max(int(length / (options.place_m + np.mean(options.slot_gap_m))), 0)
    taken = random.uniform(*options.fullness)
    # Places are not marked, so that gaps between vehicles have any length.
    is_followed = random.random(num_slots) < taken
    free = random.exponential(options.place_m / max(taken, 1e-3), num_slots)
    pitch = (
        options.place_m
        + random.uniform(*options.slot_gap_m, num_slots)
        + free * ~is_followed
    )
    at = end_m + random.uniform(0.0, 3.0) + np.cumsum(pitch)
    at = at[at < length + end_m]
    right = aside_m + random.normal(0.0, 0.18, len(at))
    position, heading = _beside(line, at, right)
    turned = np.where(random.random(len(at)) < options.turned_share, np.pi, 0.0)
    noise = np.deg2rad(np.clip(1.2 * random.standard_t(2, len(at)), -20.0, 20.0))
    return _Places(
        position_m=position,
        heading_rad=wrap_angle(heading + turned + noise),
        is_on_road=True,
    )


def _in_bay(
    bay: ParkingBay, options: ParkingOptions, random: np.random.Generator
) -> _Places:
    """Occupied places of a bay."""
    at = np.arange(bay.pitch_m / 2, arc_length(bay.kerb_m)[-1], bay.pitch_m)
    at = at[random.random(len(at)) < random.uniform(*options.fullness)]
    aside = bay.aside_m + random.normal(0.0, 0.25, len(at))
    position, heading = _beside(bay.kerb_m, at, aside)
    turn = bay.angle_rad + np.deg2rad(
        np.clip(2.0 * random.standard_t(2, len(at)), -25.0, 25.0)
    )
    if bay.is_perpendicular:
        # Some vehicles were reversed into their places.
        turn = turn + np.where(
            random.random(len(at)) < options.reversed_share, np.pi, 0.0
        )
    return _Places(
        position_m=position, heading_rad=wrap_angle(heading + turn), is_on_road=True
    )


def _driveways(
    kerb: Float[np.ndarray, "N 2"], options: ParkingOptions, random: np.random.Generator
) -> _Places:
    """Single places off the street: perpendicular, at an angle, or parallel to it."""
    length = arc_length(kerb)[-1]
    count = random.poisson(options.driveways_per_km * length / 1000)
    at = random.uniform(0.0, length, count)
    position, heading = _beside(kerb, at, random.uniform(3.0, 10.0, count))
    turn = np.deg2rad(
        random.choice(options.driveway_deg, count, p=options.driveway_shares)
    )
    turn = turn + random.normal(0.0, np.deg2rad(options.driveway_spread_deg), count)
    return _Places(
        position_m=position, heading_rad=wrap_angle(heading + turn), is_on_road=False
    )


def _lots(
    kerb: Float[np.ndarray, "N 2"], options: ParkingOptions, random: np.random.Generator
) -> _Places:
    """Places of small parking lots: two rows that face each other."""
    length = arc_length(kerb)[-1]
    count = random.poisson(options.lots_per_km * length / 1000)
    positions, headings = [np.zeros((0, 2))], [np.zeros(0)]
    for at in random.uniform(0.0, length, count):
        near_m = random.uniform(5.0, 11.0)
        middle, heading = _beside(kerb, np.array([at]), np.array([near_m]))
        num_places = int(random.integers(4, 14))
        along = (np.arange(num_places) - num_places / 2) * options.lot_pitch_m
        fullness = random.uniform(*options.fullness)
        ahead = unit_vector(heading)[0]
        right = -left_of(ahead)
        for row in range(int(random.integers(1, 3))):
            taken = random.random(num_places) < fullness
            offset = row * (options.lot_aisle_m + 5.0) + random.normal(
                0.0, 0.2, taken.sum()
            )
            positions.append(
                middle + along[taken, None] * ahead + offset[:, None] * right
            )
            turn = random.choice([np.pi / 2, -np.pi / 2], int(taken.sum()))
            headings.append(heading[0] + turn + random.normal(0, 0.03, len(turn)))
    return _Places(
        position_m=np.concatenate(positions),
        heading_rad=wrap_angle(np.concatenate(headings)),
        is_on_road=False,
    )


def _beside(
    line: Float[np.ndarray, "N 2"],
    along_m: Float[np.ndarray, "K"],
    right_m: Float[np.ndarray, "K"],
) -> tuple[Float[np.ndarray, "K 2"], Float[np.ndarray, "K"]]:
    """Points to the right of points on a line, and the line's heading there."""
    reach = point_at(line, along_m + 2.0) - point_at(line, along_m - 2.0)
    heading = heading_of(reach)
    right = -left_of(unit_vector(heading))
    return point_at(line, along_m) + right_m[:, None] * right, heading


def _is_free(
    parked: Boxes,
    on_road: Bool[np.ndarray, "K"],
    road_map: RoadMap,
    traffic: TrafficTracks,
) -> Bool[np.ndarray, "K"]:
    """Which vehicles are clear of traffic, lanes, crosswalks and each other."""
    boxes = _polygons(parked.corners_m())
    free = ~_touched(boxes, _swept(traffic))
    free &= on_road | ~_touched(boxes, _areas(road_map.lanes))
    junctions = tuple(lane for lane in road_map.lanes if lane.is_intersection)
    free &= ~_touched(boxes, _areas((*junctions, *road_map.crosswalks)))
    rows = np.flatnonzero(free)
    one, other = shapely.STRtree(boxes[rows]).query(boxes[rows], "intersects")
    for first, second in np.sort(np.stack([one, other], axis=1), axis=1).tolist():
        if first != second and free[rows[first]]:
            free[rows[second]] = False
    return free


def _areas(parts: tuple[Lane | Crosswalk, ...]) -> np.ndarray:
    rings = Lines.of([part.outline_m() for part in parts])
    lines: Any = shapely.linearrings(rings.points_m, indices=rings.line)
    return _polygons(lines)


def _polygons(rings: np.ndarray) -> np.ndarray:
    polygons: Any = shapely.polygons(rings)
    return polygons


def _touched(boxes: np.ndarray, areas: np.ndarray) -> Bool[np.ndarray, "K"]:
    touched = np.zeros(len(boxes), bool)
    if len(boxes) and len(areas):
        box, _ = shapely.STRtree(areas).query(boxes, "intersects")
        touched[box] = True
    return touched


def _swept(traffic: TrafficTracks) -> np.ndarray:
    """Slightly enlarged boxes that cover the area swept by traffic."""
    moved = np.linalg.norm(np.diff(traffic.position_m, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(moved)])
    mark = np.floor(travelled / SWEEP_SPACING_M)
    wanted = np.ones(len(traffic.position_m), bool)
    wanted[1:] = (np.diff(mark) != 0) | (np.diff(traffic.agent) != 0)
    size = traffic.size_m[traffic.agent[wanted]]
    size = size + np.array([SWEEP_SPACING_M, 0.0]) + 2 * CLEARANCE_M
    corners = box_corners(traffic.position_m[wanted], traffic.heading_rad[wanted], size)
    return _polygons(corners)
