"""Commands that place agents, and change where they are."""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.analysis.repair.back_casting import made_up_past, with_past
from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import StateCommand, agents_in_words, names_after
from pd_editor.editor.commands.edit_limits import (
    check_angle,
    check_new_id,
    check_number_of_agents,
    check_position,
    check_positions,
    check_size,
    check_speed,
    present_rows,
)
from pd_editor.scene.agent_kind import AgentCategory, AgentKind, default_sizes_m
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import turned, unit_vector, wrap_angle
from pd_editor.scene.paths.lanes.nearest_lane import DRIVING_LANES, nearest_lanes
from pd_editor.scene.paths.lanes.route_choice import lane_kinds_of
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.roles.focal_agent import with_focal_agent
from pd_editor.scene.scenario import Scenario

MAX_SNAP_M: Final = 15.0
"""Largest distance between an agent and the centre line that it is snapped to."""


class PoseCommand(StateCommand):
    """A command that carries whole tracks with their current poses."""


@dataclass(frozen=True, kw_only=True)
class TransformAgents(PoseCommand):
    """Rotate agents about their common centre at the current step, then shift them."""

    agent_ids: tuple[str, ...]
    dx_m: float = 0.0
    dy_m: float = 0.0
    rotation_rad: float = 0.0

    def __post_init__(self) -> None:
        check_angle("Rotation", self.rotation_rad)
        check_position(self.dx_m, self.dy_m)

    @property
    def label(self) -> str:
        """Label with distance and angle."""
        agents, names = agents_in_words(self.agent_ids), names_after(self.agent_ids)
        distance = math.hypot(self.dx_m, self.dy_m)
        turn = f"{math.degrees(self.rotation_rad):+.0f}°"
        if not self.rotation_rad:
            return f"Move {agents} by {distance:.1f} m{names}"
        if not distance:
            return f"Turn {agents} by {turn}{names}"
        return f"Move {agents} by {distance:.1f} m, turn by {turn}{names}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with whole tracks moved."""
        rows = present_rows(scenario, self.agent_ids)
        if not (self.dx_m or self.dy_m or self.rotation_rad):
            return scenario
        now = scenario.agents.position_m[rows, scenario.current_step]
        centre = now.mean(axis=0)
        shift = np.array([self.dx_m, self.dy_m])
        offset = turned(now - centre, self.rotation_rad)
        target = now + shift
        if self.rotation_rad:
            target = centre + offset + shift
        turn = np.full(len(rows), self.rotation_rad)
        return _carried(scenario, rows, target, turn)


@dataclass(frozen=True, kw_only=True)
class SetAgentPosition(PoseCommand):
    """Shift an agent so that it is at a point at the current step."""

    agent_id: str
    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        check_position(self.x_m, self.y_m)

    @property
    def label(self) -> str:
        """Label with the position."""
        agent = agents_in_words((self.agent_id,))
        return f"Move {agent} to ({self.x_m:.1f}, {self.y_m:.1f}) m"

    def label_after(self, before: Scenario) -> str:
        """Label with the distance."""
        row = before.agents.row_of[self.agent_id]
        x, y = before.agents.position_m[row, before.current_step]
        distance = math.hypot(self.x_m - x, self.y_m - y)
        return f"Move {agents_in_words((self.agent_id,))} by {distance:.1f} m"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the whole track shifted."""
        rows = present_rows(scenario, (self.agent_id,))
        target = np.array([[self.x_m, self.y_m]], float)
        return _carried(scenario, rows, target, np.zeros(1))


@dataclass(frozen=True, kw_only=True)
class SetAgentHeading(PoseCommand):
    """Rotate each agent about itself so that it has a heading at the current step."""

    agent_ids: tuple[str, ...]
    heading_rad: float

    def __post_init__(self) -> None:
        check_angle("Heading", self.heading_rad)

    @property
    def label(self) -> str:
        """Label with the heading in degrees."""
        degrees = math.degrees(self.heading_rad)
        return f"Turn {agents_in_words(self.agent_ids)} to {degrees:.0f}°{names_after(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with whole tracks rotated."""
        rows = present_rows(scenario, self.agent_ids)
        now = scenario.current_step
        turn = self.heading_rad - scenario.agents.heading_rad[rows, now]
        target = scenario.agents.position_m[rows, now]
        return _carried(scenario, rows, target, turn)


