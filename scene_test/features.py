"""Features of the surroundings of each vehicle: lane, kerb, neighbours, junction."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
import shapely

FEATURES: Final = (
    "lane distance",
    "lane angle",
    "speed",
    "off the drivable area",
    "kerb distance",
    "standing",
    "nearest distance",
    "nearest angle",
    "nearest along",
    "nearest across",
    "second distance",
    "distance ahead",
    "vehicles within 10 m",
    "vehicles within 20 m",
    "standing within 20 m",
    "aligned within 20 m",
    "junction distance",
    "stands in a lane",
)
"""Metres, radians, metres a second, counts and shares."""
_FAR_M: Final = 99.0
"""Value for the distance to a missing neighbour or junction."""
_POSITION_NOISE_M: Final = 0.3
_HEADING_NOISE_RAD: Final = np.radians(3.0)
_SPEED_NOISE_MPS: Final = 0.5
_CREEPING_MPS: Final = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Vehicles:
    """V vehicles of one scene at one time."""

    ids: Sequence[str]
    position_m: np.ndarray
    """[V 2]"""
    heading_rad: np.ndarray
    """[V]"""
    speed_mps: np.ndarray
    """[V]"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Road:
    """Centre lines of the lanes that vehicles drive on, and the drivable area."""

    lines_m: Sequence[np.ndarray]
    """Points of each lane [P 2]."""
    num_successors: Sequence[int]
    ground: shapely.Geometry

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of all lines but their ends [P 2], and the directions there [P]."""
        points = [line[:-1] for line in self.lines_m]
        along = [np.diff(line, axis=0) for line in self.lines_m]
        x, y = np.concatenate([np.zeros((0, 2)), *along]).T
        return np.concatenate([np.zeros((0, 2)), *points]), np.arctan2(y, x)

    @cached_property
    def junctions(self) -> shapely.STRtree:
        """Lines of the lanes that branch or end."""
        lanes = zip(self.lines_m, self.num_successors, strict=True)
        return shapely.STRtree(
            [shapely.LineString(line) for line, after in lanes if after != 1]
        )


def vehicle_features(vehicles: Vehicles, road: Road) -> np.ndarray:
    """``FEATURES`` of each vehicle [V F], on a road with a lane.

    States get a tracker's noise, the same for every method, so that a classifier
    cannot recognise generated states by their smoothness; creeping counts as standing.
    """
    here, facing, speed = _noisy(vehicles)
    points, direction = road.points
    nearest = [((points - one) ** 2).sum(axis=1).argmin() for one in here]
    lane_m = np.linalg.norm(here - points[nearest], axis=1)
    lane_angle = np.abs(np.angle(np.exp(1j * (facing - direction[nearest]))))
    is_off = ~shapely.contains_xy(road.ground, here[:, 0], here[:, 1])
    kerb_m = shapely.distance(shapely.boundary(road.ground), shapely.points(here))

    distance = np.linalg.norm(here[:, None] - here, axis=-1)
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1)
    each, first, second = np.arange(len(here)), order[:, 0], order[:, :2][:, -1]
    ahead = np.stack([np.cos(facing), np.sin(facing)], axis=-1)
    offset = here[None] - here[:, None]
    along = (offset * ahead[:, None]).sum(axis=-1)
    across = offset[..., 1] * ahead[:, None, 0] - offset[..., 0] * ahead[:, None, 1]
    counted = np.isfinite(distance)
    is_ahead = counted & (along > 0.0) & (np.abs(across) < 1.8)
    near = distance < 20.0
    turn = folded_deg(facing[None] - facing[:, None])
    num_near = near.sum(axis=1)
    stands = speed == 0.0

    def of(neighbour: np.ndarray, values: np.ndarray, missing: float) -> np.ndarray:
        found = values[each, neighbour]
        return np.where(np.isfinite(distance[each, neighbour]), found, missing)

    return np.column_stack(
        [
            lane_m,
            lane_angle,
            speed,
            is_off,
            np.where(is_off, -kerb_m, kerb_m),
            stands,
            of(first, distance, _FAR_M),
            of(first, np.radians(turn), 0.0),
            of(first, np.abs(along), _FAR_M),
            of(first, np.abs(across), _FAR_M),
            of(second, distance, _FAR_M),
            np.where(is_ahead, along, _FAR_M).min(axis=1),
            (distance < 10.0).sum(axis=1),
            num_near,
            (near & (speed == 0.0)).sum(axis=1),
            (near & (turn < 6.0)).sum(axis=1) / np.maximum(num_near, 1),
            _junction_distance(road, here),
            stands & (lane_m < 1.0) & (lane_angle < 0.3),
        ]
    )


def folded_deg(turn_rad: np.ndarray) -> np.ndarray:
    """Angle between two undirected lines, 0 to 90 degrees."""
    return np.abs(np.degrees((turn_rad + np.pi / 2) % np.pi - np.pi / 2))


def _noisy(vehicles: Vehicles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, headings and speeds, with a tracker's noise."""
    # Noise depends on the agent's id, not on the order or pose of the scene.
    noise = np.array([_noise_of(name) for name in vehicles.ids]).reshape(-1, 4)
    heading, speed = vehicles.heading_rad, vehicles.speed_mps
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    offset = noise[:, :1] * ahead + noise[:, 1:2] * aside
    noisy = np.abs(speed + _SPEED_NOISE_MPS * noise[:, 3])
    return (
        vehicles.position_m + _POSITION_NOISE_M * offset,
        heading + _HEADING_NOISE_RAD * noise[:, 2],
        np.where(speed < _CREEPING_MPS, 0.0, noisy),
    )


@lru_cache(maxsize=4096)
def _noise_of(agent_id: str) -> tuple[float, ...]:
    """Four standard normal numbers, determined by an agent's id."""
    random = np.random.default_rng(zlib.crc32(agent_id.encode()))
    return tuple(random.standard_normal(4).tolist())


def _junction_distance(road: Road, here: np.ndarray) -> np.ndarray:
    """Distance to the nearest lane that branches or ends."""
    if not len(road.junctions):
        return np.full(len(here), _FAR_M)
    _, distance = road.junctions.query_nearest(
        shapely.points(here), return_distance=True, all_matches=False
    )
    return np.minimum(distance, _FAR_M)
