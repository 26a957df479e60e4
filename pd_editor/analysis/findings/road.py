"""Findings on agents outside the drivable area: off the road, or beyond the mapped road."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.findings.finding import Finding, at_time, finding_of_agent
from pd_editor.analysis.metrics.road import departures, outside_m
from pd_editor.scene.perturbation.friction import (
    SAMPLE_SPACING_M,
    WarpSummary,
    summarise,
)
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import Scenario

MIN_RADIUS_M: Final = 5.0
"""Approximate smallest turning radius of a car, measured at its centre."""


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
        if most > at_first + 0.5:
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
    return f"{max(distance_m, 0.1):.1f} m"


def road_problems(scenario: Scenario) -> list[Finding]:
    """One problem if a warp makes the road undrivable, else none."""
    found = [(summarise(warp).min_radius_m, warp) for warp in scenario.warps]
    radius, sharpest = min(found, key=lambda one: one[0], default=(np.inf, None))
    if sharpest is None or not radius < MIN_RADIUS_M:
        return []
    # Half a lane's width: with less, the inner edge of a lane folds over itself.
    is_folded = radius < 1.75
    message = (
        f"The road is folded into spikes: its smallest radius is {radius:.1f} m, less"
        " than half a lane's width."
        if is_folded
        else f"The road bends too sharply: its smallest radius is {radius:.1f} m, and a"
        f" vehicle needs about {MIN_RADIUS_M:g} m."
    )
    return [
        Finding(
            kind="folded-road" if is_folded else "sharp-road",
            agent_ids=(),
            spans=((0, scenario.time_axis.num_steps - 1),),
            worst_step=scenario.current_step,
            value=radius,
            limit=MIN_RADIUS_M,
            headline=(
                "Road folded into spikes" if is_folded else "Road bends too sharply"
            )
            + f", radius {radius:.1f} m",
            message=message,
            place_m=_sharpest_place(sharpest),
        )
    ]


def weakened_to_radius(warp: RoadWarp) -> RoadWarp | None:
    """Scale down all powers of a warp by one factor until it is drivable.

    None if nothing remains of the warp.
    """

    def scaled(share: float) -> RoadWarp:
        # Powers are rounded towards zero to the step of the sliders.
        return replace(
            warp,
            terms=tuple(
                replace(term, power=float(np.trunc(10 * share * term.power) / 10))
                for term in warp.terms
            ),
        )

    def is_drivable(share: float) -> bool:
        summary: WarpSummary = summarise(scaled(share))
        return summary.min_radius_m >= MIN_RADIUS_M

    # Sharpness need not be monotonic in the factor, so the largest valid one is searched.
    for share in np.linspace(1.0, 0.0, 101)[:-1].tolist():
        if is_drivable(share):
            weaker = scaled(share)
            return None if weaker.is_identity else weaker
    return None


def _sharpest_place(warp: RoadWarp) -> tuple[float, float]:
    """Point of largest curvature of a warped road that was straight."""
    end = warp.extent_m()
    x = np.linspace(0.0, end, max(int(end / SAMPLE_SPACING_M), 1) + 1)
    ahead = float(x[np.abs(warp.curvature(x)).argmax()])
    start = np.array([warp.anchor.x_m, warp.anchor.y_m])
    point = start + warp.anchor.turn(np.array([ahead, 0.0]))
    place = warp.apply(point[None])[0]
    return float(place[0]), float(place[1])
