"""Features of the surroundings of each vehicle: lane, kerb, neighbours, junction.

The scene test of an evaluation is a classifier that tells generated from recorded
vehicles by these features; two of them are metrics of their own.
"""

import zlib
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.road.map_points import nearest_points
from pd_editor.analysis.metrics.road.off_road import drivable_ground, is_off_road
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, measured
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import heading_of, left_of, unit_vector, wrap_angle
from pd_editor.scene.road_map import LaneKind, RoadMap
from pd_editor.scene.thresholds import STANDING_MPS

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
"""Columns of ``surroundings``; metres, radians, metres a second, counts and shares."""
ASKEW_TO_LANE_DEG: Final = (15.0, 75.0)
ASKEW_TO_NEIGHBOUR_DEG: Final = 15.0
_FAR_M: Final = 99.0
"""Value for the distance to a missing neighbour or junction."""
_POSITION_NOISE_M: Final = 0.3
_HEADING_NOISE_RAD: Final = np.radians(3.0)
_SPEED_NOISE_MPS: Final = 0.5
_CREEPING_MPS: Final = 0.5


def surroundings(view: TrafficView) -> MetricValues:
    """Features ``FEATURES`` of each vehicle [A F]; not valid for other kinds.

    States get a tracker's noise, the same for every method, so that a classifier
    cannot recognise generated states by their smoothness; creeping counts as standing.
    """
    evaluated = _vehicles(view)
    values = np.zeros((len(view), len(FEATURES)))
    if evaluated.any() and view.scenario.road_map.lanes:
        values[evaluated] = _features(view, evaluated)
    else:
        evaluated = np.zeros(len(view), bool)
    is_valid = np.repeat(evaluated[:, None], len(FEATURES), axis=1)
    return measured("surroundings", values, is_valid)


def askew(view: TrafficView) -> tuple[MetricValues, MetricValues]:
    """Metrics of stationary vehicles at an angle to the nearest lane or neighbour."""
    agents = view.agents
    speed = np.hypot(*agents.velocity_mps[:, 0].T)
    standing = _vehicles(view) & (speed < STANDING_MPS)
    position, heading = agents.position_m[:, 0], agents.heading_rad[:, 0]
    lane_m, turn = np.full(len(view), np.inf), np.zeros(len(view))
    lane_m[standing], turn[standing] = nearest_lane(
        view.scenario.road_map, position[standing], heading[standing]
    )
    has_lane = np.isfinite(lane_m)
    others = view.everyone
    present = others.is_valid[:, 0] & _is_vehicle(others.kinds)
    distance = _distances(position, others.position_m[:, 0], present)
    nearest = distance.argmin(axis=1) if len(others) else np.zeros(0, int)
    has_neighbour = standing & np.isfinite(distance).any(axis=1)
    apart = _folded_deg(heading - others.heading_rad[nearest, 0])
    low, high = ASKEW_TO_LANE_DEG
    return (
        measured("askew_to_lane", (turn > low) & (turn < high), has_lane),
        measured("askew_to_neighbour", apart > ASKEW_TO_NEIGHBOUR_DEG, has_neighbour),
    )


def nearest_lane(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "V 2"],
    heading_rad: Float[np.ndarray, "V"],
) -> tuple[Float[np.ndarray, "V"], Float[np.ndarray, "V"]]:
    """Distance in metres to the nearest vehicle lane, and the angle to it in degrees.

    Angles are between undirected lines, 0 to 90. Without a lane the distance is infinite.
    """
    points, direction = _lane_points(road_map)
    if not len(points):
        return np.full(len(position_m), np.inf), np.zeros(len(position_m))
    nearest, lane_m = nearest_points(position_m, points)
    return lane_m, _folded_deg(heading_rad - direction[nearest])


