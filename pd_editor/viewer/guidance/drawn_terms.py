"""Guidance terms made from what is drawn or clicked on the road."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float

from pd_editor.analysis.metrics.road.off_road import outside_m
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.guidance_terms import (
    AvoidCollisions,
    ComfortLimits,
    FollowLane,
    FollowPath,
    GoalPoint,
    GuidanceTerm,
    KeepGap,
    SpeedLimit,
    StayOnRoad,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.scene.paths.lanes.cross_line import cross_line
from pd_editor.scene.paths.lanes.lane_chain import lane_chain
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import lane_kinds_of
from pd_editor.scene.scenario import Scenario

ON_MAP_M: Final = 4.0
"""Distance to the drivable area up to which a point counts as on the map."""
ON_FOOT_M: Final = 20.0
"""The same for agents that walk: pavements are no part of the drivable area."""
LANE_REACH_M: Final = 6.0
"""Largest distance of a click to the centre line of the lane it means."""
PATH_TOLERANCE_M: Final = 0.25
"""Largest distance between a drawn line and its simplified path."""
MAX_PATH_POINTS: Final = 60
LEAST_PATH_M: Final = 3.0
PLACES: Final = 2
"""Decimal places of drawn coordinates: centimetres."""
USUAL_SPEED_MPS: Final = 8.0
USUAL_GAP_M: Final = 10.0

Point = tuple[float, float]


def goal_term(
    scenario: Scenario, agent_id: str, point_m: Float[np.ndarray, "2"]
) -> GoalPoint:
    """Goal of an agent at a point of the road.

    Raises:
        EditError: the point is off the map.
    """
    away = float(outside_m(scenario, point_m[None])[0])
    if away > _reach_m(scenario, agent_id):
        raise EditError(
            f"The goal is {away:.0f} m off the road; drop it on the road or close to it."
        )
    return GoalPoint(agent_id=agent_id, point_m=_rounded(point_m))


def path_term(
    scenario: Scenario, agent_id: str, points_m: Float[np.ndarray, "N 2"]
) -> FollowPath:
    """Path of an agent along a line drawn by hand, simplified to few points.

    Raises:
        EditError: the line is too short, or leaves the map.
    """
    line = shapely.LineString(points_m) if len(points_m) > 1 else None
    if line is None or line.length < LEAST_PATH_M:
        raise EditError(
            f"The path is too short; it takes at least {LEAST_PATH_M:g} m of road."
        )
    tolerance = PATH_TOLERANCE_M
    simple = shapely.get_coordinates(line.simplify(tolerance))
    while len(simple) > MAX_PATH_POINTS:
        tolerance *= 2
        simple = shapely.get_coordinates(line.simplify(tolerance))
    reach = _reach_m(scenario, agent_id)
    away = float(outside_m(scenario, simple).max())
    if away > reach:
        raise EditError(
            f"The path leads {away:.0f} m off the road; draw it on the road or close to "
            "it."
        )
    return FollowPath(agent_id=agent_id, points_m=tuple(map(_rounded, simple)))


def stop_term(
    scenario: Scenario, agent_id: str, point_m: Float[np.ndarray, "2"]
) -> StopAtLine:
    """Stop line of an agent across the lane nearest to a point.

    Raises:
        EditError: no lane is near.
    """
    found = cross_line(
        scenario.road_map,
        point_m,
        kinds=_lane_kinds(scenario, agent_id),
        max_distance_m=LANE_REACH_M,
    )
    if found is None:
        raise EditError("There is no lane here to stop on; click a lane.")
    first, last = (_rounded(point) for point in found[0])
    return StopAtLine(agent_id=agent_id, line_m=(first, last))


def lane_term(
    scenario: Scenario, agent_id: str, point_m: Float[np.ndarray, "2"]
) -> FollowLane:
    """Lanes from an agent's lane to the lane nearest to a point.

    Raises:
        EditError: no lane is near, or it is not reached from the agent's lane.
    """
    agents, step = scenario.agents, scenario.current_step
    kinds = _lane_kinds(scenario, agent_id)
    (row,) = agents.rows([agent_id])
    to = nearest_lanes(scenario.road_map, point_m[None], kinds=kinds)
    start = nearest_lanes(
        scenario.road_map,
        agents.position_m[row, step][None],
        heading_rad=agents.heading_rad[row, step][None],
        kinds=kinds,
    )
    if not to.is_valid[0] or to.distance_m[0] > LANE_REACH_M:
        raise EditError("There is no lane here to follow; click a lane.")
    first, last = int(start.lane_id[0]), int(to.lane_id[0])
    chain = lane_chain(scenario.road_map, first, last, kinds=kinds)
    if chain is None:
        raise EditError(
            f"Lane {last} is not reached from the agent's lane without a lane change; "
            "draw a path instead."
        )
    return FollowLane(agent_id=agent_id, lane_ids=chain)


def usual_term(
    kind: str, scenario: Scenario, agent_ids: Sequence[str]
) -> GuidanceTerm | None:
    """Term of a kind that needs nothing drawn, with usual values; None for others."""
    ids = tuple(agent_ids)
    match kind:
        case TargetSpeed.kind:
            return TargetSpeed(agent_ids=ids, speed_mps=_usual_speed(scenario, ids))
        case SpeedLimit.kind:
            speed = max(_usual_speed(scenario, ids), 1.0)
            return SpeedLimit(agent_ids=ids, speed_mps=speed)
        case KeepGap.kind:
            return KeepGap(agent_ids=ids, gap_m=USUAL_GAP_M)
        case AvoidCollisions.kind:
            return AvoidCollisions(agent_ids=ids)
        case StayOnRoad.kind:
            return StayOnRoad(agent_ids=ids)
        case ComfortLimits.kind:
            return ComfortLimits(agent_ids=ids)
        case _:
            return None


def _usual_speed(scenario: Scenario, agent_ids: tuple[str, ...]) -> float:
    """Mean speed of the agents now, to half a metre per second."""
    agents, step = scenario.agents, scenario.current_step
    rows = agents.rows(agent_ids)
    rows = rows[agents.is_valid[rows, step]]
    if not len(rows):
        return USUAL_SPEED_MPS
    speed = float(np.hypot(*agents.velocity_mps[rows, step].T).mean())
    return round(2 * speed) / 2


def _reach_m(scenario: Scenario, agent_id: str) -> float:
    kind = _kind_of(scenario, agent_id)
    return ON_FOOT_M if kind is AgentKind.PEDESTRIAN else ON_MAP_M


def _lane_kinds(scenario: Scenario, agent_id: str) -> tuple:
    return lane_kinds_of(_kind_of(scenario, agent_id)) or DRIVING_LANES


def _kind_of(scenario: Scenario, agent_id: str) -> AgentKind:
    (row,) = scenario.agents.rows([agent_id])
    return scenario.agents.kinds[row]


def _rounded(point_m: Float[np.ndarray, "2"]) -> Point:
    return round(float(point_m[0]), PLACES), round(float(point_m[1]), PLACES)
