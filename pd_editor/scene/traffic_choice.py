"""Selection of the agents that a generator may replace or drive."""

from collections.abc import Iterable

import numpy as np

from pd_editor.errors import GenerationError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.scenario import EGO_ID, Scenario


def road_user_ids(scenario: Scenario) -> tuple[str, ...]:
    """Ids of all road users, at whatever steps they exist."""
    users = scenario.agents.kind_mask(ROAD_USER_KINDS)
    return tuple(scenario.agents.ids[row] for row in np.flatnonzero(users))


def replaceable_agent_ids(
    scenario: Scenario, *, keeps_ego: bool, keeps_focal: bool
) -> tuple[str, ...]:
    """Ids of the road users that are removed when all are replaced."""
    kept = ({EGO_ID} if keeps_ego else set()) | (
        {scenario.focal_id} if keeps_focal else set()
    )
    return tuple(name for name in road_user_ids(scenario) if name not in kept)


def drivable_agent_ids(
    scenario: Scenario, wanted: Iterable[str] | None = None
) -> tuple[str, ...]:
    """Ids of the road users at the current step, among ``wanted`` or all.

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
    if not len(rows):
        raise GenerationError(
            "None of these agents is a road user that is there at t = 0, so there is no "
            "future to generate."
        )
    return tuple(agents.ids[row] for row in rows)
