"""Commands that change the motion of agents from their current states on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from pd_editor.analysis.findings.friction import slowed_to_limit
from pd_editor.analysis.repair.retimed_trajectories import (
    retime_for_comfort,
    yield_to_others,
)
from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import (
    Command,
    StateCommand,
    agents_in_words,
    names_after,
)
from pd_editor.editor.commands.edit_limits import (
    check_friction,
    check_positions,
    check_speed,
    check_velocities,
    present_rows,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.paths.retiming import with_new_speed, with_speed_at
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS


@dataclass(frozen=True, kw_only=True)
class SetAgentSpeed(StateCommand):
    """Set the current speed of agents; their poses stay.

    The trajectory is retimed along its own curve by ``with_new_speed``, and the past
    likewise backwards in time, so that both have the new speed at the current step;
    beyond their ends curves continue straight. An agent that changes between forwards
    and backwards (negative speed) gets a straight line at that speed instead.
    """

    agent_ids: tuple[str, ...]
    speed_mps: float

    def __post_init__(self) -> None:
        check_speed(self.speed_mps)

    @property
    def label(self) -> str:
        """Label with the speed."""
        return f"Set {agents_in_words(self.agent_ids)} to {self.speed_mps:.1f} m/s{names_after(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with retimed tracks."""
        rows = present_rows(scenario, self.agent_ids)
        now, step_s = scenario.current_step, scenario.time_axis.step_s
        rolls_back = _rolls_back(scenario.agents, now)[rows]
        speed = scenario.agents.speed_mps()[rows, now] * np.where(rolls_back, -1, 1)
        turns = np.where(rolls_back, self.speed_mps > 0, self.speed_mps < 0)
        agents = scenario.agents
        for some, change in (
            (rows[~turns & (speed != self.speed_mps)], _retimed),
            (rows[turns], _straight),
        ):
            if len(some):
                arrays = change(agents.taken(some), now, self.speed_mps, step_s)
                agents = agents.with_rows(some, **arrays)
        return scenario if agents is scenario.agents else scenario.with_agents(agents)


@dataclass(frozen=True, kw_only=True)
class PullSpeed(Command):
    """Set the speed of an agent at a later time; it drives the same curve, retimed.

    Speeds about that time change smoothly by ``with_speed_at``; the current state stays.
    """

    agent_id: str
    time_s: float
    """After the current step."""
    speed_mps: float

    def __post_init__(self) -> None:
        check_speed(self.speed_mps)
        if self.speed_mps < 0:
            raise EditError(
                f"A pulled speed is {self.speed_mps:g} m/s; expected 0 or more."
            )

    @property
    def label(self) -> str:
        """Label with the speed and the time."""
        who = agents_in_words((self.agent_id,))
        return f"Pull {who} to {self.speed_mps:.1f} m/s at {self.time_s:.1f} s"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the retimed agent."""
        rows = present_rows(scenario, (self.agent_id,))
        axis, agents, now = scenario.time_axis, scenario.agents, scenario.current_step
        if not 0 < self.time_s < axis.num_steps * axis.step_s:
            raise EditError(
                f"A speed is pulled at {self.time_s:g} s; expected a time after t = 0, at"
                f" most {axis.future_s:g} s."
            )
        step = max(round(self.time_s / axis.step_s), 1)
        if now + step >= axis.num_steps or not agents.is_valid[rows[0], now + step]:
            raise EditError(
                f"Agent {self.agent_id} is not there at {self.time_s:g} s; expected a"
                " time at which it is."
            )
        if agents.speed_mps()[rows[0], now + step] == self.speed_mps:
            return scenario
        position, heading, velocity = with_speed_at(
            agents.position_m[rows, now:],
            agents.heading_rad[rows, now:],
            agents.velocity_mps[rows, now:],
            agents.is_valid[rows, now:],
            step,
            self.speed_mps,
            axis.step_s,
        )
        later = position[:, 1:], heading[:, 1:], velocity[:, 1:]
        return scenario.with_agents(agents.with_motion(rows, now + 1, later))


@dataclass(frozen=True, kw_only=True)
class SlowToFrictionLimit(Command):
    """Retime agents along their own trajectories to the friction limit of curves."""

    agent_ids: tuple[str, ...]
    friction_coefficient: float = DRY_ROAD_FRICTION

    def __post_init__(self) -> None:
        check_friction(self.friction_coefficient)

    @property
    def label(self) -> str:
        """Label with the name or number of the agents, and the coefficient."""
        return (
            f"Slow {agents_in_words(self.agent_ids)} to the friction limit"
            f" (mu {self.friction_coefficient:g})"
        )

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with slower agents; the same one if none is too fast."""
        agents = slowed_to_limit(scenario, self.agent_ids, self.friction_coefficient)
        return scenario if agents is scenario.agents else scenario.with_agents(agents)


@dataclass(frozen=True, kw_only=True)
class SlowToComfort(Command):
    """Retime agents with harsh motion along their own trajectories within limits.

    Agents whose motion is comfortable, or would stay harsh, do not change; others of
    the given agents may yield to a slowed one.
    """

    agent_ids: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label with the name or number of the agents."""
        return f"Smooth the motion of {agents_in_words(self.agent_ids)}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with comfortable agents; the same one if no agent changes."""
        return retime_for_comfort(scenario, self.agent_ids)


