"""Findings on agents outside the drivable area: off the road, or beyond the mapped road."""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.findings.finding import Finding, at_time, finding_of_agent
from pd_editor.analysis.metrics.road.off_road import departures, outside_m
from pd_editor.scene.scenario import Scenario

_MUCH_FURTHER_M: Final = 0.5
_LEAST_TOLD_M: Final = 0.1


def road_departures(scenario: Scenario, steps: Int[np.ndarray, "S"]) -> list[Finding]:
    """Find vehicles, buses, motorcyclists and cyclists whose centres are off the road.

    ``steps`` increase from the current one on. Agents beyond the mapped road are told,
    too; that is no problem.
    """
    found = departures(scenario, scenario.agents)
    off, beyond = found.is_off_road[:, steps], found.is_beyond_map[:, steps]
    distance = np.zeros(off.shape)
    distance[off] = outside_m(scenario, scenario.agents.position_m[:, steps][off])
    return [
        *(
            _off_road(scenario, row, steps[off[row]], distance[row, off[row]])
            for row in _rows(off)
        ),
        *(
            finding_of_agent(
                scenario,
                "beyond-map",
                row,
                steps[beyond[row]],
                value=float(beyond[row].sum() * scenario.time_axis.step_s),
                words=(
                    " beyond the mapped road",
                    "is where nothing is mapped: its lane ends at the map's edge.",
                ),
            )
            for row in _rows(beyond)
        ),
    ]


def _rows(holds: np.ndarray) -> list[int]:
    return np.flatnonzero(holds.any(axis=1)).tolist()


def _off_road(
    scenario: Scenario,
    row: int,
    off: Int[np.ndarray, "N"],
    distance_m: Float[np.ndarray, "N"],
) -> Finding:
    first, worst, at_first = int(off[0]), int(distance_m.argmax()), distance_m[0]
    most = float(distance_m[worst])
    furthest, is_now = _in_metres(most), first == scenario.current_step
    if is_now:
        message = f"is {_in_metres(at_first)} off the road"
        if most > at_first + _MUCH_FURTHER_M:
            message += f", later up to {furthest}"
    else:
        message = f"leaves the road {at_time(scenario, first)}, by up to {furthest}"
    return finding_of_agent(
        scenario,
        "off-road" if is_now else "later-off-road",
        row,
        off,
        value=most,
        words=(
            f" off the road, {_in_metres(at_first) if is_now else furthest}",
            f"{message}.",
        ),
        worst=int(off[worst]),
    )


def _in_metres(distance_m: float) -> str:
    """A distance from the road; 0.0 m would read as if the agent were on it."""
    return f"{max(distance_m, _LEAST_TOLD_M):.1f} m"
