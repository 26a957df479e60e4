"""Agents and the road: the paper's map points, the drivable area, and what is around vehicles.

As in QCNet, map points are every polyline without its last point: centre lines of all
lanes, and the midline of each crosswalk in both directions.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.analysis.metrics.values import MetricValues, measured
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.geometry.path_pieces import (
    PathPieces,
    joined_pieces,
    rectangles_meet,
)
from pd_editor.scene.geometry.polyline import resample
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.road_map import Crosswalk, LaneKind, RoadMap, once_per_map
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS
from scene_test import FEATURES, Road, Vehicles, vehicle_features
from scene_test.features import folded_deg


@dataclass(frozen=True, kw_only=True, eq=False)
class MapPoints:
    """P centre points with the direction of their lines; B boundary points."""

    center_m: Float[np.ndarray, "P 2"]
    heading_rad: Float[np.ndarray, "P"]
    boundary_m: Float[np.ndarray, "B 2"]


def nearest_points(
    points_m: Float[np.ndarray, "N 2"], targets_m: Float[np.ndarray, "P 2"]
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Index of, and distance to, the nearest of at least one target."""
    count = len(points_m)
    # Pairs of points per chunk.
    chunk = max(1, 400_000 // len(targets_m))
    nearest = np.zeros(count, int)
    for start in range(0, count, chunk):
        part = points_m[start : start + chunk]
        squared = (part[:, :1] - targets_m[:, 0]) ** 2
        squared += (part[:, 1:] - targets_m[:, 1]) ** 2
        nearest[start : start + chunk] = squared.argmin(axis=1)
    offset = points_m - targets_m[nearest]
    return nearest, np.hypot(offset[:, 0], offset[:, 1])


def paths_within(
    position_m: Float[np.ndarray, "A S 2"],
    is_valid: Bool[np.ndarray, "A S"],
    targets_m: Float[np.ndarray, "P 2"],
    reach_m: float,
) -> Bool[np.ndarray, "A S"]:
    """Whether any target is within reach of each agent at each step."""
    pieces = PathPieces.of(position_m, is_valid, np.full(len(position_m), reach_m))
    low, high = pieces.path_bounds_m
    agent, target = np.nonzero(
        rectangles_meet(low[:, None], high[:, None], targets_m, targets_m)
    )
    piece, target = pieces.near_boxes(agent, target, targets_m, targets_m)
    result = np.zeros(pieces.is_valid.shape, bool)
    if len(piece):
        position = pieces.position_m[piece]
        squared = (position[..., 0] - targets_m[target, 0, None]) ** 2
        squared += (position[..., 1] - targets_m[target, 1, None]) ** 2
        first = np.flatnonzero(np.diff(piece, prepend=-1))
        least = np.minimum.reduceat(squared, first, axis=0)
        result[piece[first]] = least <= reach_m**2
    return joined_pieces(result & pieces.is_valid, is_valid.shape[1])


@once_per_map
def map_points(road_map: RoadMap) -> MapPoints:
    """Points of a map."""
    centers = [lane.centerline_m for lane in road_map.lanes]
    for crosswalk in road_map.crosswalks:
        midline = _midline(crosswalk)
        centers += [midline, midline[::-1]]
    boundaries = [
        line for lane in road_map.lanes for line in (lane.left_m, lane.right_m)
    ]
    for crosswalk in road_map.crosswalks:
        edges = crosswalk.edge1[:, :2], crosswalk.edge2[:, :2]
        boundaries += [*edges, *(edge[::-1] for edge in edges)]
    nothing = np.zeros((0, 2))
    return MapPoints(
        center_m=np.concatenate([nothing, *(line[:-1] for line in centers)]),
        heading_rad=np.concatenate(
            [np.zeros(0), *(heading_of(np.diff(line, axis=0)) for line in centers)]
        ),
        boundary_m=np.concatenate([nothing, *(line[:-1] for line in boundaries)]),
    )


def _midline(crosswalk: Crosswalk) -> Float[np.ndarray, "N 2"]:
    """Line midway between both edges, with points about 2 m apart."""
    one, two = crosswalk.edge1[:, :2], crosswalk.edge2[:, :2]
    start, end = (one[0] + two[0]) / 2, (one[-1] + two[-1]) / 2
    num_points = int(np.ceil(np.hypot(*(end - start)) / 2.0)) + 1
    return (resample(one, max(num_points, 2)) + resample(two, max(num_points, 2))) / 2


MAX_WAY_TO_ROAD_M: Final = 5.0
"""Largest distance over which an agent is moved back onto the road."""
_EXIT_AHEAD_M: Final = 60.0
"""Drivable areas often extend past the last lane by up to this length."""
_EXIT_HALF_WIDTH_M: Final = 4.0
_EXIT_COSINE: Final = 0.85
"""Least cosine between an agent that leaves the map and the lane that ends there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Departures:
    """Steps of A agents outside the drivable area; only agents that follow lanes have any."""

    is_off_road: Bool[np.ndarray, "A T"]
    is_beyond_map: Bool[np.ndarray, "A T"]
    """Outside after driving past the end of a lane without a successor, or before coming
    in over the start of one without a predecessor: what is there is not mapped."""


@lru_cache(maxsize=16)
def drivable_ground(road_map: RoadMap) -> shapely.Geometry:
    """Union of the drivable areas; of lanes and crosswalks where a map has none.

    Prepared for many point queries, and cached as long as the map is in use.
    """
    if road_map.drivable_areas:
        rings = [area.boundary[:, :2] for area in road_map.drivable_areas]
    else:
        rings = [lane.outline_m() for lane in road_map.lanes]
        rings += [crosswalk.outline_m() for crosswalk in road_map.crosswalks]
    areas = [shapely.Polygon(ring) for ring in rings if len(ring) >= 3]
    ground = shapely.union_all(shapely.make_valid(np.array(areas, object)))
    shapely.prepare(ground)
    return ground


def is_off_road(
    scenario: Scenario, points_m: Float[np.ndarray, "*s 2"]
) -> Bool[np.ndarray, "*s"]:
    """Whether points of the scene are outside the drivable area, as it is drawn."""
    ground = drivable_ground(scenario.road_map)
    return ~shapely.contains_xy(ground, points_m[..., 0], points_m[..., 1])


def outside_m(
    scenario: Scenario, points_m: Float[np.ndarray, "*s 2"]
) -> Float[np.ndarray, "*s"]:
    """Distance of each point to the road; 0 on it, and where there is no road."""
    away = np.zeros(points_m.shape[:-1])
    outside = is_off_road(scenario, points_m)
    points = shapely.points(points_m[outside])
    (row, _), distance = _edges(scenario.road_map).query_nearest(
        points, return_distance=True, all_matches=False
    )
    far = np.zeros(outside.sum())
    far[row] = distance
    away[outside] = far
    return away


@lru_cache(maxsize=16)
def _edges(road_map: RoadMap) -> shapely.STRtree:
    """Straight pieces of the drivable area's outline, for the nearest of many points."""
    rings = shapely.get_rings(shapely.get_parts(drivable_ground(road_map)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    pieces = np.stack([points[:-1], points[1:]], axis=1)[ring[:-1] == ring[1:]]
    return shapely.STRtree(np.asarray(shapely.linestrings(pieces)))


def nearest_on_road(
    scenario: Scenario, point_m: Float[np.ndarray, "2"], inside_m: float
) -> Float[np.ndarray, "2"] | None:
    """Nearest point that is ``inside_m`` within the drivable area; None if none is near."""
    point = shapely.Point(point_m)
    around = point.buffer(MAX_WAY_TO_ROAD_M + 2 * inside_m)
    near = shapely.intersection(drivable_ground(scenario.road_map), around)
    inner = shapely.buffer(near, -inside_m)
    if inner.is_empty or point.distance(inner) > MAX_WAY_TO_ROAD_M:
        return None
    return shapely.get_coordinates(shapely.shortest_line(inner, point))[0]


def departures(scenario: Scenario, agents: AgentStates) -> Departures:
    """Where agents are off the road, and where they are beyond the mapped road.

    The map's ends tell the one from the other by the step over the road's edge, so steps
    before the current one should be given as well.
    """
    outside = agents.is_valid & agents.kind_mask(LANE_FOLLOWER_KINDS)[:, None]
    outside[outside] = is_off_road(scenario, agents.position_m[outside])
    path, road_map = agents.position_m, scenario.road_map
    beyond = _through(outside, agents.is_valid, path, map_ends(road_map, 1))
    back = slice(None, None, -1)
    beyond |= _through(
        outside[:, back],
        agents.is_valid[:, back],
        path[:, back],
        map_ends(road_map, -1),
    )[:, back]
    return Departures(is_off_road=outside & ~beyond, is_beyond_map=beyond)


def is_past_lanes(
    road_map: RoadMap,
    position_m: Float[np.ndarray, "N 2"],
    way: Float[np.ndarray, "N 2"],
    least_m: float = 2.0,
) -> Bool[np.ndarray, "N"]:
    """Whether points lie past the end of a lane without a successor, and on no lane.

    ``way`` are the directions of who is there; they are past the end by more than
    ``least_m``. Drivable areas go on where lanes end.
    """
    points, ways = map_ends(road_map, 1)
    ahead, aside = offsets_from(points, ways, position_m)
    ends_here = (
        (ahead > least_m)
        & (ahead < _EXIT_AHEAD_M)
        & (np.abs(aside) < _EXIT_HALF_WIDTH_M)
        & (way @ ways.T > _EXIT_COSINE)
    )
    is_past = np.array(ends_here.any(axis=1))
    is_past[is_past] = nearest_lanes(road_map, position_m[is_past]).distance_m > least_m
    return is_past


def _through(
    outside: Bool[np.ndarray, "A T"],
    is_valid: Bool[np.ndarray, "A T"],
    position_m: Float[np.ndarray, "A T 2"],
    ends: tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]],
) -> Bool[np.ndarray, "A T"]:
    """Steps outside that follow on a step through one of the map's ends."""
    starts = outside.copy()
    starts[:, 1:] &= ~outside[:, :-1]
    row, at = np.nonzero(starts[:, 1:] & is_valid[:, :-1])
    path = np.stack([position_m[row, at], position_m[row, at + 1]], axis=1)
    points, ways = ends
    moved = path[:, 1] - path[:, 0]
    ahead, aside = offsets_from(points, ways, path[:, 1])
    along = moved @ ways.T
    is_through = (
        (ahead > -6.0)
        & (ahead < _EXIT_AHEAD_M)
        & (np.abs(aside) < _EXIT_HALF_WIDTH_M)
        & (along > _EXIT_COSINE * np.linalg.norm(moved, axis=-1)[:, None])
    ).any(axis=1)
    through = np.zeros_like(outside)
    through[row[is_through], at[is_through] + 1] = True
    # Each step outside belongs to the last start before it.
    step = np.arange(outside.shape[1])
    start = np.maximum.accumulate(np.where(starts, step, 0), axis=1)
    return outside & np.take_along_axis(through, start, axis=1)


def offsets_from(
    points_m: Float[np.ndarray, "N 2"],
    ways: Float[np.ndarray, "N 2"],
    position_m: Float[np.ndarray, "A 2"],
) -> tuple[Float[np.ndarray, "A N"], Float[np.ndarray, "A N"]]:
    """Of each position, how far ahead of points it is along their ways, and how far aside."""
    offset = position_m[:, None] - points_m
    ahead = (offset * ways).sum(-1)
    return ahead, offset[..., 0] * ways[:, 1] - offset[..., 1] * ways[:, 0]


@lru_cache(maxsize=32)
def map_ends(
    road_map: RoadMap, way: int
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]]:
    """Ends of lanes without a successor in the map, and the unit vectors out of them.

    With ``way`` -1, starts of lanes without a predecessor, and the vectors out of these.
    """
    there = {lane.lane_id for lane in road_map.lanes}
    last = [
        lane.centerline_m[-2:] if way > 0 else lane.centerline_m[1::-1]
        for lane in road_map.lanes
        if len(lane.centerline) > 1
        and there.isdisjoint(lane.successors if way > 0 else lane.predecessors)
    ]
    points = np.array(last, float).reshape(-1, 2, 2)
    out = points[:, 1] - points[:, 0]
    length = np.linalg.norm(out, axis=-1, keepdims=True)
    is_known = length[:, 0] > 0
    return points[is_known, 1], out[is_known] / length[is_known]


