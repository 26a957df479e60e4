"""A traffic scenario: road map, agents, time axis, provenance."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

import pd_editor
from pd_editor.scene.agent_kind import Activity, activity_at, stands
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.base_reference import BaseReference, SceneCut
from pd_editor.scene.guidance_terms import NO_TRACK_M, GuidanceTerm, terms_without
from pd_editor.scene.locks import Lock, kept_steps
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.signals import Signal, stop_lines
from pd_editor.scene.time_axis import TimeAxis

EGO_ID: Final = "AV"
"""Track id of the recording vehicle in Argoverse 2."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of a scenario, and which parts of it are not recorded."""

    source: str = ""
    """How to open it again: ``demo:NAME``, or a folder's path."""
    content_sha256: str = ""
    """Hash of the source's bytes."""
    notes: tuple[str, ...] = ()
    """One sentence per synthetic part, for example a reconstructed history."""
    base: BaseReference | None = None
    """Base scenario, if this is an earlier export of the editor."""
    is_bent: bool = False
    """Whether the source's road was warped already when it was exported."""
    edited_ids: frozenset[str] = frozenset()
    """Ids of agents that were generated or edited before the source was exported."""
    caused_findings: frozenset[tuple[str, tuple[str, ...], str]] | None = None
    """Keys of the findings of an export that edits had caused; None if unknown."""
    warps: tuple[RoadWarp, ...] = ()
    """Warps of an export's road in the order of application, in the city frame."""
    friction_coefficient: float | None = None
    """Friction coefficient mu that agents of an export were slowed to."""
    cut: SceneCut | None = None
    """What is used of the source; None: all of it."""
    attribution: str | None = None
    """Who made the source, and under which licence; None: the file does not tell."""
    file_format: str = ""
    """Title of the source's format; empty: Argoverse 2."""

    def is_recorded(self, agent_ids: Collection[str]) -> bool:
        """Whether these agents and the road are as recorded."""
        return not self.is_bent and self.edited_ids.isdisjoint(agent_ids)


