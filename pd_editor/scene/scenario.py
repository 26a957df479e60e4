"""A traffic scenario: road map, agents, time axis, provenance."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.base_reference import BaseReference
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.time_axis import TimeAxis

EGO_ID: Final = "AV"
"""Track id of the recording vehicle in Argoverse 2."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a scenario came from and what in it was made up."""

    source: str = ""
    """How to open it again: ``demo:NAME``, or a folder's path."""
    content_sha256: str = ""
    """Hash of the source's bytes."""
    notes: tuple[str, ...] = ()
    """One sentence per invention, for example a past that was back-cast."""
    base: BaseReference | None = None
    """What it was made from, where it is an earlier export of the editor."""
    is_bent: bool = False
    """Whether the source's road was bent already when it was exported."""
    edited_ids: frozenset[str] = frozenset()
    """Agents that were made or changed before the source was exported."""

    def is_recorded(self, agent_ids: Collection[str]) -> bool:
        """Whether these agents, and the road, are as in the recording."""
        return not self.is_bent and self.edited_ids.isdisjoint(agent_ids)


@dataclass(frozen=True, kw_only=True, eq=False)
class AppliedWarp:
    """A warp in force, with what it was applied to, so that it can be taken back."""

    warp: RoadWarp
    friction_coefficient: float | None
    """mu of the speed limit that agents were slowed to; None if they were not."""
    original_road_map: RoadMap
    original_agents: AgentTracks
    """Agents before the warp."""
    warped_agents: AgentTracks
    """The same agents right after it; whoever still equals them was not edited."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """The value that the editor edits, the model fills and the exports write."""

    scenario_id: str
    city: str
    origin_city_m: Float[np.ndarray, "2"]
    """Origin of the scene frame in the city frame."""
    road_map: RoadMap
    agents: AgentTracks
    time_axis: TimeAxis
    focal_id: str
    """Track id of the agent that a benchmark predicts; empty if it was removed."""
    applied_warp: AppliedWarp | None = None
    provenance: Provenance = Provenance()
    retired_ids: frozenset[str] = frozenset()
    """Ids of agents that edits have taken out; no later agent gets one of them."""
    source_fields: Mapping[str, Any] = field(default_factory=dict)
    """Scenario-wide fields of the source that mean nothing here; written back."""

    def __post_init__(self) -> None:
        assert self.agents.num_steps == self.time_axis.num_steps
        self.origin_city_m.flags.writeable = False

    @property
    def original_road_map(self) -> RoadMap:
        """The road as it was before any warp."""
        if self.applied_warp is None:
            return self.road_map
        return self.applied_warp.original_road_map

    @property
    def is_warped(self) -> bool:
        """Whether the road is warped, here or before it was exported."""
        return self.applied_warp is not None or self.provenance.is_bent

    @property
    def reference(self) -> BaseReference:
        """How a recipe names this scenario as its base, as it was opened."""
        return BaseReference(
            scenario_id=self.scenario_id,
            source=self.provenance.source,
            content_sha256=self.provenance.content_sha256,
            base=self.provenance.base,
            is_bent=self.provenance.is_bent,
            edited_ids=tuple(sorted(self.provenance.edited_ids)),
        )

    @property
    def current_step(self) -> int:
        """Step of the state that edits act on."""
        return self.time_axis.current_step

    @property
    def last_step(self) -> int:
        """The last step at which any agent exists; the current one if none does."""
        steps = np.flatnonzero(self.agents.is_valid.any(axis=0))
        return max(int(steps[-1]) if len(steps) else 0, self.current_step)

    def with_agents(self, agents: AgentTracks, note: str | None = None) -> "Scenario":
        """The scenario with other agents, and a word about what was made up."""
        provenance = self.provenance
        if note is not None:
            provenance = replace(provenance, notes=(*provenance.notes, note))
        return replace(self, agents=agents, provenance=provenance)

    def without_agents(self, agent_ids: Collection[str]) -> "Scenario":
        """The scenario without some agents, whose ids are retired.

        Without its focal agent it has none, until ``with_focal_agent`` finds another.

        Raises:
            EditError: an id is not in the scenario.
        """
        if not agent_ids:
            return self
        left = np.delete(np.arange(len(self.agents)), self.agents.rows(agent_ids))
        return replace(
            self,
            agents=self.agents.taken(left),
            focal_id="" if self.focal_id in agent_ids else self.focal_id,
            retired_ids=self.retired_ids.union(agent_ids),
        )

    def has_ever_had(self, agent_id: str) -> bool:
        """Whether an agent of this history has, or has had, the id."""
        return agent_id in self.agents.row_of or agent_id in self.retired_ids
