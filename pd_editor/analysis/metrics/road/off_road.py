"""Off-road tests against the drivable area, and agents beyond the mapped road."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Bool, Float

from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

MAX_WAY_TO_ROAD_M: Final = 5.0
"""Largest distance over which an agent is moved back onto the road."""
_EXIT_BEHIND_M: Final = 6.0
_EXIT_AHEAD_M: Final = 60.0
"""Drivable areas often extend past the last lane by up to this length."""
_PAST_END_M: Final = 2.0
_EXIT_HALF_WIDTH_M: Final = 4.0
_EXIT_COSINE: Final = 0.85
"""Least cosine between an agent that leaves the map and the lane that ends there."""

_LENGTHWISE: Final = 0.8
"""Share of a way along an agent's heading from which on the map ends there."""


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
    least_m: float = _PAST_END_M,
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
        (ahead > -_EXIT_BEHIND_M)
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
        ends = (lengthwise > _LENGTHWISE * np.linalg.norm(way, axis=-1)).any(axis=-1)
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