def _noisy(
    others: AgentStates,
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Positions, headings and speeds, with a tracker's noise."""
    # Noise depends on the agent's id, not on the order or pose of the scene.
    noise = np.array([_noise_of(name) for name in others.ids]).reshape(len(others), 4)
    heading = others.heading_rad[:, 0]
    ahead = unit_vector(heading)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    offset = noise[:, :1] * ahead + noise[:, 1:2] * aside
    position = others.position_m[:, 0] + _POSITION_NOISE_M * offset
    heading = heading + _HEADING_NOISE_RAD * noise[:, 2]
    speed = np.hypot(*others.velocity_mps[:, 0].T)
    noisy = np.abs(speed + _SPEED_NOISE_MPS * noise[:, 3])
    return position, heading, np.where(speed < _CREEPING_MPS, 0.0, noisy)


def _features(
    view: TrafficView, evaluated: Bool[np.ndarray, "A"]
) -> Float[np.ndarray, "V F"]:
    scenario, others = view.scenario, view.everyone
    present = others.is_valid[:, 0] & _is_vehicle(others.kinds)
    position, heading, speed = _noisy(others)
    rows = np.flatnonzero(evaluated)  # Evaluated agents come first among all.
    here, facing = position[rows], heading[rows]
    points, direction = _lane_points(scenario.road_map)
    nearest, lane_m = nearest_points(here, points)
    lane_angle = np.abs(wrap_angle(facing - direction[nearest]))
    is_off = is_off_road(scenario, here)
    kerb_m = _kerb_distance(view, here) * np.where(is_off, -1.0, 1.0)

    distance = _distances(here, position, present, rows)
    order = np.argsort(distance, axis=1)
    first = order[:, 0]
    offset = position[None] - here[:, None]
    along = (offset * unit_vector(facing)[:, None]).sum(-1)
    across = (offset * left_of(unit_vector(facing))[:, None]).sum(-1)
    counted = np.isfinite(distance)
    is_ahead = counted & (along > 0.0) & (np.abs(across) < 1.8)
    gap_ahead = np.where(is_ahead, along, _FAR_M).min(axis=1)
    near = counted & (distance < 20.0)
    turn = _folded_deg(heading[None] - facing[:, None])
    num_near = near.sum(axis=1)
    each = np.arange(len(rows))
    has_one = counted.any(axis=1)
    stands = speed[rows] == 0.0

    def of_first(values: np.ndarray, missing: float) -> np.ndarray:
        return np.where(has_one, values[each, first], missing)

    second = distance[each, order[:, min(1, len(others) - 1)]]
    return np.column_stack(
        [
            lane_m,
            lane_angle,
            speed[rows],
            is_off,
            kerb_m,
            stands,
            of_first(distance, _FAR_M),
            of_first(np.radians(turn), 0.0),
            of_first(np.abs(along), _FAR_M),
            of_first(np.abs(across), _FAR_M),
            np.where(np.isfinite(second), second, _FAR_M),
            gap_ahead,
            (counted & (distance < 10.0)).sum(axis=1),
            num_near,
            (near & (speed == 0.0)).sum(axis=1),
            (near & (turn < 6.0)).sum(axis=1) / np.maximum(num_near, 1),
            _junction_distance(scenario.road_map, here),
            stands & (lane_m < 1.0) & (lane_angle < 0.3),
        ]
    )


@lru_cache(maxsize=4096)
def _noise_of(agent_id: str) -> tuple[float, ...]:
    """Four standard normal numbers, determined by an agent's id."""
    random = np.random.default_rng(zlib.crc32(agent_id.encode()))
    return tuple(random.standard_normal(4).tolist())


def _distances(
    here_m: Float[np.ndarray, "V 2"],
    others_m: Float[np.ndarray, "B 2"],
    counts: Bool[np.ndarray, "B"],
    own: np.ndarray | None = None,
) -> Float[np.ndarray, "V B"]:
    """Distances to the counted others; infinite to the rest and to oneself."""
    distance = np.hypot(*np.moveaxis(here_m[:, None] - others_m[None], -1, 0))
    distance[:, ~counts] = np.inf
    each = np.arange(len(here_m))
    distance[each, each if own is None else own] = np.inf
    return distance


def _folded_deg(turn_rad: np.ndarray) -> np.ndarray:
    """Angle between two undirected lines, 0 to 90 degrees."""
    return np.abs(np.degrees((turn_rad + np.pi / 2) % np.pi - np.pi / 2))


def _vehicles(view: TrafficView) -> Bool[np.ndarray, "A"]:
    return view.agents.is_valid[:, 0] & _is_vehicle(view.agents.kinds)


def _is_vehicle(kinds: tuple[AgentKind, ...]) -> Bool[np.ndarray, "A"]:
    return np.array([kind is AgentKind.VEHICLE for kind in kinds], bool)


@lru_cache(maxsize=16)
def _lane_points(
    road_map: RoadMap,
) -> tuple[Float[np.ndarray, "P 2"], Float[np.ndarray, "P"]]:
    """Points of the centre lines of vehicle lanes, and the directions there."""
    lines = [
        lane.centerline_m for lane in road_map.lanes if lane.kind is not LaneKind.BIKE
    ]
    points = np.concatenate([np.zeros((0, 2)), *(line[:-1] for line in lines)])
    turns = [heading_of(np.diff(line, axis=0)) for line in lines]
    return points, np.concatenate([np.zeros(0), *turns])


def _kerb_distance(
    view: TrafficView, points_m: Float[np.ndarray, "V 2"]
) -> Float[np.ndarray, "V"]:
    """Distance to the edge of the drivable area."""
    edge = shapely.boundary(drivable_ground(view.scenario.road_map))
    return np.asarray(shapely.distance(edge, shapely.points(points_m)), float)


def _junction_distance(
    road_map: RoadMap, points_m: Float[np.ndarray, "V 2"]
) -> Float[np.ndarray, "V"]:
    """Distance to the nearest lane that branches or ends."""
    tree = _junction_lanes(road_map)
    if not len(tree):
        return np.full(len(points_m), _FAR_M)
    _, distance = tree.query_nearest(
        shapely.points(points_m), return_distance=True, all_matches=False
    )
    return np.minimum(distance, _FAR_M)


@lru_cache(maxsize=16)
def _junction_lanes(road_map: RoadMap) -> shapely.STRtree:
    return shapely.STRtree(
        [
            shapely.LineString(lane.centerline_m)
            for lane in road_map.lanes
            if lane.kind is not LaneKind.BIKE and len(lane.successors) != 1
        ]
    )
