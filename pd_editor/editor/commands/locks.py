"""Command that locks agents, and the check that edits keep what is locked."""

from dataclasses import dataclass, replace

import numpy as np

from pd_editor.base.errors import LockedAgentError
from pd_editor.editor.commands.command import Command, agents_in_words, names_after
from pd_editor.editor.commands.edit_limits import (
    check_opens_again,
    present_rows,
    rows_of,
)
from pd_editor.scene.agent_states import STEPPED
from pd_editor.scene.locks import Lock
from pd_editor.scene.scenario import Scenario

_STATE = ("size_m", "activity")


@dataclass(frozen=True, kw_only=True)
class SetLocks(Command):
    """Lock agents, or unlock them; replaces earlier locks of these agents."""

    agent_ids: tuple[str, ...]
    lock: Lock | None
    """What is kept of each agent; None unlocks."""

    @property
    def label(self) -> str:
        """Label with what is kept and the name or number of the agents."""
        agents, names = agents_in_words(self.agent_ids), names_after(self.agent_ids)
        if self.lock is None:
            return f"Unlock {agents}{names}"
        return f"Lock the {self.lock.in_words} of {agents}{names}"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with other locks.

        Raises:
            EditError: an agent is not in the scenario, or has no state to lock.
        """
        ids = tuple(dict.fromkeys(self.agent_ids))
        lock = self.lock
        if lock is None or lock.keeps == "trajectory":
            rows_of(scenario, ids)
        else:
            present_rows(scenario, ids)
        locks = {name: one for name, one in scenario.locks.items() if name not in ids}
        if lock is not None:
            locks |= dict.fromkeys(ids, lock)
        if locks == scenario.locks:
            return scenario
        return replace(scenario, locks=locks)


def apply_within_locks(command: Command, scenario: Scenario) -> Scenario:
    """Apply a command that may not change what locks keep.

    A command that moves the road moves locked agents with it, and agents that it deletes
    lose their locks. Each part of a command is checked on its own.

    Raises:
        LockedAgentError: the command would change what is kept of a locked agent.
        EditError: the edit is not valid for this scenario.
    """
    if len(command.parts) > 1:
        for part in command.parts:
            scenario = apply_within_locks(part, scenario)
        return scenario
    after = command.apply(scenario)
    check_opens_again(scenario, after)
    if after.agents is scenario.agents or command.is_beyond_locks or not scenario.locks:
        return after
    changed = _changed_locked_ids(scenario, after)
    if changed:
        raise locked_agents_error(scenario, changed)
    return after


def locked_agents_error(
    scenario: Scenario, agent_ids: tuple[str, ...]
) -> LockedAgentError:
    """The error of an edit that would change these locked agents."""
    first = agent_ids[0]
    kept = scenario.locks[first].in_words
    if len(agent_ids) == 1:
        text = f"The {kept} of agent {first} is locked; unlock the agent first."
    else:
        text = (
            f"{len(agent_ids)} of these agents are locked (the {kept} of agent {first},"
            " for example); unlock them first."
        )
    return LockedAgentError(text, agent_ids)


def _changed_locked_ids(before: Scenario, after: Scenario) -> tuple[str, ...]:
    """Ids of the locked agents of which something that is kept differs."""
    old, new = before.agents, after.agents
    ids = tuple(name for name in before.locks if name in new.row_of)
    if not ids:
        return ()
    rows, others = old.rows(ids), new.rows(ids)
    # A roll-out makes tracks longer.
    count = min(old.num_steps, new.num_steps)
    is_kept = before.kept_steps()[rows, :count]
    differs = np.array(
        [old.kinds[a] != new.kinds[b] for a, b in zip(rows, others, strict=True)], bool
    )
    for name in _STATE:
        one, other = getattr(old, name), getattr(new, name)
        if one is not other:
            unequal = one[rows] != other[others]
            differs |= unequal.reshape(len(ids), -1).any(axis=1)
    for name in STEPPED:
        one, other = getattr(old, name), getattr(new, name)
        if one is not other:
            unequal = one[rows, :count] != other[others, :count]
            unequal = unequal.reshape(*is_kept.shape, -1).any(axis=-1)
            differs |= (unequal & is_kept).any(axis=1)
    return tuple(name for name, one in zip(ids, differs, strict=True) if one)