@dataclass(frozen=True, kw_only=True, eq=False)
class AppliedWarp:
    """An applied warp with the originals that undo it."""

    warp: RoadWarp
    friction_coefficient: float | None
    """Friction coefficient mu that agents were slowed to; None if they were not."""
    original_road_map: RoadMap
    original_agents: AgentTracks
    warped_agents: AgentTracks
    """The same agents right after the warp; agents that still equal them are unedited."""
    original_guidance: tuple[GuidanceTerm, ...] = ()
    warped_guidance: tuple[GuidanceTerm, ...] = ()
    """The same terms right after the warp."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """A traffic scenario, as it is edited, generated and exported."""

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
    guidance: tuple[GuidanceTerm, ...] = ()
    """What the user asks of generated trajectories."""
    retired_ids: frozenset[str] = frozenset()
    """Ids of deleted agents, which new agents do not reuse."""
    locks: Mapping[str, Lock] = field(default_factory=dict)
    """What is kept of each locked agent when traffic is generated or edited."""
    signals: tuple[Signal, ...] = ()
    """Traffic signals of the road's lanes."""
    source_fields: Mapping[str, Any] = field(default_factory=dict)
    """Unknown scenario-wide fields of the source, written back unchanged."""

    def __post_init__(self) -> None:
        num_steps = self.time_axis.num_steps
        assert self.agents.num_steps == num_steps
        assert all(len(one.states) == num_steps for one in self.signals)
        self.origin_city_m.flags.writeable = False

    def __repr__(self) -> str:
        """One line: the fields hold tens of thousands of numbers."""
        agents, lanes = len(self.agents.ids), len(self.road_map.lanes)
        steps = self.time_axis.num_steps
        return f"<Scenario {self.scenario_id}: {agents} agents, {lanes} lanes, {steps} steps>"

    def show(self) -> "pd_editor.Player":
        """A player for notebooks, by its public name: values import nothing that draws."""
        return pd_editor.Player(self)

    @property
    def original_road_map(self) -> RoadMap:
        """The road before any warp."""
        if self.applied_warp is None:
            return self.road_map
        return self.applied_warp.original_road_map

    @property
    def is_warped(self) -> bool:
        """Whether the road is warped, here or before it was exported."""
        return self.applied_warp is not None or self.provenance.is_bent

    @property
    def warps(self) -> tuple[RoadWarp, ...]:
        """All warps of the road, also before it was exported, in order of application."""
        past = [one.moved(-self.origin_city_m) for one in self.provenance.warps]
        return (*past, *((self.applied_warp.warp,) if self.applied_warp else ()))

    def stop_lines_m(self) -> Float[np.ndarray, "L 3 2"]:
        """Stop lines of the signals' lanes in turn: left end, middle and right end."""
        lines = stop_lines(self.signals, self.original_road_map)
        applied = self.applied_warp
        return lines if applied is None else applied.warp.apply(lines)

    @property
    def friction_coefficient(self) -> float | None:
        """Friction coefficient mu that agents were slowed to; None if they were not."""
        applied = self.applied_warp
        if applied is None or applied.friction_coefficient is None:
            return self.provenance.friction_coefficient
        return applied.friction_coefficient

    @property
    def reference(self) -> BaseReference:
        """Reference by which a recipe names this scenario as its base."""
        return BaseReference(
            scenario_id=self.scenario_id,
            source=self.provenance.source,
            content_sha256=self.provenance.content_sha256,
            base=self.provenance.base,
            is_bent=self.provenance.is_bent,
            cut=self.provenance.cut,
            attribution=self.provenance.attribution,
            edited_ids=tuple(sorted(self.provenance.edited_ids)),
            current_step=self.current_step,
        )

    def as_referred_to(self, reference: BaseReference) -> "Scenario":
        """This scenario as opened, with the current step that a reference names."""
        step = reference.current_step
        if step is None:
            return self
        return self.at_step(min(step, self.time_axis.num_steps - 1))

    def at_step(self, current_step: int) -> "Scenario":
        """This scenario as opened, with another current step and the origin of that one.

        Origins are whole metres, so positions in the city frame stay what they are.
        """
        if current_step == self.current_step:
            return self
        axis = replace(self.time_axis, current_step=current_step)
        row = self.agents.row_of.get(self.focal_id)
        shift = np.zeros(2)
        if row is not None and (there := self.agents.is_valid[row]).any():
            steps = np.flatnonzero(there)
            nearest = steps[np.abs(steps - current_step).argmin()]
            place = self.agents.position_m[row, nearest] + self.origin_city_m
            shift = self.origin_city_m - np.rint(place)
        is_valid = self.agents.is_valid[..., None]
        position = np.where(is_valid, self.agents.position_m + shift, 0.0)
        return replace(
            self,
            time_axis=axis,
            origin_city_m=self.origin_city_m - shift,
            road_map=self.road_map.moved(lambda points: points + shift),
            agents=replace(self.agents, position_m=position),
        )

    @property
    def current_step(self) -> int:
        """Step that edits act on."""
        return self.time_axis.current_step

    @property
    def last_step(self) -> int:
        """The last step at which any agent exists; the current one if none does."""
        steps = np.flatnonzero(self.agents.is_valid.any(axis=0))
        return max(int(steps[-1]) if len(steps) else 0, self.current_step)

    @property
    def first_step(self) -> int:
        """The first step at which a third of the current agents exist.

        Agents whose states are sampled have no past.
        """
        is_valid = self.agents.is_valid
        now = is_valid[:, self.current_step]
        return int(np.argmax(3 * is_valid[now].sum(axis=0) >= now.sum()))

    def activity(self) -> Int[np.ndarray, "A"]:
        """``Activity`` of each agent at the current step; what moves is driving.

        Stored activities are not changed by edits of speeds, so this is what holds.
        """
        speed = self.agents.speed_mps()[:, self.current_step]
        known = activity_at(self.agents.activity, speed)
        return np.where(stands(speed), known, Activity.DRIVING)

    def later_term(self, term: GuidanceTerm, step: int) -> GuidanceTerm | None:
        """A term as it stands at a step, after what its agent has driven since."""
        now, track_m = self.current_step, NO_TRACK_M
        if len(term.guided_ids) == 1:
            there = self.agents.taken(self.agents.rows(term.guided_ids))
            steps = slice(now, step + 1)
            track_m = there.position_m[0, steps][there.is_valid[0, steps]]
        return term.later((step - now) * self.time_axis.step_s, track_m)

    def kept_steps(self) -> Bool[np.ndarray, "A T"]:
        """Steps that locks keep of each agent."""
        return kept_steps(self.agents, self.time_axis, self.locks)

    def with_origin(self, **changed: Any) -> "Scenario":
        """The scenario with other fields of its provenance."""
        return replace(self, provenance=replace(self.provenance, **changed))

    def with_agents(self, agents: AgentTracks, note: str | None = None) -> "Scenario":
        """Replace the agents, with a note on what is not recorded; none is repeated."""
        provenance = self.provenance
        if note is not None and note not in provenance.notes:
            provenance = replace(provenance, notes=(*provenance.notes, note))
        return replace(self, agents=agents, provenance=provenance)

    def without_agents(self, agent_ids: Collection[str]) -> "Scenario":
        """Remove agents with their guidance terms, and retire their ids.

        If the focal agent is removed, ``focal_id`` is empty until ``with_focal_agent``.

        Raises:
            EditError: an id is not in the scenario.
        """
        if not agent_ids:
            return self
        left = np.delete(np.arange(len(self.agents)), self.agents.rows(agent_ids))
        gone = set(agent_ids)
        return replace(
            self,
            agents=self.agents.taken(left),
            focal_id="" if self.focal_id in agent_ids else self.focal_id,
            guidance=terms_without(self.guidance, agent_ids),
            retired_ids=self.retired_ids.union(agent_ids),
            locks={name: lock for name, lock in self.locks.items() if name not in gone},
        )

    def has_ever_had(self, agent_id: str) -> bool:
        """Whether a present or deleted agent has the id."""
        return agent_id in self.agents.row_of or agent_id in self.retired_ids