def way_back_m(
    scenario: Scenario,
    corners_m: Float[np.ndarray, "*s T 4 2"],
    heading_rad: Float[np.ndarray, "*s T"],
) -> Float[np.ndarray, "*s T 4 2"]:
    """Vectors from boxes' corners to the road's edge at T steps; zero on the road.

    From the step on at which an agent leaves the road ahead or behind they are zero: there
    the map ends.
    """
    way = np.zeros(corners_m.shape)
    off = is_off_road(scenario, corners_m)
    if off.any():
        way[off] = _nearest_on_edge(scenario, corners_m[off]) - corners_m[off]
        ahead = unit_vector(heading_rad)
        lengthwise = np.abs((way * ahead[..., None, :]).sum(-1))
        # Share of a way along an agent's heading from which on the map ends there.
        ends = (lengthwise > 0.8 * np.linalg.norm(way, axis=-1)).any(axis=-1)
        way[np.maximum.accumulate(ends, axis=-1)] = 0.0
    return way


def _nearest_on_edge(
    scenario: Scenario, points_m: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "N 2"]:
    """Nearest point of the road's edge to each point."""
    lines = shapely.shortest_line(
        road_edge(scenario.road_map), shapely.points(points_m)
    )
    return shapely.get_coordinates(shapely.get_point(lines, 0))


