"""Edits of one scene in another: what names all agents, the ego or the focal agent.

Places are carried with the focal agent's pose. An edit of other agents, or of lanes, means
nothing elsewhere and is left out.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

from pd_editor.base.errors import EditError, GenerationError
from pd_editor.editor.commands import (
    AddGuidance,
    BeginAt,
    ChangeGuidance,
    Command,
    DeleteAgents,
    RegeneratedEdit,
    RemoveAllAgents,
    RemoveGuidance,
    ReplaceTraffic,
    RequestSummary,
    SetAgentActivity,
    SetAgentKind,
    SetAgentSize,
    SetAgentSpeed,
    SetLocks,
    SetRoadWarp,
    SlowToComfort,
    SlowToFrictionLimit,
    SnapToLane,
    YieldToOthers,
)
from pd_editor.editor.commands.road import RemoveSignals, SampleSignals
from pd_editor.editor.recipe import applied, sampled_anew
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import GuidanceSetting, ScenarioGenerator
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.guidance_terms import AgentsGuidance, GuidanceTerm
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.roles.traffic_choice import (
    drivable_agent_ids,
    replaceable_agent_ids,
    resamplable_agent_ids,
)
from pd_editor.scene.scenario import EGO_ID, Scenario

_Role = Callable[[Scenario], Sequence[str]]
_OF_SCENES: Final = (RemoveAllAgents, SampleSignals, RemoveSignals, BeginAt)
_OF_AGENTS: Final = (
    SetAgentKind,
    SetAgentSize,
    SetAgentActivity,
    DeleteAgents,
    SetAgentSpeed,
    SlowToFrictionLimit,
    SlowToComfort,
    YieldToOthers,
    SnapToLane,
    SetLocks,
)


class _LeftOut(Exception):
    """The edit is about agents or places of its own scene."""


def carried(
    commands: Mapping[int, Command],
    befores: Mapping[int, Scenario],
    scenario: Scenario,
    make: Callable[[str], ScenarioGenerator],
) -> tuple[Scenario, dict[int, Command]]:
    """Apply entries of a recipe to another scenario, with their traffic sampled there.

    ``befores`` are the scenarios before each entry in the scene that it was made in.
    Returns the result, and the entries as they are there; others were left out.

    Raises:
        RecipeError: an entry does not apply.
        EditError: there is no focal agent, and a warp or a region is ahead of one.
        GenerationError: the generator refused.
    """
    made: dict[int, Command] = {}
    terms: list[bool] = []
    for number, command in commands.items():
        try:
            there = _carried(command, _Pair(befores[number], scenario), terms)
        except _LeftOut:
            continue
        made[number] = sampled_anew(there, scenario, make, number)
        scenario = applied(made[number], scenario, number)
    return scenario, made


@dataclass(frozen=True)
class _Pair:
    """A scenario in which an edit was made, and another one."""

    here: Scenario
    there: Scenario

    def agents(self, ids: tuple[str, ...]) -> tuple[str, ...]:
        """The agents that are in the other scenario what some are in the first one."""
        if not ids:
            return ()
        mine, other = self.here.agents, self.there.agents
        kinds = {mine.kinds[mine.row_of[name]] for name in ids}
        for role in _ROLES:
            all_mine, found = _in_role(role, self.here), _in_role(role, self.there)
            if len(ids) > 1 and set(ids) != set(all_mine):
                # Those of some kinds, too; a single one is rather meant as itself.
                all_mine = _of_kinds(mine, all_mine, kinds)
                found = _of_kinds(other, found, kinds)
            if set(ids) == set(all_mine) and found:
                return tuple(found)
        raise _LeftOut

    def pose(self, pose: RigidMotion) -> RigidMotion:
        """A pose that is to the other focal agent as one is to the first."""
        mine, theirs = (pose_of_anchor(one, "focal") for one in (self.here, self.there))
        return theirs.after(mine.inverse()).after(pose)

    def request(self, asked: RequestSummary) -> RequestSummary:
        """The request of one sample in the other scenario."""
        removed = self.agents(asked.removed_ids) if self.there.agents.ids else ()
        left = _Pair(
            self.here.without_agents(asked.removed_ids),
            self.there.without_agents(removed),
        )
        region = asked.region
        if region is not None:
            x, y = region.center_m
            pose = left.pose(RigidMotion(x_m=x, y_m=y, rotation_rad=0.0))
            region = replace(region, center_m=(pose.x_m, pose.y_m))
        return replace(
            asked,
            removed_ids=removed,
            agent_ids=left.agents(asked.agent_ids),
            resampled_state_ids=left.agents(asked.resampled_state_ids),
            region=region,
            num_samples=1,
            sample_index=0,
            guidance=tuple(map(left.term, asked.guidance)),
        )

    def term(
        self, term: GuidanceTerm | GuidanceSetting
    ) -> GuidanceTerm | GuidanceSetting:
        """A term of all agents, or of those in a role."""
        if not isinstance(term, AgentsGuidance | GuidanceSetting):
            raise _LeftOut
        return replace(term, agent_ids=self.agents(term.agent_ids))


def _carried(command: Command, pair: _Pair, terms: list[bool]) -> Command:
    """The edit in the other scene; ``terms`` are which guidance terms are there, too."""
    if isinstance(command, _OF_SCENES):
        return command
    if isinstance(command, _OF_AGENTS):
        return replace(command, agent_ids=pair.agents(command.agent_ids))
    if isinstance(command, SetRoadWarp):
        warp = command.warp
        if warp is None:
            return command
        return replace(command, warp=replace(warp, anchor=pair.pose(warp.anchor)))
    if isinstance(command, ReplaceTraffic):
        return replace(command, request=pair.request(command.request))
    if isinstance(command, RegeneratedEdit):
        edit, traffic = _carried(command.edit, pair, terms), command.traffic
        edited = _Pair(command.edit.apply(pair.here), edit.apply(pair.there))
        traffic = replace(traffic, request=edited.request(traffic.request))
        return RegeneratedEdit(edit=edit, traffic=traffic)
    return _guidance(command, pair, terms)


def _guidance(command: Command, pair: _Pair, terms: list[bool]) -> Command:
    if isinstance(command, AddGuidance):
        terms.append(False)
        added = replace(command, term=pair.term(command.term))
        terms[-1] = True
        return added
    if isinstance(command, ChangeGuidance | RemoveGuidance):
        is_there = terms[command.index]
        index = sum(terms[: command.index])
        if isinstance(command, RemoveGuidance):
            del terms[command.index]
        if is_there and isinstance(command, ChangeGuidance):
            return replace(command, index=index, term=pair.term(command.term))
        if is_there:
            return replace(command, index=index)
    raise _LeftOut


def _of_kinds(
    agents: AgentTracks, ids: Sequence[str], kinds: Collection[AgentKind]
) -> Sequence[str]:
    return [name for name in ids if agents.kinds[agents.row_of[name]] in kinds]


def _in_role(role: _Role, scenario: Scenario) -> Sequence[str]:
    """Agents in a role that are there; none if nobody is."""
    try:
        found = role(scenario)
    except (EditError, GenerationError):
        return ()
    return [name for name in found if name in scenario.agents.row_of]


def _replaceable(keeps_ego: bool, keeps_focal: bool) -> _Role:
    return lambda scenario: replaceable_agent_ids(
        scenario, keeps_ego=keeps_ego, keeps_focal=keeps_focal
    )


_ROLES: Final[tuple[_Role, ...]] = (
    drivable_agent_ids,
    lambda scenario: resamplable_agent_ids(scenario, drivable_agent_ids(scenario)),
    *(_replaceable(*keeps) for keeps in product((False, True), repeat=2)),
    lambda _scenario: (EGO_ID,),
    lambda scenario: (scenario.focal_id,),
)
