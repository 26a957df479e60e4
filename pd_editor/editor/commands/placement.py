"""Command that places a new agent."""

from dataclasses import dataclass, field

import numpy as np

from pd_editor.analysis.repair.back_casting import made_up_past, with_past
from pd_editor.editor.commands.command import StateCommand
from pd_editor.editor.commands.edit_limits import (
    check_angle,
    check_new_id,
    check_number_of_agents,
    check_position,
    check_size,
    check_speed,
)
from pd_editor.scene.agent_kind import AgentCategory, AgentKind, default_sizes_m
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.roles.focal_agent import with_focal_agent
from pd_editor.scene.scenario import Scenario


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
