"""Commands that apply generated traffic, alone or for an edit."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np

from pd_editor.analysis.metrics.box_overlaps import overlaps_of_pairs, pairs_that_meet
from pd_editor.analysis.repair.back_casting import made_up_past, with_past
from pd_editor.base.errors import EditError, GenerationError
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain
from pd_editor.editor.commands.agents import new_agent_ids
from pd_editor.editor.commands.command import Command, agents_in_words
from pd_editor.editor.commands.edit_limits import (
    check_new_id,
    check_number_of_agents,
    check_positions,
    check_velocities,
)
from pd_editor.editor.commands.locks import locked_agents_error
from pd_editor.scene.agent_kind import (
    ROAD_USER_KINDS,
    Activity,
    AgentCategory,
    AgentKind,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    GuidanceSetting,
    Quality,
    Region,
    TrafficSample,
    check_kept,
    check_numbers,
)
from pd_editor.scene.geometry.angles import turned, wrap_angle
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.locks import kept_steps
from pd_editor.scene.roles.focal_agent import focal_place_m, with_focal_agent
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import SAME_STATE_M
from pd_editor.scene.traffic_sample import MadeUpPast

NEW_PREFIX: Final = "new"
"""Prefix of the ids of generated agents: ``new-1``, ``new-2``, ..."""


@dataclass(frozen=True, kw_only=True)
class RequestSummary:
    """A generation request without its scenario, as stored in recipes."""

    agent_ids: tuple[str, ...]
    num_new_agents: Mapping[AgentKind, int] = field(default_factory=dict)
    samples_num_agents: bool = False
    resampled_state_ids: tuple[str, ...] = ()
    moving_share: float | None = None
    only_on_road: bool = False
    region: Region | None = None
    quality: Quality = "fast"
    back_casts: bool = False
    """Whether agents with sampled states get a made-up past."""
    removed_ids: tuple[str, ...] = ()
    """Ids of agents that were removed before the generation."""
    num_samples: int = 1
    sample_index: int = 0
    num_denoising_steps: int | None = None
    guidance: tuple[GuidanceTerm | GuidanceSetting, ...] = ()
    is_unguided: bool = False
    """Whether the sample is the one without guidance, which a guided run also makes."""
    may_reuse_ids: bool = False
    """Whether new agents may have ids of agents that were removed earlier."""

    def request(self, scenario: Scenario, seed: int) -> GenerationRequest:
        """The request for a scenario that still contains the removed agents."""
        if self.is_unguided:
            scenario = replace(scenario, guidance=())
        return GenerationRequest(
            scenario=scenario.without_agents(self.removed_ids),
            seed=seed,
            **{name: getattr(self, name) for name in _REQUEST_FIELDS},
        )


_REQUEST_FIELDS: Final = {one.name for one in fields(RequestSummary)} & {
    one.name for one in fields(GenerationRequest)
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplaceTraffic(Command):
    """Apply generated trajectories to agents, and add generated agents.

    Replaced agents are removed first. If the focal agent is among them, the moving
    vehicle nearest to it becomes the focal agent.

    Agents of the scenario keep their kind, their size and, if the sample agrees with it,
    their current state; otherwise the sample's state is applied, and ``past`` takes the
    place of the history, which no longer leads there. States that a lock keeps are not
    written. Arrays are stored as float32.
    """

    sample: TrafficSample
    generator: str
    model_sha256: str = ""
    seed: int = 0
    request: RequestSummary
    past: MadeUpPast | None = None
    left_out_ids: tuple[str, ...] = ()
    """Ids of agents that the recording shows later, where generated agents are then."""

    def __post_init__(self) -> None:
        self.sample.check()
        for motion in filter(None, (self.sample, self.past)):
            check_positions(motion.position_m)
            check_velocities(motion.velocity_mps)
        asked = self.request
        check_numbers(
            num_samples=asked.num_samples,
            num_denoising_steps=asked.num_denoising_steps,
            num_new_agents=asked.num_new_agents,
            seed=self.seed,
        )
        for text in (self.generator, self.model_sha256):
            if not is_plain(text):
                raise EditError(
                    f"{text!r} cannot be a generator's name; expected a text"
                    f" of one line, at most {MAX_ID_CHARACTERS} characters."
                )
        object.__setattr__(self, "sample", _as_float32(self.sample))

    @property
    def label(self) -> str:
        """Label with what was sampled, the sample's index, and the generator."""
        agents = agents_in_words(self.sample.ids)
        asked = self.request
        if asked.resampled_state_ids or asked.removed_ids:
            done = f"Resample {agents}"
        elif asked.samples_num_agents or any(asked.num_new_agents.values()):
            done = f"Add {agents}"
        else:
            done = f"Regenerate {agents}"
        which = ""
        if asked.num_samples > 1:
            which = f", sample {asked.sample_index + 1} of {asked.num_samples}"
        how = ", unguided" if asked.is_unguided else ""
        return f"{done}{which} ({self.generator}, seed {self.seed}{how})"

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user on agents whose past is short, and on those left out."""
        notes, late = [], 0
        if self.past is not None:
            late = int((~self.past.exists.all(axis=1)).sum())
        if self.past is not None and late:
            appear = f"agents appear{'s' if late == 1 else ''}"
            notes.append(
                f"{late} of {len(self.past.ids)} {appear} after the scene's start: others are in the way before."
            )
        if gone := len(self.left_out_ids):
            who = " that appears later is" if gone == 1 else "s that appear later are"
            notes.append(f"{gone} agent{who} left out: generated ones are in the way.")
        return tuple(notes)

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the generated traffic."""
        self._check_steps(scenario)
        sample = self.sample
        locked = tuple(n for n in self.request.removed_ids if n in scenario.locks)
        if locked:
            raise locked_agents_error(scenario, locked)
        place = focal_place_m(scenario)
        had_ego = EGO_ID in scenario.agents.row_of
        scenario = scenario.without_agents(self.request.removed_ids)
        there = scenario.agents.row_of
        self._check_agents(there)
        if had_ego and EGO_ID not in there:
            scenario = scenario.with_agents(
                scenario.agents, f"The ego vehicle ({EGO_ID}) was removed."
            )
        if not sample.ids:
            return with_focal_agent(scenario, place)
        what = "Motion" if set(sample.ids) <= set(there) else "State and motion"
        note = (
            f"{what} of {agents_in_words(sample.ids)} was sampled by {self.generator},"
            f" seed {self.seed}."
        )
        agents = self._with_motion(self._with_new(scenario), scenario)
        gone = [name for name in self.left_out_ids if name in agents.row_of]
        gone = tuple(name for name in gone if name not in scenario.locks)
        if gone:
            note += f" Left out, in its way later: {agents_in_words(gone)}."
        scenario = scenario.with_agents(agents, note)
        return with_focal_agent(scenario.without_agents(gone), place)

    def _check_steps(self, scenario: Scenario) -> None:
        sample, axis = self.sample, scenario.time_axis
        if sample.position_m.shape[1] != axis.num_future_steps + 1:
            raise EditError(
                f"The generated traffic has {sample.position_m.shape[1]} steps; this"
                f" scenario needs {axis.num_future_steps + 1}."
            )
        if self.past is not None and self.past.heading_rad.shape[1] > axis.current_step:
            raise EditError(
                f"The made-up past has {self.past.heading_rad.shape[1]} steps; this"
                f" scenario has {axis.current_step} before the current one."
            )

    def _check_agents(self, there: Collection[str]) -> None:
        gone = [name for name in self.request.agent_ids if name not in there]
        if gone:
            raise EditError(
                f"Agent {gone[0]} is not in the scenario any more, so the generated"
                " traffic does not fit it."
            )
        clash = [
            name
            for name in self.sample.ids
            if name in there and name not in self.request.agent_ids
        ]
        if clash:
            raise EditError(
                f"There is already an agent {clash[0]!r} here, so the generated traffic"
                " does not fit."
            )

    def _with_new(self, scenario: Scenario) -> AgentTracks:
        """The agents, and blank tracks of those that are new."""
        sample, agents = self.sample, scenario.agents
        new = [n for n, name in enumerate(sample.ids) if name not in agents.row_of]
        for name in (sample.ids[n] for n in new):
            reuses = self.request.may_reuse_ids or name in self.request.removed_ids
            check_new_id(scenario, name, may_be_retired=reuses)
        check_number_of_agents(len(agents.ids) + len(new))
        if not new:
            return agents
        steps = scenario.time_axis.num_steps
        return agents.joined(blank_tracks(sample, np.array(new), steps))

    def _with_motion(self, agents: AgentTracks, scenario: Scenario) -> AgentTracks:
        """The agents with their generated futures, and pasts of those that begin anew."""
        sample, axis = self.sample, scenario.time_axis
        now = axis.current_step
        rows = agents.rows(sample.ids)
        same = agents.is_valid[rows, now] & (
            np.linalg.norm(
                agents.position_m[rows, now] - sample.position_m[:, 0], axis=-1
            )
            <= SAME_STATE_M
        )
        # What a lock keeps is not written at all, so that no rounding changes it.
        kept = kept_steps(agents, axis, scenario.locks)[rows, now:].sum(axis=1)
        begins = np.where(same, np.maximum(kept, 1), 0)
        at = np.arange(sample.heading_rad.shape[1]) >= begins[:, None]
        motion = (
            sample.position_m,
            wrap_angle(sample.heading_rad),
            sample.velocity_mps,
        )
        agents = agents.with_motion(rows, now, motion, at)
        agents = with_past(agents, rows[~same], now, self.past)
        return _with_activity(agents, rows, ~same, sample)


