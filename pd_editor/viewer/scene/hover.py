"""Tooltip of the agent or lane under a resting pointer."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from pd_editor.scene.paths.lanes.nearest_lane import nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import ON_LANE_M, lane_kinds_of
from pd_editor.scene.perturbation.warp_scenario import untouched_agent_ids
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.overlay.messages import TooltipState
from pd_editor.viewer.scene.picking import (
    PointerRay,
    agent_under,
    lane_under,
    number_of,
)
from pd_editor.viewer.tab.ui_context import UiContext


class Hover:
    """Answers requests of the page, one each time that the pointer comes to rest."""

    def __init__(self, ui: UiContext) -> None:
        """Listen to the page."""
        self._ui = ui
        self._model = ui.model
        ui.overlay.on("tooltip", self._heard)

    def _heard(self, event: Mapping[str, Any]) -> None:
        """Send the tooltip; none during playback."""
        ray, ask = PointerRay.of_event(event), number_of(event.get("ask"))
        playback = self._ui.workspace.playback
        if (
            ray is None
            or ask is None
            or playback.is_playing
            or self._model.mode is not None
        ):
            return
        poses, agents = self._model.poses, self._ui.session.scenario.agents
        if poses is None:
            return
        row = agent_under(agents, poses, ray)
        lines = self._lines(ray, row)
        if lines:
            state = TooltipState(
                at=(ray.x_px, ray.y_px),
                lines=tuple(lines),
                agent=None if row is None else agents.ids[row],
                asked=int(ask),
            )
            self._ui.overlay.show(state)

    def _lines(self, ray: PointerRay, row: int | None) -> list[str]:
        session = self._ui.session
        scenario = session.scenario
        if row is not None:
            step = self._ui.workspace.playback.step
            return agent_lines(scenario, session.original, row, step)
        lane = (
            None
            if ray.ground_m is None
            else lane_under(scenario.road_map, ray.ground_m)
        )
        return [] if lane is None else lane_lines(lane)


def agent_lines(scenario: Scenario, base: Scenario, row: int, step: float) -> list[str]:
    """Lines of an agent's tooltip: name, speed, lane, and special properties."""
    agents, agent_id = scenario.agents, scenario.agents.ids[row]
    nearest = int(np.clip(np.round(step), 0, agents.num_steps - 1))
    speed = float(np.hypot(*agents.velocity_mps[row, nearest]))
    kind = agents.kinds[row].in_words
    lines = [f"{kind} {agent_id}", f"{speed:.1f} m/s ({speed * 3.6:.0f} km/h)"]
    lane_kinds = lane_kinds_of(agents.kinds[row])
    if lane_kinds:
        match = nearest_lanes(
            scenario.road_map,
            agents.position_m[row, nearest][None],
            heading_rad=agents.heading_rad[row, nearest][None],
            kinds=lane_kinds,
        )
        if match.is_valid[0] and match.distance_m[0] <= ON_LANE_M:
            lines.append(f"lane {match.lane_id[0]}")
    is_known = agent_id in base.agents.row_of
    untouched = untouched_agent_ids(scenario, base)
    marks = [
        word
        for word, holds in (
            ("focal agent", agent_id == scenario.focal_id),
            ("ego", agent_id == EGO_ID),
            ("new", not is_known),
            ("edited", is_known and agent_id not in untouched),
            ("not there at t = 0", not agents.is_valid[row, scenario.current_step]),
        )
        if holds
    ]
    return [*lines, ", ".join(marks)] if marks else lines


def lane_lines(lane: Lane) -> list[str]:
    """Lines of a lane's tooltip: id, kind and lane markings."""
    kind = lane.kind.lower()
    place = " in an intersection" if lane.is_intersection else ""
    left, right = (
        str(mark).lower().replace("_", " ")
        for mark in (lane.left_mark, lane.right_mark)
    )
    return [f"{kind} lane {lane.lane_id}{place}", f"left {left}, right {right}"]
