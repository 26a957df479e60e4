"""Agents that are off the drivable area: the one meaning of "off the road" for users."""

from typing import Final

import numpy as np
import shapely
from jaxtyping import Int

from pd_editor.metrics.off_road import drivable_ground, is_off_road
from pd_editor.problems.scene_problem import (
    SceneProblem,
    agent_name,
    at_time,
    capitalised,
    spans_of,
)
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.scenario import Scenario

_MEASURED_STEPS: Final = 5
"""Steps of each agent at which its distance from the road is measured."""


def road_departures(
    scenario: Scenario, steps: Int[np.ndarray, "S"]
) -> list[SceneProblem]:
    """Vehicles, buses, motorcyclists and cyclists whose centres are off the road.

    ``steps`` rise from the current one on.
    """
    agents, now = scenario.agents, scenario.current_step
    judged = agents.is_valid[:, steps] & agents.kind_mask(LANE_FOLLOWER_KINDS)[:, None]
    row, at = np.nonzero(judged)
    outside = is_off_road(scenario, agents.position_m[row, steps[at]])
    row, at = row[outside], at[outside]
    found = []
    bounds = np.flatnonzero(np.diff(row, prepend=-1, append=-1))
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        one, off = int(row[start]), steps[at[start:end]]
        first = int(off[0])
        worst, distance = _furthest(scenario, one, off)
        name = capitalised(agent_name(agents, one))
        if first == now:
            message = f"{name} is {distance:.1f} m off the road."
        else:
            message = (
                f"{name} leaves the road {at_time(scenario, first)},"
                f" by up to {distance:.1f} m."
            )
        place = agents.position_m[one, first]
        found.append(
            SceneProblem(
                kind="off-road" if first == now else "later-off-road",
                agent_ids=(agents.ids[one],),
                spans=spans_of(off),
                worst_step=worst,
                severity=distance,
                headline=f"{agents.ids[one]} off the road, {distance:.1f} m",
                message=message,
                place_m=(float(place[0]), float(place[1])),
            )
        )
    return found


def _furthest(
    scenario: Scenario, row: int, steps: Int[np.ndarray, "N"]
) -> tuple[int, float]:
    """The step, among a few, at which an agent is furthest from the road, and how far.

    Under a warp the distance is that on the original road.
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
    return int(some[worst]), float(distance[worst])
