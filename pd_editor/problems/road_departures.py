"""Problems of agents outside the drivable area, which users see as "off the road"."""

from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from jaxtyping import Float, Int

from pd_editor.metrics.road.off_road import drivable_ground, is_off_road
from pd_editor.metrics.step_spans import spans_of
from pd_editor.problems.scene_problem import (
    SceneProblem,
    agent_name,
    at_time,
    capitalised,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

_MEASURED_STEPS: Final = 5
"""Steps of each agent at which its distance from the road is measured."""
_MUCH_FURTHER_M: Final = 0.5
_LEAST_TOLD_M: Final = 0.1
_EXIT_BEHIND_M: Final = 6.0
_EXIT_AHEAD_M: Final = 60.0
"""Drivable areas often extend past the last lane by up to this length."""
_EXIT_HALF_WIDTH_M: Final = 4.0
_EXIT_COSINE: Final = 0.85
"""Least cosine between an agent that leaves the map and the lane that ends there."""


def road_departures(
    scenario: Scenario, steps: Int[np.ndarray, "S"]
) -> list[SceneProblem]:
    """Find vehicles, buses, motorcyclists and cyclists whose centres are off the road.

    ``steps`` increase from the current one on. An agent that drives past the end of a
    lane without a successor leaves the map, not the road, and is not reported.
    """
    agents, now = scenario.agents, scenario.current_step
    evaluated = (
        agents.is_valid[:, steps] & agents.kind_mask(LANE_FOLLOWER_KINDS)[:, None]
    )
    row, at = np.nonzero(evaluated)
    outside = is_off_road(scenario, agents.position_m[row, steps[at]])
    row, at = row[outside], at[outside]
    found = []
    bounds = np.flatnonzero(np.diff(row, prepend=-1, append=-1))
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        one, off = int(row[start]), steps[at[start:end]]
        first = int(off[0])
        if first > now and _leaves_the_map(scenario, one, first):
            continue
        worst, distance, at_first = _distances(scenario, one, off)
        name = capitalised(agent_name(agents, one))
        furthest = _in_metres(distance)
        headline = f"{agents.ids[one]} off the road, {furthest}"
        if first == now:
            present = _in_metres(at_first)
            headline = f"{agents.ids[one]} off the road, {present}"
            message = f"{name} is {present} off the road."
            if distance > at_first + _MUCH_FURTHER_M:
                message = f"{message[:-1]}, later up to {furthest}."
        else:
            message = (
                f"{name} leaves the road {at_time(scenario, first)},"
                f" by up to {furthest}."
            )
        place = agents.position_m[one, first]
        found.append(
            SceneProblem(
                kind="off-road" if first == now else "later-off-road",
                agent_ids=(agents.ids[one],),
                spans=spans_of(off),
                worst_step=worst,
                severity=distance,
                headline=headline,
                message=message,
                place_m=(float(place[0]), float(place[1])),
            )
        )
    return found


def _in_metres(distance_m: float) -> str:
    """A distance from the road; 0.0 m would read as if the agent were on it."""
    return f"{max(distance_m, _LEAST_TOLD_M):.1f} m"


def _leaves_the_map(scenario: Scenario, row: int, first: int) -> bool:
    """Whether an agent that is off the road from a step on left the map there."""
    path = scenario.agents.position_m[row, first - 1 : first + 1]
    if scenario.applied_warp is not None:
        path = scenario.applied_warp.warp.undo(path)
    if not scenario.agents.is_valid[row, first - 1]:
        return False
    ends, ways = _map_exits(scenario.original_road_map)
    moved = path[1] - path[0]
    step_m = float(np.hypot(*moved))
    if step_m == 0:
        return False
    beyond = path[1] - ends
    ahead = (beyond * ways).sum(axis=-1)
    aside = beyond[:, 0] * ways[:, 1] - beyond[:, 1] * ways[:, 0]
    is_through = (
        (ahead > -_EXIT_BEHIND_M)
        & (ahead < _EXIT_AHEAD_M)
        & (np.abs(aside) < _EXIT_HALF_WIDTH_M)
        & (ways @ moved > _EXIT_COSINE * step_m)
    )
    return bool(is_through.any())


@lru_cache(maxsize=16)
def _map_exits(
    road_map: RoadMap,
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]]:
    """Ends of lanes without a successor in the map, and the unit vectors there."""
    there = {lane.lane_id for lane in road_map.lanes}
    last = [
        lane.centerline_m[-2:]
        for lane in road_map.lanes
        if len(lane.centerline) > 1 and there.isdisjoint(lane.successors)
    ]
    points = np.array(last, float).reshape(-1, 2, 2)
    way = points[:, 1] - points[:, 0]
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    is_known = length[:, 0] > 0
    return points[is_known, 1], way[is_known] / length[is_known]


def _distances(
    scenario: Scenario, row: int, steps: Int[np.ndarray, "N"]
) -> tuple[int, float, float]:
    """Step at which an agent is furthest from the road, and its distances.

    The distances are those at that step and at the first step; under a warp they are
    measured on the original road. Only a few steps are evaluated.
    """
    some = steps[
        np.unique(np.linspace(0, len(steps) - 1, _MEASURED_STEPS).round().astype(int))
    ]
    points = scenario.agents.position_m[row, some]
    if scenario.applied_warp is not None:
        points = scenario.applied_warp.warp.undo(points)
    ground = drivable_ground(scenario.original_road_map)
    away = shapely.distance(np.array([ground]), shapely.points(points))
    distance = np.nan_to_num(np.asarray(away))
    worst = int(distance.argmax())
    return int(some[worst]), float(distance[worst]), float(distance[0])