def traffic_command(
    request: GenerationRequest,
    traffic: GeneratedTraffic,
    sample_index: int = 0,
    *,
    removed_ids: tuple[str, ...] = (),
    edited: Scenario | None = None,
) -> ReplaceTraffic:
    """Make the command that applies one generated sample.

    ``removed_ids`` are the agents that were removed for the request; ``edited`` is the
    scenario that it is applied to, if that was edited since the request.

    Raises:
        GenerationError: there is no such sample, its shape is wrong, or it has agents
            that were not requested.
    """
    if not 0 <= sample_index < len(traffic.samples):
        raise GenerationError(
            f"Sample {sample_index} was asked for, but {traffic.generator} made"
            f" {len(traffic.samples)}."
        )
    sample, axis = traffic.samples[sample_index], request.scenario.time_axis
    sample.check(axis.num_future_steps + 1)
    taken = set(request.scenario.agents.ids) - set(request.agent_ids)
    for name in sample.ids:
        if name in taken:
            raise GenerationError(
                f"{traffic.generator} generated agent {name}, which was to be kept."
            )
    check_kept(sample, request)
    command = ReplaceTraffic(
        sample=_with_unused_ids(sample, request, edited or request.scenario),
        generator=traffic.generator,
        model_sha256=traffic.model_sha256,
        seed=request.seed,
        request=RequestSummary(
            removed_ids=removed_ids,
            sample_index=sample_index,
            **{name: getattr(request, name) for name in _REQUEST_FIELDS},
        ),
    )
    is_new = _is_new_traffic(request)
    if not (request.back_casts or is_new):
        return command
    kept = replace(command, request=replace(command.request, removed_ids=()))
    scenario = kept.apply(request.scenario)
    agents, now = scenario.agents, scenario.current_step
    if is_new:
        later = _hit_later(scenario, command.sample.ids)
        command = replace(command, left_out_ids=later)
    if not request.back_casts:
        return command
    rows = agents.rows(command.sample.ids)
    rows = rows[~agents.is_valid[rows, :now].any(axis=1)]
    if not now or not len(rows):
        return command
    seed = request.scene_seed + sample_index
    return replace(command, past=made_up_past(scenario, rows, seed))