@dataclass(frozen=True, kw_only=True)
class YieldToOthers(Command):
    """Let agents yield to those that they would collide with; others do not change."""

    agent_ids: tuple[str, ...]

    @property
    def label(self) -> str:
        """Label with the name or number of the agents."""
        return f"Let {agents_in_words(self.agent_ids)} yield"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with later agents; the same one if no agent yields."""
        after, names = yield_to_others(scenario, self.agent_ids)
        return after if names else scenario


@dataclass(frozen=True, kw_only=True, eq=False)
class AdoptTrajectory(Command):
    """Set the trajectory of an agent from its current state on.

    Arrays hold S states: the current one and all later ones. The current state does not
    change; the later ones are replaced.
    """

    agent_id: str
    position_m: Float32[np.ndarray, "S 2"]
    heading_rad: Float32[np.ndarray, "S"]
    velocity_mps: Float32[np.ndarray, "S 2"]

    def __post_init__(self) -> None:
        lengths = {len(self.position_m), len(self.heading_rad), len(self.velocity_mps)}
        if len(lengths) != 1:
            raise EditError("A trajectory's arrays must have the same number of steps.")
        check_positions(self.position_m)
        if not np.isfinite(self.heading_rad).all():
            raise EditError("A trajectory's heading holds NaN or infinity.")
        check_velocities(self.velocity_mps)

    @classmethod
    def of_arrays(
        cls,
        *,
        agent_id: str,
        position_m: Float[np.ndarray, "S 2"],
        heading_rad: Float[np.ndarray, "S"],
        velocity_mps: Float[np.ndarray, "S 2"],
    ) -> "AdoptTrajectory":
        """Make the command from arrays of any precision, converted to float32."""
        return cls(
            agent_id=agent_id,
            position_m=position_m.astype(np.float32),
            heading_rad=heading_rad.astype(np.float32),
            velocity_mps=velocity_mps.astype(np.float32),
        )

    @property
    def label(self) -> str:
        """Label with the length and the final speed."""
        steps = np.diff(self.position_m.astype(float), axis=0)
        length = float(np.hypot(*steps.T).sum())
        end = float(np.hypot(*self.velocity_mps[-1])) if len(self.velocity_mps) else 0.0
        return (
            f"Use a trajectory for {agents_in_words((self.agent_id,))}:"
            f" {length:.0f} m, {end:.1f} m/s at its end"
        )

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the new trajectory."""
        rows = present_rows(scenario, (self.agent_id,))
        agents, now = scenario.agents, scenario.current_step
        expected = scenario.time_axis.num_future_steps + 1
        if len(self.position_m) != expected:
            raise EditError(
                f"The trajectory has {len(self.position_m)} steps; this scenario needs"
                f" {expected}, the current one and all later ones."
            )
        gap = float(np.hypot(*(self.position_m[0] - agents.position_m[rows[0], now])))
        # Largest distance between an agent and the start of an adopted trajectory.
        if gap > 1.0:
            raise EditError(
                f"The trajectory starts {gap:.1f} m away from agent {self.agent_id};"
                " it was made for another state."
            )
        motion = self.position_m, wrap_angle(self.heading_rad), self.velocity_mps
        position, heading, velocity = (one[None, 1:] for one in motion)
        is_there = np.ones(heading.shape, bool)
        return scenario.with_agents(
            agents.with_motion(rows, now + 1, (position, heading, velocity), is_there)
        )


def _rolls_back(agents: AgentTracks, now: int) -> np.ndarray:
    """Whether each agent moves against its heading."""
    ahead = unit_vector(agents.heading_rad[:, now])
    return (agents.velocity_mps[:, now] * ahead).sum(-1) < -MOVING_MPS


def _retimed(
    some: AgentTracks, now: int, speed_mps: float, step_s: float
) -> dict[str, np.ndarray]:
    """Tracks whose past and future are retimed along their curves."""
    position, heading = some.position_m.copy(), some.heading_rad.copy()
    velocity = some.velocity_mps.copy()
    speed = np.full(len(some), abs(float(speed_mps)))
    future = np.arange(now, some.num_steps)
    # The past, reversed in time, is a trajectory in the opposite direction.
    for steps, sign, turn in ((np.arange(now, -1, -1), -1, np.pi), (future, 1, 0.0)):
        is_valid = some.is_valid[:, steps]
        moved, headed, driven = with_new_speed(
            some.position_m[:, steps],
            some.heading_rad[:, steps] + turn,
            sign * some.velocity_mps[:, steps],
            is_valid,
            speed,
            step_s,
        )
        position[:, steps] = moved
        heading[:, steps] = np.where(is_valid, wrap_angle(headed - turn), 0.0)
        velocity[:, steps] = sign * driven
    position[:, now] = some.position_m[:, now]
    heading[:, now] = some.heading_rad[:, now]
    return {"position_m": position, "heading_rad": heading, "velocity_mps": velocity}


def _straight(
    some: AgentTracks, now: int, speed_mps: float, step_s: float
) -> dict[str, np.ndarray]:
    """Tracks at constant velocity along the current heading."""
    heading = some.heading_rad[:, [now]]
    velocity = speed_mps * unit_vector(heading)
    time = (np.arange(some.num_steps) - now) * step_s
    position = some.position_m[:, [now]] + time[:, None] * velocity
    valid = some.is_valid
    return {
        "position_m": np.where(valid[..., None], position, 0.0),
        "heading_rad": np.where(valid, heading, 0.0),
        "velocity_mps": np.where(valid[..., None], velocity, 0.0),
    }