@lru_cache(maxsize=16)
def road_edge(road_map: RoadMap) -> shapely.Geometry:
    """Edge of the road, cached as long as the map is in use."""
    edge = shapely.boundary(drivable_ground(road_map))
    shapely.prepare(edge)
    return edge


ASKEW_TO_LANE_DEG: Final = (15.0, 75.0)
ASKEW_TO_NEIGHBOUR_DEG: Final = 15.0


def surroundings(view: TrafficView) -> MetricValues:
    """Features of the scene test of each vehicle [A F]; not valid for other kinds."""
    present = _vehicles(view.everyone)
    evaluated = present[: len(view)]  # Evaluated agents come first.
    road = _road(view.scenario.road_map)
    values = np.zeros((len(view), len(FEATURES)))
    if evaluated.any() and road.lines_m:
        now = view.everyone.taken(present)
        found = vehicle_features(
            Vehicles(
                ids=now.ids,
                position_m=now.position_m[:, 0],
                heading_rad=now.heading_rad[:, 0],
                speed_mps=now.speed_mps()[:, 0],
            ),
            road,
        )
        values[evaluated] = found[: evaluated.sum()]
    else:
        evaluated = np.zeros(len(view), bool)
    is_valid = np.repeat(evaluated[:, None], len(FEATURES), axis=1)
    return measured("surroundings", values, is_valid)


