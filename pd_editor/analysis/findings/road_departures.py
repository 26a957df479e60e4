"""Findings on agents outside the drivable area: off the road, or beyond the mapped road."""

from typing import Final

import numpy as np
import shapely
from jaxtyping import Int

from pd_editor.analysis.findings.finding import Finding, at_time, finding_of_agent
from pd_editor.analysis.metrics.road.off_road import departures, drivable_ground
from pd_editor.scene.scenario import Scenario

_MEASURED_STEPS: Final = 5
"""Steps of each agent at which its distance from the road is measured."""
_MUCH_FURTHER_M: Final = 0.5
_LEAST_TOLD_M: Final = 0.1


def road_departures(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> list[Finding]:
    """Find vehicles, buses, motorcyclists and cyclists whose centres are off the road.

    ``steps`` increase from the current one on. Agents beyond the mapped road are told,
    too; that is no problem.
    """
    found = departures(scenario, scenario.agents)
    off, beyond = found.is_off_road[:, steps], found.is_beyond_map[:, steps]
    return [
        *(_off_road(scenario, row, steps[off[row]]) for row in _rows(off)),
        *(
            finding_of_agent(
                scenario,
                "beyond-map",
                row,
                steps[beyond[row]],
                value=float(beyond[row].sum() * scenario.time_axis.step_s),
                words=" beyond the mapped road",
                message="is where nothing is mapped: its lane ends at the map's edge.",
            )
            for row in _rows(beyond)
        ),
    ]


def _rows(holds: np.ndarray) -> list[int]:
    return np.flatnonzero(holds.any(axis=1)).tolist()


def _off_road(scenario: Scenario, row: int, off: Int[np.ndarray, "N"]) -> Finding:
    first = int(off[0])
    worst, distance, at_first = _distances(scenario, row, off)
    furthest, is_now = _in_metres(distance), first == scenario.current_step
    if is_now:
        message = f"is {_in_metres(at_first)} off the road"
        if distance > at_first + _MUCH_FURTHER_M:
            message += f", later up to {furthest}"
    else:
        message = f"leaves the road {at_time(scenario, first)}, by up to {furthest}"
    return finding_of_agent(
        scenario,
        "off-road" if is_now else "later-off-road",
        row,
        off,
        value=distance,
        words=f" off the road, {_in_metres(at_first) if is_now else furthest}",
        message=f"{message}.",
        worst=worst,
    )


def _in_metres(distance_m: float) -> str:
    """A distance from the road; 0.0 m would read as if the agent were on it."""
    return f"{max(distance_m, _LEAST_TOLD_M):.1f} m"


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
