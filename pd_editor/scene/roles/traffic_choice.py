"""Selection of the agents that a generator may replace or drive."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from pd_editor.base.errors import GenerationError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.scenario import EGO_ID, Scenario


def road_user_ids(scenario: Scenario) -> tuple[str, ...]:
    """Ids of all road users, at whatever steps they exist."""
    users = scenario.agents.kind_mask(ROAD_USER_KINDS)
    return tuple(scenario.agents.ids[row] for row in np.flatnonzero(users))


def replaceable_agent_ids(
    scenario: Scenario, *, keeps_ego: bool, keeps_focal: bool
) -> tuple[str, ...]:
    """Ids of the road users that are removed when all are replaced; locked ones stay."""
    kept = ({EGO_ID} if keeps_ego else set()) | (
        {scenario.focal_id} if keeps_focal else set()
    )
    kept |= scenario.locks.keys()
    return tuple(name for name in road_user_ids(scenario) if name not in kept)


def drivable_agent_ids(
    scenario: Scenario, wanted: Iterable[str] | None = None
) -> tuple[str, ...]:
    """Ids of the road users at the current step, among ``wanted`` or all.

    Agents whose trajectory is locked are left out.

    In a scenario without a future, as in the test split, static objects are included:
    they would not exist at later steps otherwise.

    Raises:
        EditError: a wanted id is not in the scenario.
        GenerationError: no agent is left.
    """
    agents = scenario.agents
    step = scenario.current_step
    drives = agents.is_valid[:, step].copy()
    if agents.is_valid[:, step + 1 :].any():
        drives &= agents.kind_mask(ROAD_USER_KINDS)
    rows = np.flatnonzero(drives)
    if wanted is not None:
        chosen = agents.rows(wanted)
        rows = chosen[drives[chosen]]
    locked = trajectory_locked_ids(scenario)
    if locked:
        free = [row for row in rows if agents.ids[row] not in locked]
        if len(rows) and not free:
            raise GenerationError(
                "The trajectories of all these agents are locked, so there is none to "
                "generate; unlock an agent first."
            )
        rows = np.array(free, int)
    if not len(rows):
        raise GenerationError(
            "None of these agents is a road user that is there at t = 0, so there is no "
            "future to generate."
        )
    return tuple(agents.ids[row] for row in rows)


def steered_agent_ids(
    scenario: Scenario, selection: Sequence[str] = ()
) -> tuple[str, ...] | None:
    """Ids of the agents that guidance is about: the selected ones, else the guided ones.

    None stands for all agents: a term in force guides all of them, or there is none.
    """
    if selection:
        return tuple(selection)
    guided = [term.guided_ids for term in scenario.guidance if term.is_on]
    if not all(guided):
        return None
    return tuple(dict.fromkeys(name for ids in guided for name in ids)) or None


def trajectory_locked_ids(scenario: Scenario) -> frozenset[str]:
    """Ids of the agents whose whole trajectory is locked."""
    locks = scenario.locks.items()
    return frozenset(name for name, lock in locks if lock.keeps == "trajectory")


def resamplable_agent_ids(
    scenario: Scenario, agent_ids: Iterable[str]
) -> tuple[str, ...]:
    """Ids of the road users among some agents whose states are not locked.

    Raises:
        GenerationError: all of them are locked, or none is a road user.
    """
    wanted = agent_ids_of_kinds(scenario, agent_ids, ROAD_USER_KINDS)
    free = tuple(name for name in wanted if name not in scenario.locks)
    if not wanted:
        raise GenerationError(
            "None of these agents is a road user, so there is no state to resample."
        )
    if not free:
        raise GenerationError(
            "The states of all these agents are locked, so there is none to resample; "
            "unlock an agent first."
        )
    return free


def agent_ids_of_kinds(
    scenario: Scenario, agent_ids: Iterable[str], kinds: Collection[AgentKind]
) -> tuple[str, ...]:
    """Ids of those agents that are of one of the kinds; no kind means all."""
    agents = scenario.agents
    return tuple(
        name
        for name in agent_ids
        if not kinds or agents.kinds[agents.row_of[name]] in kinds
    )
