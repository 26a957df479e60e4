"""Input of metrics: trajectories of the evaluated agents, and the scene around them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int

from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_states import AgentStates
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_sample import TrafficSample


@dataclass(frozen=True, kw_only=True, eq=False)
class TrafficView:
    """A evaluated agents of one scene at H steps, the current one first.

    Results of metrics have one row per evaluated agent, in this order.
    """

    scenario: Scenario
    """Road, time axis and, where there is one, the recorded future."""
    agents: AgentStates
    context: AgentStates
    """Other road users, those at the current step unless stated; agents can collide with
    them."""
    logged: AgentStates
    """Recorded trajectories of the evaluated agents; not valid without a recording."""

    def __post_init__(self) -> None:
        assert self.logged.ids == self.agents.ids
        assert self.agents.is_valid.shape == self.logged.is_valid.shape

    def __len__(self) -> int:
        return len(self.agents)

    @property
    def num_steps(self) -> int:
        """Number of steps H, the current one included."""
        return self.agents.num_steps

    @property
    def step_s(self) -> float:
        """Time between two steps."""
        return self.scenario.time_axis.step_s

    @cached_property
    def everyone(self) -> AgentStates:
        """The evaluated agents, then the context agents."""
        return self.agents.joined(self.context)


def recorded_traffic(
    scenario: Scenario, agent_ids: Iterable[str] | None = None
) -> TrafficView:
    """View of a scenario's own trajectories.

    ``agent_ids`` are evaluated; None means all road users at the current step.

    Raises:
        EditError: an id is not in the scenario.
    """
    present = _road_users(scenario)
    wanted = present if agent_ids is None else scenario.agents.rows(agent_ids)
    num_steps = scenario.time_axis.num_steps - scenario.current_step
    states = _states(scenario, wanted, num_steps)
    return TrafficView(
        scenario=scenario,
        agents=states,
        context=_states(scenario, np.setdiff1d(present, wanted), num_steps),
        logged=states,
    )


def generated_traffic(
    scenario: Scenario, sample: TrafficSample, *, with_later: bool = False
) -> TrafficView:
    """View of a sample's trajectories among the scenario's other agents.

    In a scenario without a future, other agents exist at the current step only.
    ``with_later`` adds road users that appear after the current step.
    """
    num_agents, num_steps = sample.heading_rad.shape
    row_of = scenario.agents.row_of
    rows = np.array([row_of.get(agent_id, -1) for agent_id in sample.ids], int)
    return TrafficView(
        scenario=scenario,
        agents=AgentStates(
            ids=sample.ids,
            kinds=sample.kinds,
            size_m=sample.size_m,
            position_m=sample.position_m,
            heading_rad=sample.heading_rad,
            velocity_mps=sample.velocity_mps,
            is_valid=np.ones((num_agents, num_steps), bool),
        ),
        context=_states(
            scenario,
            np.setdiff1d(_road_users(scenario, with_later=with_later), rows),
            num_steps,
        ),
        logged=_logged(scenario, sample, rows, num_steps),
    )


def _road_users(
    scenario: Scenario, *, with_later: bool = False
) -> Int[np.ndarray, "A"]:
    """Rows of the road users that exist at the current step, or also of later ones."""
    agents, now = scenario.agents, scenario.current_step
    end = scenario.time_axis.num_steps if with_later else now + 1
    present = agents.is_valid[:, now:end].any(axis=1)
    return np.flatnonzero(present & agents.kind_mask(ROAD_USER_KINDS))


def _states(
    scenario: Scenario, rows: Int[np.ndarray, "A"], num_steps: int
) -> AgentStates:
    """Agents from the current step on, cut or padded to a number of steps."""
    agents, step = scenario.agents, scenario.current_step

    def window(values: np.ndarray) -> np.ndarray:
        part = values[rows, step : step + num_steps]
        # Much faster than np.pad, and this is called for every sample.
        whole = np.zeros((len(part), num_steps, *part.shape[2:]), part.dtype)
        whole[:, : part.shape[1]] = part
        return whole

    return AgentStates(
        ids=tuple(agents.ids[row] for row in rows),
        kinds=tuple(agents.kinds[row] for row in rows),
        size_m=agents.size_m[rows],
        position_m=window(agents.position_m),
        heading_rad=window(agents.heading_rad),
        velocity_mps=window(agents.velocity_mps),
        is_valid=window(agents.is_valid),
    )


def _logged(
    scenario: Scenario,
    sample: TrafficSample,
    rows: Int[np.ndarray, "G"],
    num_steps: int,
) -> AgentStates:
    """Recorded trajectories of a sample's agents; not valid for new agents."""
    num_agents = len(rows)
    is_known = rows >= 0
    known = _states(scenario, rows[is_known], num_steps)

    def filled(values: np.ndarray) -> np.ndarray:
        whole = np.zeros((num_agents, *values.shape[1:]), values.dtype)
        whole[is_known] = values
        return whole

    return AgentStates(
        ids=sample.ids,
        kinds=sample.kinds,
        size_m=sample.size_m,
        position_m=filled(known.position_m),
        heading_rad=filled(known.heading_rad),
        velocity_mps=filled(known.velocity_mps),
        is_valid=filled(known.is_valid),
    )