def askew(view: TrafficView) -> tuple[MetricValues, MetricValues]:
    """Metrics of stationary vehicles at an angle to the nearest lane or neighbour."""
    agents = view.agents
    speed = np.hypot(*agents.velocity_mps[:, 0].T)
    standing = _vehicles(agents) & (speed < STANDING_MPS)
    position, heading = agents.position_m[:, 0], agents.heading_rad[:, 0]
    lane_m, turn = np.full(len(view), np.inf), np.zeros(len(view))
    lane_m[standing], turn[standing] = nearest_lane(
        view.scenario.road_map, position[standing], heading[standing]
    )
    has_lane = np.isfinite(lane_m)
    others = view.everyone
    distance = np.linalg.norm(position[:, None] - others.position_m[:, 0], axis=-1)
    distance[:, ~_vehicles(others)] = np.inf
    np.fill_diagonal(distance, np.inf)  # Evaluated agents come first among all.
    nearest = distance.argmin(axis=1) if len(others) else np.zeros(0, int)
    has_neighbour = standing & np.isfinite(distance).any(axis=1)
    apart = folded_deg(heading - others.heading_rad[nearest, 0])
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
    points, direction = _road(road_map).points
    if not len(points):
        return np.full(len(position_m), np.inf), np.zeros(len(position_m))
    nearest, lane_m = nearest_points(position_m, points)
    return lane_m, folded_deg(heading_rad - direction[nearest])


def _vehicles(agents: AgentStates) -> Bool[np.ndarray, "A"]:
    return agents.is_valid[:, 0] & agents.kind_mask((AgentKind.VEHICLE,))


@lru_cache(maxsize=16)
def _road(road_map: RoadMap) -> Road:
    lanes = [lane for lane in road_map.lanes if lane.kind is not LaneKind.BIKE]
    return Road(
        lines_m=[lane.centerline_m for lane in lanes],
        num_successors=[len(lane.successors) for lane in lanes],
        ground=drivable_ground(road_map),
    )
