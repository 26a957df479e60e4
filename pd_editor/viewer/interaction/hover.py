"""What the tooltip says about the agent or the lane under a pointer at rest."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pd_editor.paths.nearest_lane import nearest_lanes
from pd_editor.paths.route_choice import ON_LANE_M, lane_kinds_of
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.interaction.picking import (
    PointerRay,
    agent_under,
    lane_under,
    number_of,
)
from pd_editor.viewer.meshes.agent_poses import AgentPoses
from pd_editor.viewer.overlay.overlay import Overlay
from pd_editor.viewer.state.desk import Desk


class Hover:
    """Answers the page, which asks once each time that the pointer comes to rest."""

    def __init__(
        self, desk: Desk, overlay: Overlay, poses: Callable[[], AgentPoses | None]
    ) -> None:
        """Listen.

        Args:
            desk: the tab's session.
            overlay: the elements over the picture.
            poses: agents as drawn now.
        """
        self._desk = desk
        self._overlay = overlay
        self._poses = poses
        overlay.on("tooltip", self._heard)

    def _heard(self, event: Mapping[str, Any]) -> None:
        """Say what is there; nothing while the picture runs away under the pointer."""
        ray, ask = PointerRay.of_event(event), number_of(event.get("ask"))
        playback = self._desk.workspace.playback
        if ray is None or ask is None or playback.is_playing:
            return
        lines = self._lines(ray)
        if lines:
            self._overlay.show(
                "tooltip",
                {"at": [ray.x_px, ray.y_px], "lines": lines, "asked": int(ask)},
            )

    def _lines(self, ray: PointerRay) -> list[str]:
        session, poses = self._desk.session, self._poses()
        scenario = session.scenario
        if poses is None:
            return []
        row = agent_under(scenario.agents, poses, ray)
        if row is not None:
            step = self._desk.workspace.playback.step
            return agent_lines(scenario, session.base, row, step)
        lane = (
            None
            if ray.ground_m is None
            else lane_under(scenario.road_map, ray.ground_m)
        )
        return [] if lane is None else lane_lines(lane)


def agent_lines(scenario: Scenario, base: Scenario, row: int, step: float) -> list[str]:
    """Name and speed of an agent, its lane, and what is special about it."""
    agents, agent_id = scenario.agents, scenario.agents.ids[row]
    nearest = int(np.clip(np.round(step), 0, agents.num_steps - 1))
    speed = float(np.hypot(*agents.velocity_mps[row, nearest]))
    kind = str(agents.kinds[row]).replace("_", " ")
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
    marks = [
        word
        for word, holds in (
            ("focal agent", agent_id == scenario.focal_id),
            ("ego", agent_id == EGO_ID),
            ("new", agent_id not in base.agents.row_of),
            ("edited", _is_edited(scenario, base, agent_id)),
            ("not there at t = 0", not agents.is_valid[row, scenario.current_step]),
        )
        if holds
    ]
    return [*lines, ", ".join(marks)] if marks else lines


def _is_edited(scenario: Scenario, base: Scenario, agent_id: str) -> bool:
    """Whether an agent of the base moves otherwise than the base and the road say."""
    if agent_id not in base.agents.row_of:
        return False
    warp = scenario.applied_warp
    if warp is None:
        return _differ(scenario.agents, base.agents, agent_id)
    return _differ(scenario.agents, warp.warped_agents, agent_id) or _differ(
        warp.original_agents, base.agents, agent_id
    )


def _differ(one: AgentTracks, other: AgentTracks, agent_id: str) -> bool:
    if agent_id not in one.row_of or agent_id not in other.row_of:
        return True
    here, there = one.row_of[agent_id], other.row_of[agent_id]
    return one.kinds[here] != other.kinds[there] or not all(
        np.array_equal(of_one[here], of_other[there])
        for of_one, of_other in (
            (one.position_m, other.position_m),
            (one.heading_rad, other.heading_rad),
            (one.is_valid, other.is_valid),
            (one.size_m, other.size_m),
        )
    )


def lane_lines(lane: Lane) -> list[str]:
    """Id, kind and paint of a lane."""
    kind = lane.kind.lower()
    place = " in an intersection" if lane.is_intersection else ""
    left, right = (
        str(mark).lower().replace("_", " ")
        for mark in (lane.left_mark, lane.right_mark)
    )
    return [f"{kind} lane {lane.lane_id}{place}", f"left {left}, right {right}"]