@dataclass(frozen=True, kw_only=True)
class SnapToLane(PoseCommand):
    """Snap agents to the nearest centre line, heading along the lane."""

    agent_ids: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label with the name or number of the agents."""
        return f"Snap {agents_in_words(self.agent_ids)} to lane{names_after(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with whole tracks moved to lanes."""
        rows = present_rows(scenario, self.agent_ids)
        agents, now = scenario.agents, scenario.current_step
        position, heading = agents.position_m[rows, now], agents.heading_rad[rows, now]
        target, lane_heading = np.empty_like(position), np.empty_like(heading)
        lanes_of = [lane_kinds_of(agents.kinds[row]) or DRIVING_LANES for row in rows]
        for kinds in set(lanes_of):
            some = np.array([lanes == kinds for lanes in lanes_of])
            match = nearest_lanes(
                scenario.road_map,
                position[some],
                heading_rad=heading[some],
                kinds=kinds,
            )
            far = ~match.is_valid | (match.distance_m > MAX_SNAP_M)
            if far.any():
                name = agents.ids[rows[some][far][0]]
                raise EditError(
                    f"Agent {name} has no lane within {MAX_SNAP_M:g} m to snap to."
                )
            normal = np.stack(
                [-np.sin(match.heading_rad), np.cos(match.heading_rad)], axis=-1
            )
            target[some] = position[some] - match.offset_m[:, None] * normal
            lane_heading[some] = match.heading_rad
        return _carried(scenario, rows, target, lane_heading - heading)


def _carried(
    scenario: Scenario,
    rows: Int[np.ndarray, "G"],
    target_m: Float[np.ndarray, "G 2"],
    turn_rad: Float[np.ndarray, "G"],
) -> Scenario:
    """Move whole tracks rigidly so that the current positions become ``target_m``."""
    check_positions(target_m)
    agents, now = scenario.agents, scenario.current_step
    if (agents.position_m[rows, now] == target_m).all() and not turn_rad.any():
        return scenario
    return scenario.with_agents(agents.carried(rows, now, target_m, turn_rad))


@dataclass(frozen=True, kw_only=True)
class PlaceAgent(StateCommand):
    """Add an agent with a current state, a trajectory at its speed, and a past.

    The trajectory follows the agent's lane, else it goes straight ahead; an agent that
    rolls backwards goes straight. With ``back_cast`` it gets a made-up past along the
    lane, which provenance records.
    """

    agent_id: str
    kind: AgentKind
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    back_cast: bool = True
    size_m: tuple[float, float] | None = field(
        default=None, metadata={"omit_none": True}
    )
    """Length and width; None: the default of the kind."""

    def __post_init__(self) -> None:
        check_position(self.x_m, self.y_m)
        check_angle("Heading", self.heading_rad)
        check_speed(self.speed_mps)
        if self.size_m is not None:
            check_size(*self.size_m)

    @property
    def label(self) -> str:
        """Label with the kind."""
        return f"Place a {self.kind.value.replace('_', ' ')} ({self.agent_id})"

    @property
    def selects(self) -> tuple[str, ...]:
        """Select the new agent."""
        return (self.agent_id,)

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the agent appended."""
        check_new_id(scenario, self.agent_id)
        check_number_of_agents(len(scenario.agents) + 1)
        placed = self._track(scenario)
        joined = scenario.with_agents(
            scenario.agents.joined(placed),
            f"The past of agent {self.agent_id} was made up."
            if self.back_cast
            else None,
        )
        row = len(joined.agents) - 1
        if self.speed_mps >= 0:
            joined = _on_its_lane(joined, row)
        if self.back_cast and joined.current_step:
            rows, now = np.array([row]), joined.current_step
            past = made_up_past(joined, rows, seed=0)
            joined = joined.with_agents(with_past(joined.agents, rows, now, past))
        return with_focal_agent(joined)

    def _track(self, scenario: Scenario) -> AgentTracks:
        """Straight track of the agent from the current step on."""
        axis = scenario.time_axis
        times = axis.times_s()
        state = np.array([self.x_m, self.y_m], float)
        heading = wrap_angle(np.full(len(times), self.heading_rad))
        velocity = self.speed_mps * unit_vector(heading)
        position = state + times[:, None] * velocity
        is_valid = times >= 0
        return AgentTracks(
            ids=(self.agent_id,),
            kinds=(self.kind,),
            categories=(AgentCategory.UNSCORED,),
            size_m=default_sizes_m((self.kind,))
            if self.size_m is None
            else np.array([self.size_m]),
            has_known_size=np.array([self.size_m is not None]),
            position_m=np.where(is_valid[:, None], position, 0.0)[None],
            heading_rad=np.where(is_valid, wrap_angle(heading), 0.0)[None],
            velocity_mps=np.where(is_valid[:, None], velocity, 0.0)[None],
            is_valid=is_valid[None],
            observed=(axis.is_past & is_valid)[None],
        )


def _on_its_lane(scenario: Scenario, row: int) -> Scenario:
    """Let an agent drive along its lane at its own speed."""
    axis = scenario.time_axis
    if axis.num_future_steps < 1:
        return scenario
    rows = np.array([row])
    found = candidates(scenario, rows)
    if not (found.has_lane[0] and found.is_valid[0, 0]):
        return scenario
    # The first candidate keeps the agent's own speed on the most natural route.
    heading = wrap_angle(found.heading_rad[:, 0, 1:])
    motion = found.position_m[:, 0, 1:], heading, found.velocity_mps[:, 0, 1:]
    is_there = np.ones(heading.shape, bool)
    return scenario.with_agents(
        scenario.agents.with_motion(rows, axis.current_step + 1, motion, is_there)
    )