def _is_new_traffic(request: GenerationRequest) -> bool:
    """Whether states are sampled, or all road users get new trajectories."""
    agents, now = request.scenario.agents, request.scenario.current_step
    drives = agents.is_valid[:, now] & agents.kind_mask(ROAD_USER_KINDS)
    ids = {agents.ids[row] for row in np.flatnonzero(drives)}
    is_whole = ids.issubset({*request.agent_ids, *request.scenario.locks})
    return request.samples_states or (is_whole and request.before_edit is None)


def _hit_later(scenario: Scenario, generated_ids: Sequence[str]) -> tuple[str, ...]:
    """Agents that appear after the current step, and that generated ones collide with.

    They belong to the recorded traffic. Those that guidance names or locks keep stay.
    """
    agents, now = scenario.agents, scenario.current_step
    kept = {name for term in scenario.guidance for name in term.named_ids}
    kept |= {EGO_ID, scenario.focal_id, *scenario.locks}
    boxes = agents.at_steps(np.arange(now, agents.num_steps))
    pairs = pairs_that_meet(boxes.position_m, boxes.is_valid, boxes.radius_m)
    is_late = ~agents.is_valid[pairs, now]
    is_generated = np.isin(pairs, agents.rows(generated_ids))
    pairs = pairs[(is_late & is_generated[:, ::-1]).any(axis=1)]
    hit = pairs[overlaps_of_pairs(pairs, boxes)[0]]
    rows = np.unique(hit[~agents.is_valid[hit, now]]).tolist()
    return tuple(agents.ids[row] for row in rows if agents.ids[row] not in kept)


