"""Which agents of a scenario a generator may drive."""

from collections.abc import Iterable

import numpy as np

from pd_editor.errors import GenerationError
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.scenario import Scenario


def drivable_agent_ids(
    scenario: Scenario, wanted: Iterable[str] | None = None
) -> tuple[str, ...]:
    """Road users that exist at the current step, among ``wanted`` or all.

    Raises:
        EditError: a wanted id is not in the scenario.
        GenerationError: nobody is left.
    """
    agents = scenario.agents
    drives = agents.is_valid[:, scenario.current_step] & agents.kind_mask(
        ROAD_USER_KINDS
    )
    rows = np.flatnonzero(drives)
    if wanted is not None:
        chosen = agents.rows(wanted)
        rows = chosen[drives[chosen]]
    if not len(rows):
        raise GenerationError(
            "No road user to drive: choose agents that are there at the current step."
        )
    return tuple(agents.ids[row] for row in rows)
