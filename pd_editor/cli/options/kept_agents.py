"""Options of the shell for what a generation keeps: locks, kinds and a region."""

import math
from collections.abc import Collection, Sequence

from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import SetLocks
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.generation import Region
from pd_editor.scene.locks import MAX_KEPT_S, STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import agent_ids_of_kinds, drivable_agent_ids
from pd_editor.scene.scenario import Scenario

_LOCKS = {"state": STATE_LOCK, "trajectory": TRAJECTORY_LOCK}


def lock_commands(texts: Sequence[str]) -> tuple[SetLocks, ...]:
    """The edits that lock agents; each text is ID=WHAT.

    Raises:
        GenerationError: WHAT is neither state, trajectory nor a number of seconds.
    """
    agent_ids: dict[Lock, list[str]] = {}
    for text in texts:
        agent_id, equals, what = text.rpartition("=")
        lock = _LOCKS.get(what) or _beginning(what)
        if not agent_id or not equals or lock is None:
            raise GenerationError(
                f"--lock: {text!r} is not ID=WHAT with state, trajectory, or the kept "
                f"seconds up to {MAX_KEPT_S:g}, such as AV=2.5."
            )
        agent_ids.setdefault(lock, []).append(agent_id)
    return tuple(
        SetLocks(agent_ids=tuple(ids), lock=lock) for lock, ids in agent_ids.items()
    )


def _beginning(text: str) -> Lock | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    if not (math.isfinite(seconds) and 0 < seconds <= MAX_KEPT_S):
        return None
    return Lock(kept_s=seconds)


def wanted_kinds(names: Sequence[str]) -> frozenset[AgentKind]:
    """Kinds by their names.

    Raises:
        GenerationError: a name is not that of a kind of road user.
    """
    known = {str(kind): kind for kind in ROAD_USER_KINDS}
    for name in names:
        if name not in known:
            raise GenerationError(
                f"--only-kinds: {name!r} is not a kind out of "
                f"{', '.join(sorted(known))}."
            )
    return frozenset(known[name] for name in names)


def agents_within(
    scenario: Scenario,
    agent_ids: Sequence[str],
    kinds: Collection[AgentKind],
    region: Region | None,
) -> tuple[str, ...]:
    """Ids of those agents that are of some kinds and in a region; none of both: all."""
    found = agent_ids_of_kinds(scenario, agent_ids, kinds)
    return found if region is None else region.held(scenario, found)


def driven_agents(
    scenario: Scenario,
    wanted: Sequence[str],
    kinds: Collection[AgentKind],
    region: Region | None,
) -> tuple[str, ...]:
    """Ids of the agents whose trajectories are generated, of those wanted or of all.

    Raises:
        GenerationError: there is no such agent.
    """
    agent_ids = drivable_agent_ids(scenario, wanted or None)
    found = agents_within(scenario, agent_ids, kinds, region)
    if not found:
        names = ", ".join(sorted(str(kind) for kind in kinds))
        which = f" of the kinds {names}" if names else ""
        where = " in the region" if region is not None else ""
        raise GenerationError(
            f"None of the {len(agent_ids)} agents that could be generated is{which}"
            f"{where}; expected at least one."
        )
    return found


def kept_remarks(
    scenario: Scenario, wanted: Sequence[str], driven: Sequence[str]
) -> tuple[str, ...]:
    """Remarks on agents that were named but cannot be driven, and on locked ones."""
    remarks = [
        f"Agent {name} keeps its trajectory: {_reason(scenario, name)}."
        for name in wanted
        if name not in driven
    ]
    count = len(scenario.locks)
    if count:
        agents, are = ("agent", "is") if count == 1 else ("agents", "are")
        remarks.append(f"{count} {agents} {are} locked and kept.")
    return tuple(remarks)


def _reason(scenario: Scenario, agent_id: str) -> str:
    agents = scenario.agents
    row = agents.row_of[agent_id]
    if agent_id in scenario.locks:
        return "it is locked"
    if not agents.is_valid[row, scenario.current_step]:
        return "it is not there at the current step"
    if agents.kinds[row] not in ROAD_USER_KINDS:
        return f"it is a {agents.kinds[row].value}, not a road user"
    return "it is of another kind or not in the region"