def _with_unused_ids(
    sample: TrafficSample, request: GenerationRequest, scenario: Scenario
) -> TrafficSample:
    """Give the new agents of a sample ids that are unused in the whole history."""
    driven = set(request.agent_ids)
    is_new = [name not in driven for name in sample.ids]
    if not any(
        new and scenario.has_ever_had(name)
        for new, name in zip(is_new, sample.ids, strict=True)
    ):
        return sample
    fresh = iter(new_agent_ids(scenario, sum(is_new), NEW_PREFIX))
    ids = tuple(
        next(fresh) if new else name
        for new, name in zip(is_new, sample.ids, strict=True)
    )
    return replace(sample, ids=ids)


def _as_float32(sample: TrafficSample) -> TrafficSample:
    return replace(
        sample,
        size_m=sample.size_m.astype(np.float32),
        position_m=sample.position_m.astype(np.float32),
        heading_rad=sample.heading_rad.astype(np.float32),
        velocity_mps=sample.velocity_mps.astype(np.float32),
    )


def blank_tracks(
    sample: TrafficSample, index: np.ndarray, num_steps: int
) -> AgentTracks:
    """New agents of a sample, without any valid step."""
    count = len(index)
    return AgentTracks(
        ids=tuple(sample.ids[one] for one in index),
        kinds=tuple(sample.kinds[one] for one in index),
        categories=(AgentCategory.UNSCORED,) * count,
        size_m=sample.size_m[index].astype(float),
        has_known_size=np.ones(count, bool),
        position_m=np.zeros((count, num_steps, 2)),
        heading_rad=np.zeros((count, num_steps)),
        velocity_mps=np.zeros((count, num_steps, 2)),
        is_valid=np.zeros((count, num_steps), bool),
        observed=np.zeros((count, num_steps), bool),
    )


def _with_activity(
    agents: AgentTracks, rows: np.ndarray, is_sampled: np.ndarray, sample: TrafficSample
) -> AgentTracks:
    """Set the activities that were sampled together with states.

    An agent keeps its activity if its state stays and the sample has none.
    """
    known = np.array(sample.activity or (Activity.UNKNOWN,) * len(rows), np.int8)
    kept = agents.activity[rows]
    activity = np.where(is_sampled | (known != Activity.UNKNOWN), known, kept)
    return agents.with_rows(rows, activity=activity)


@dataclass(frozen=True, kw_only=True, eq=False)
class RegeneratedEdit(Command):
    """Apply an edit, then the trajectories that agents got in reaction to it."""

    edit: Command
    traffic: ReplaceTraffic

    @property
    def label(self) -> str:
        """Label of the edit, with the agents whose trajectories were regenerated."""
        return self._labelled(self.edit.label)

    def label_after(self, before: Scenario) -> str:
        """The same, relative to the scenario before the edit."""
        return self._labelled(self.edit.label_after(before))

    @property
    def selects(self) -> tuple[str, ...] | None:
        """Ids of the agents that the edit selects."""
        return self.edit.selects

    @property
    def parts(self) -> tuple[Command, ...]:
        """The edit and the regenerated traffic."""
        return self.edit, self.traffic

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with the edit and the regenerated trajectories."""
        return self.traffic.apply(self.edit.apply(scenario))

    def _labelled(self, edit: str) -> str:
        return f"{edit}, {agents_in_words(self.traffic.sample.ids)} regenerated"


def carried_to(sample: TrafficSample, scenario: Scenario) -> TrafficSample:
    """Move each trajectory rigidly so that it continues what is fixed of its agent.

    That is the present pose, or for agents with locked seconds the last locked one. All
    agents of the sample must be in the scenario.
    """
    agents, now = scenario.agents, scenario.current_step
    rows = agents.rows(sample.ids)
    kept = scenario.kept_steps()[rows, now:].sum(axis=1)
    last = np.clip(kept - 1, 0, sample.heading_rad.shape[1] - 1)
    each = np.arange(len(rows))
    here = sample.position_m[each, last]
    start = agents.position_m[rows, now + last]
    turn = wrap_angle(
        agents.heading_rad[rows, now + last] - sample.heading_rad[each, last]
    )
    gap_m = np.hypot(*(start - here).T)
    if (gap_m < SAME_STATE_M).all() and (np.abs(turn) < 1e-4).all():
        return sample
    turn = turn[:, None]
    position = start[:, None] + turned(sample.position_m - here[:, None], turn)
    # The traffic is applied where it begins at the present state.
    is_locked = last > 0
    position[is_locked, 0] = agents.position_m[rows[is_locked], now]
    return replace(
        sample,
        position_m=position,
        heading_rad=wrap_angle(sample.heading_rad + turn),
        velocity_mps=turned(sample.velocity_mps, turn),
    )
