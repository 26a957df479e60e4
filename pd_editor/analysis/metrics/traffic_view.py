"""Input of metrics: trajectories of the evaluated agents, and the scene around them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Int

from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_states import STEPPED, AgentStates
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import SAME_STATE_M
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
    if agent_ids is None:
        return _all_recorded(scenario)
    return _recorded(scenario, scenario.agents.rows(agent_ids))


@lru_cache(maxsize=2)
def _all_recorded(scenario: Scenario) -> TrafficView:
    """One view of the newest scenes, by which what is measured on it is kept, too."""
    return _recorded(scenario, _road_users(scenario))


def _recorded(scenario: Scenario, wanted: Int[np.ndarray, "A"]) -> TrafficView:
    present = _road_users(scenario)
    num_steps = scenario.time_axis.num_steps - scenario.current_step
    states = _states(scenario, wanted, num_steps)
    return TrafficView(
        scenario=scenario,
        agents=states,
        context=_states(scenario, np.setdiff1d(present, wanted), num_steps),
        logged=states,
    )


def generated_traffic(scenario: Scenario, sample: TrafficSample) -> TrafficView:
    """View of a sample's trajectories among the scenario's other agents.

    In a scenario without a future, other agents exist at the current step only.
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
            np.setdiff1d(_road_users(scenario), rows),
            num_steps,
        ),
        logged=_logged(scenario, sample, rows, num_steps),
    )


def traffic_with_made_up_past(
    scenario: Scenario,
) -> tuple[TrafficView, Int[np.ndarray, "A"]]:
    """Road users whose past is made up, each from the step on at which it enters.

    Returns:
        the view, whose rows start at different steps, and those steps.
    """
    rows, count = _road_users(scenario), scenario.time_axis.num_steps
    rows = rows[scenario.agents.has_made_up_past[rows]]
    first = scenario.agents.is_valid[rows].argmax(axis=1)
    # After the end of the track come the steps before the agent entered.
    at = np.arange(len(rows))[:, None], (first[:, None] + np.arange(count)) % count
    states = _states(scenario, rows, count, since=0)
    states = replace(states, **{name: getattr(states, name)[at] for name in STEPPED})
    none = _states(scenario, rows[:0], count)
    view = TrafficView(scenario=scenario, agents=states, context=none, logged=states)
    return view, first


def whole_traffic(scenario: Scenario, sample: TrafficSample) -> AgentStates:
    """All agents at all steps, with a sample in the place of what is recorded of it.

    The past stays only where the sample goes on from it; the sample's agents are first.
    """
    now, num_steps = scenario.current_step, sample.heading_rad.shape[1]
    view, before = generated_traffic(scenario, sample), scenario.agents
    rows = [row for row, name in enumerate(before.ids) if name not in set(sample.ids)]
    others = _states(scenario, np.array(rows, int), now + num_steps, since=0)
    states = {name: getattr(view.agents, name) for name in STEPPED}
    for name in STEPPED:
        shape = (len(sample.ids), now, *states[name].shape[2:])
        states[name] = np.concatenate(
            [np.zeros(shape, states[name].dtype), states[name]], axis=1
        )
    for row, name in enumerate(sample.ids):
        theirs = before.row_of.get(name)
        if theirs is None or not before.is_valid[theirs, now]:
            continue
        jump = before.position_m[theirs, now] - sample.position_m[row, 0]
        if np.hypot(*jump) <= SAME_STATE_M:
            for field in STEPPED:
                states[field][row, :now] = getattr(before, field)[theirs, :now]
    return replace(view.agents, **states).joined(others)


def _road_users(scenario: Scenario) -> Int[np.ndarray, "A"]:
    """Rows of the road users that exist at the current step."""
    agents, now = scenario.agents, scenario.current_step
    return np.flatnonzero(agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS))


def _states(
    scenario: Scenario,
    rows: Int[np.ndarray, "A"],
    num_steps: int,
    since: int | None = None,
) -> AgentStates:
    """Agents from the current step on, or another, cut or padded to a number of steps."""
    agents = scenario.agents
    step = scenario.current_step if since is None else since

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
        **{name: window(getattr(agents, name)) for name in STEPPED},
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
        **{name: filled(getattr(known, name)) for name in STEPPED},
    )
