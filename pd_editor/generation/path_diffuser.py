"""Path Diffuser as a ``ScenarioGenerator``: initial states, then trajectories."""

import threading
import time
from collections.abc import Callable, Collection, Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.analysis.guidance.report import guidance_reports
from pd_editor.analysis.metrics.road.off_lane import BEYOND_ROADS_M, ids_near_lanes
from pd_editor.base.errors import GenerationError
from pd_editor.generation.checkpoints.model_folder import (
    TrainedModel,
    TrainedStage,
    load_model,
)
from pd_editor.generation.core.devices import (
    keep_freed_memory,
    lay_out_weights,
    sampling_device,
    threads_for,
)
from pd_editor.generation.defaults import NUM_TRIES, DeviceName
from pd_editor.generation.initial_state.attributes import (
    AttributeRequest,
    attribute_notes,
)
from pd_editor.generation.initial_state.conflicts import ConflictResampling
from pd_editor.generation.initial_state.fitting import (
    colliding_with_kept,
    limited,
    num_overlapping,
    without_new,
    without_overlapping,
)
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.pipeline import (
    SquarePlacement,
    place_in_squares,
    placed_again,
)
from pd_editor.generation.initial_state.sampler import InitialStateSamplerConfig
from pd_editor.generation.initial_state.squares import Placement, placings_of
from pd_editor.generation.request_check import (
    MOST_AGENTS,
    check_request,
    num_present,
)
from pd_editor.generation.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.generation.trajectory.network.decoding import Motion
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.pipeline import (
    TrajectoryOptions,
    TrajectorySampling,
    sample_task,
)
from pd_editor.generation.trajectory.present_trajectories import PresentTrajectories
from pd_editor.generation.trajectory.sample_yielding import with_yielding
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.activity import Activity
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.generation import (
    AVOIDANCE,
    CAPABILITIES,
    LANE_GUIDANCE,
    MAX_SEED,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    GuidanceReport,
    TrafficSample,
)
from pd_editor.scene.guidance_terms import PairGuidance
from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import MAX_AGENTS

Preview = Callable[[], tuple[TrafficSample, ...]]

_MOST_NAMED: Final = 6
"""Number of agents that a note lists."""
_MOST_PLACINGS: Final = 4
"""How often states of agents that collide with kept ones are sampled at most."""
_SEED_STEP: Final = 1_000_003
"""Difference of the seeds of these."""
_PLACING_SHARE: Final = 0.8
"""Share of the progress of the first stage in samples with both stages."""
_MOST_PLACED_TOGETHER: Final = 16
"""Largest number of samples whose states are sampled before their trajectories."""


@dataclass(frozen=True, kw_only=True)
class DenoisingProgress(GenerationProgress):
    """Progress after a denoising step, with the samples predicted so far."""

    preview: Preview = field(default=tuple, compare=False, repr=False)


class PathDiffuser:
    """Generates initial states and trajectories with the weights of a model folder."""

    supports: Final = CAPABILITIES

    def __init__(
        self,
        folder: Path,
        name: str = "path-diffuser",
        device: DeviceName = "auto",
    ) -> None:
        """Make a generator; weights are read on first use.

        Raises:
            GenerationError: a GPU is requested, and there is none.
        """
        self._folder, self._name = Path(folder), name
        self._device = sampling_device(device)
        self._model: TrainedModel | None = None
        self._present: PresentTrajectories | None = None
        self._newest_task: TrajectoryTask | None = None
        self._lock = threading.Lock()

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        return self._name

    def model(self) -> TrainedModel:
        """The model, read once, on the sampling device.

        Raises:
            ModelError: the weights are missing, damaged or foreign.
        """
        with self._lock:
            if self._model is None:
                with threads_for(0):
                    self._model = load_model(self._folder, STAGE_KINDS)
                    for stage in self._model.stages.values():
                        lay_out_weights(stage.model.to(self._device))
                keep_freed_memory()
            return self._model

    def warm_up(self) -> None:
        """Load the model ahead of the first generation.

        Raises:
            ModelError: the weights are missing, damaged or foreign.
        """
        self._initial_states()
        self._trajectories()

    def generate(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, GeneratedTraffic]:
        """Yield progress after each denoising step and return the traffic.

        Raises:
            GenerationError: the request cannot be met.
            EditError: an agent is not in the scenario.
            ModelError: the weights cannot be used.
        """
        began = time.perf_counter()
        check_request(request)
        model = self.model()
        if not request.agent_ids and not request.samples_states:
            raise GenerationError(
                "There is no agent to generate; expected at least one agent."
            )
        if request.samples_states:
            found = yield from self._sampled_states_and_trajectories(request)
        else:
            label = f"{len(request.agent_ids)} agents"
            found = yield from self._sampled_trajectories(
                request,
                request.scenario,
                request.agent_ids,
                range(request.num_samples),
                partial(_progress, label),
            )
        return GeneratedTraffic(
            samples=found.samples,
            generator=self.name,
            model_sha256=model.sha256,
            seed=request.seed,
            elapsed_s=time.perf_counter() - began,
            notes=(*found.notes, *found.yielding_notes(), *_notes(request)),
            slowed_ids=found.slowed_ids if any(found.slowed_ids) else (),
            guidance=found.reports,
        )

    def _initial_states(self) -> TrainedStage:
        return self.model().stage(INITIAL_STATES.name)

    def _trajectories(self) -> TrainedStage:
        return self.model().stage(TRAJECTORIES.name)

    def _sampled_states_and_trajectories(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, "_Sampled"]:
        stage = self._initial_states()
        model = stage.model
        assert isinstance(model, InitialStateDenoiser)
        request, far_notes = _near_lanes(request)
        found = [_placings(stage, request, one) for one in range(request.num_samples)]
        placings = {index: squares for index, (squares, _) in enumerate(found)}
        asked = [number for _, number in found]
        samples: list[_Sampled] = []
        placed: list[tuple[Scenario, tuple[str, ...]]] = []
        fits: list[tuple[int, int]] = []
        for first in range(0, request.num_samples, _MOST_PLACED_TOGETHER):
            batch = range(
                first, min(first + _MOST_PLACED_TOGETHER, request.num_samples)
            )
            scenes = yield from place_in_squares(
                model,
                request.scenario,
                {index: placings[index] for index in batch},
                seed=request.scene_seed,
                sampler=_state_sampler(request, stage),
                guidance=_state_guidance(request, stage),
                resampling=_conflict_resampling(request, stage),
                generated_ids=request.agent_ids,
                progress=partial(_placing_progress, batch, request.num_samples),
            )
            for number, (index, scenario) in enumerate(zip(batch, scenes, strict=True)):
                fitting, new_ids, driven = yield from self._driven_states(
                    request,
                    stage,
                    scenario,
                    placings[index],
                    index,
                    partial(_driving_progress, batch, number, request.num_samples),
                )
                placed.append((fitting, (*request.resampled_state_ids, *new_ids)))
                fits.append((len(new_ids), asked[index]))
                samples.append(driven)
        notes = list(attribute_notes(placed, _attribute_request(request)))
        notes += [*_fit_notes(fits), *far_notes]
        crowded = max(num_overlapping(scenario, ids) for scenario, ids in placed)
        if crowded and request.refines_states:
            notes.append(
                f"There is no room for {crowded} placed agents, which overlap others; "
                "resample fewer, or in a region with more road."
            )
        num_empty = sum(not number for _, number in fits)
        if num_empty and not request.resampled_state_ids:
            notes.append(
                f"No agent was placed in {num_empty} of {len(placed)} samples: there are "
                "as many road users as suit the road."
            )
        return _Sampled(
            samples=tuple(one for driven in samples for one in driven.samples),
            slowed_ids=tuple(one for driven in samples for one in driven.slowed_ids),
            notes=tuple(notes),
            reports=tuple(one for driven in samples for one in driven.reports),
        )

    def _driven_states(
        self,
        request: GenerationRequest,
        stage: TrainedStage,
        scenario: Scenario,
        squares: tuple[SquarePlacement, ...],
        index: int,
        progress: Callable[[float, Preview], DenoisingProgress],
    ) -> Generator[
        GenerationProgress, None, tuple[Scenario, tuple[str, ...], "_Sampled"]
    ]:
        """Trajectories from placed states, of which those in the way are placed again.

        Where a placed agent will drive is not known when states are sampled, so it may
        collide with a kept one later; new agents that still do are left out in the end.
        Returns the scenario with the states that were used, the new agents in it, and the
        trajectories.
        """
        model = stage.model
        assert isinstance(model, InitialStateDenoiser)
        wanted = tuple(name for one in squares for name in one.new_ids)
        tries = _MOST_PLACINGS if request.refines_states and _yields(request) else 1
        best: _Placed | None = None
        for attempt in range(tries):
            if best is not None:
                (scenario,) = yield from place_in_squares(
                    model,
                    best.scenario,
                    {index: placed_again(squares, best.in_the_way)},
                    seed=(request.scene_seed + attempt * _SEED_STEP) % MAX_SEED,
                    sampler=_state_sampler(request, stage),
                    guidance=_state_guidance(request, stage),
                    resampling=_conflict_resampling(request, stage),
                    generated_ids=request.agent_ids + best.new_ids,
                    progress=lambda _share: progress(1.0, tuple),
                )
            new_ids = tuple(n for n in wanted if n in scenario.agents.row_of)
            if request.refines_states:
                scenario, new_ids = without_overlapping(scenario, new_ids)
            sampled = yield from self._sampled_trajectories(
                request,
                scenario,
                request.agent_ids + new_ids,
                range(index, index + 1),
                progress if best is None else lambda _share, one: progress(1.0, one),
            )
            found = _Placed(
                scenario=scenario,
                new_ids=new_ids,
                sampled=sampled,
                in_the_way=colliding_with_kept(
                    scenario,
                    sampled.samples[0],
                    request.resampled_state_ids + new_ids,
                    new_ids,
                ),
            )
            if best is None or len(found.in_the_way) < len(best.in_the_way):
                best = found
            if not best.in_the_way:
                break
        assert best is not None
        if tries == 1:
            return best.scenario, best.new_ids, best.sampled
        fitting, new_ids = without_new(best.scenario, best.new_ids, best.in_the_way)
        gone = frozenset(best.new_ids).difference(new_ids)
        return fitting, new_ids, best.sampled.without(gone) if gone else best.sampled

    def _sampled_trajectories(
        self,
        request: GenerationRequest,
        scenario: Scenario,
        ids: tuple[str, ...],
        indices: range,
        progress: Callable[[float, Preview], DenoisingProgress],
    ) -> Generator[DenoisingProgress, None, "_Sampled"]:
        stage = self._trajectories()
        model = stage.model
        assert isinstance(model, TrajectoryDenoiser)
        rows = scenario.agents.rows(ids)
        kept = {one.other_id for one in request.terms if isinstance(one, PairGuidance)}
        known = lasting(scenario, kept.difference(ids))
        task = self._task(known, rows, model, sees_all=bool(request.terms))
        options = _options(request, stage)
        continuation = None
        if request.before_edit is not None:
            present = self._present_trajectories(request.before_edit, ids, model)
            continuation = present.continued(task, options)
        sampled = yield from sample_task(
            TrajectorySampling(model=model, task=task, options=options),
            indices,
            lambda share, predicted: progress(
                share, lambda: _samples(task, rows, predicted())
            ),
            continuation,
        )
        notes: list[str] = []
        if sampled.lane_cost_m[0] > 0:
            before, after = sampled.lane_cost_m
            notes.append(
                f"Distance to lanes: {before:.1f} -> {after:.1f} m by guidance."
            )
        yields = _yields(request)
        samples = [
            with_yielding(scenario, rows, one, request.terms) if yields else (one, ())
            for one in _samples(task, rows, sampled.motion)
        ]
        unguided = ()
        if sampled.unguided is not None:
            unguided = _samples(task, rows, sampled.unguided)
        if yields:
            unguided = tuple(with_yielding(scenario, rows, one)[0] for one in unguided)
        reports = ()
        if request.terms and request.before_edit is None:
            reports = guidance_reports(
                scenario,
                [sample for sample, _ in samples],
                request.terms,
                unguided,
                [slowed for _, slowed in samples],
            )
        return _Sampled(
            samples=tuple(sample for sample, _ in samples),
            slowed_ids=tuple(slowed for _, slowed in samples),
            notes=tuple(notes),
            reports=reports,
        )

    def _task(
        self,
        scenario: Scenario,
        rows: Int[np.ndarray, "G"],
        model: TrajectoryDenoiser,
        *,
        sees_all: bool,
    ) -> TrajectoryTask:
        """The network's input, which edits of the guidance alone do not change."""
        newest = self._newest_task
        task = newest and newest.of_edited(scenario, rows, sees_all=sees_all)
        if task is None:
            task = TrajectoryTask.of(
                scenario,
                rows,
                model.decoder.basis,
                config=model.config,
                sees_all=sees_all,
            ).to(self._device)
        self._newest_task = task
        return task

    def _present_trajectories(
        self, scenario: Scenario, ids: tuple[str, ...], model: TrajectoryDenoiser
    ) -> PresentTrajectories:
        """Trajectories before an edit; those of the last request are kept."""
        present = self._present
        if (
            present is None
            or present.scenario is not scenario
            or present.agent_ids != ids
        ):
            present = PresentTrajectories(model, scenario, ids)
            self._present = present
        return present


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sampled:
    """Samples with the slowed agents of each, and notes for the user."""

    samples: tuple[TrafficSample, ...]
    slowed_ids: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]
    reports: tuple[GuidanceReport, ...] = ()

    def without(self, gone: Collection[str]) -> "_Sampled":
        """The same without some agents."""
        return replace(
            self,
            samples=tuple(one.without(gone) for one in self.samples),
            slowed_ids=tuple(
                tuple(name for name in ids if name not in gone)
                for ids in self.slowed_ids
            ),
            reports=tuple(
                one
                if one.unguided is None
                else replace(one, unguided=one.unguided.without(gone))
                for one in self.reports
            ),
        )

    def yielding_notes(self) -> list[str]:
        """Note on the agents that were slowed."""
        count = sum(map(len, self.slowed_ids))
        if not count:
            return []
        agents = "agent" if count == 1 else "agents"
        if len(self.samples) > 1:  # whose agents have the same ids
            return [
                f"{count} {agents} in {len(self.samples)} samples slowed down to avoid "
                "a collision."
            ]
        (names,) = self.slowed_ids
        names_listed = ", ".join(names[:_MOST_NAMED])
        more = f" and {len(names) - _MOST_NAMED} more" * (len(names) > _MOST_NAMED)
        return [
            f"{count} {agents} slowed down to avoid a collision: {names_listed}{more}."
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed:
    """Placed states and the trajectories sampled from them."""

    scenario: Scenario
    new_ids: tuple[str, ...]
    sampled: _Sampled
    in_the_way: tuple[str, ...]
    """Placed agents that collide with kept ones."""


def _placing_progress(
    batch: range, num_samples: int, share: float
) -> GenerationProgress:
    done = (batch.start + len(batch) * _PLACING_SHARE * share) / num_samples
    return GenerationProgress(
        fraction=done, message=f"{_named(batch, num_samples)}: placing agents"
    )


def _driving_progress(
    batch: range, number: int, num_samples: int, share: float, preview: Preview
) -> DenoisingProgress:
    of_batch = _PLACING_SHARE + (1 - _PLACING_SHARE) * (number + share) / len(batch)
    return DenoisingProgress(
        fraction=(batch.start + len(batch) * of_batch) / num_samples,
        message=f"Sample {batch[number] + 1} of {num_samples}",
        preview=preview,
    )


def _named(batch: range, num_samples: int) -> str:
    if len(batch) == 1:
        return f"Sample {batch.start + 1} of {num_samples}"
    return f"Samples {batch.start + 1} to {batch.stop} of {num_samples}"


def _progress(label: str, share: float, preview: Preview) -> DenoisingProgress:
    return DenoisingProgress(fraction=share, message=label, preview=preview)


def _placings(
    stage: TrainedStage, request: GenerationRequest, sample: int
) -> tuple[tuple[SquarePlacement, ...], int]:
    """Agents to place in a sample, and the number of new ones that was asked for.

    Each sample may have another number of agents, at most as many as the model takes.
    """
    assert isinstance(stage.model, InitialStateDenoiser)
    placement = Placement(
        resampled_ids=request.resampled_state_ids,
        num_new_agents=request.num_new_agents,
        samples_num_agents=request.samples_num_agents,
        density=stage.sampling["sampler"].fit_density,
        region=request.region,
        attributes=_attribute_request(request),
    )
    random = np.random.default_rng([request.scene_seed, sample])
    placings = placings_of(stage.model, request.scenario, placement, random)
    number = sum(len(one.new_ids) for one in placings)
    room = min(
        MOST_AGENTS - num_present(request.scenario),
        MAX_AGENTS - len(request.scenario.agents),
    )
    fitting = limited(placings, room, random)
    return tuple(
        replace(one, repairs=request.refines_states) for one in fitting
    ), number


def _near_lanes(
    request: GenerationRequest,
) -> tuple[GenerationRequest, tuple[str, ...]]:
    """The request without resampling of agents beyond the mapped roads, and a note.

    If there are no others they are resampled, and with a region wherever they are.
    """
    ids = request.resampled_state_ids
    near = ids if request.region else ids_near_lanes(request.scenario, ids)
    count = len(ids) - len(near)
    if not count or not near:
        return request, ()
    keep = "keeps its state" if count == 1 else "keep their states"
    note = (
        f"{count} of {len(ids)} agents, more than {BEYOND_ROADS_M:g} m from all mapped "
        f"lanes, {keep}."
    )
    return replace(request, resampled_state_ids=near), (note,)


def _state_guidance(
    request: GenerationRequest, stage: TrainedStage
) -> InitialStateGuidance:
    guidance = stage.sampling["guidance"]
    return guidance if request.refines_states else guidance.at_no_level()


def _conflict_resampling(
    request: GenerationRequest, stage: TrainedStage
) -> ConflictResampling | None:
    if not request.refines_states:
        return None
    resampling = stage.sampling["conflicts"]
    if request.quality == "high":
        versions = resampling.num_high_quality_versions
        return replace(resampling, num_versions=versions)
    return resampling


def _fit_notes(fits: Sequence[tuple[int, int]]) -> list[str]:
    """Notes on samples in which fewer new agents fit than were asked for."""
    short = [
        (sample, number, asked)
        for sample, (number, asked) in enumerate(fits, start=1)
        if number < asked
    ]
    notes = [
        (f"Sample {sample}: " if len(fits) > 1 else "")
        + f"{number} of {asked} new agents were placed; no free place was found for "
        f"{asked - number}."
        for sample, number, asked in short[:_MOST_NAMED]
    ]
    if len(short) > _MOST_NAMED:
        notes.append(f"So it is in {len(short) - _MOST_NAMED} more samples.")
    return notes


def _state_sampler(
    request: GenerationRequest, stage: TrainedStage
) -> InitialStateSamplerConfig:
    sampler = stage.sampling["sampler"]
    if request.quality == "high":
        return replace(sampler, num_steps=sampler.num_high_quality_steps)
    return sampler


def _attribute_request(request: GenerationRequest) -> AttributeRequest:
    return AttributeRequest(
        moving_share=request.moving_share, only_on_road=request.only_on_road
    )


def _num_tries(request: GenerationRequest) -> int:
    """Number of tries per trajectory; 0 if collisions are not avoided."""
    avoids = [term for term in request.settings if term.name == AVOIDANCE]
    if not avoids:
        return NUM_TRIES
    wanted = int(avoids[-1].parameters.get("tries", NUM_TRIES))
    return max(wanted, 0) if avoids[-1].weight > 0 else 0


def _yields(request: GenerationRequest) -> bool:
    """Whether agents that would collide yield."""
    avoids = [term for term in request.settings if term.name == AVOIDANCE]
    wanted = avoids[-1].parameters.get("yields", 1.0) if avoids else 1.0
    return bool(_num_tries(request)) and wanted > 0


def _options(request: GenerationRequest, stage: TrainedStage) -> TrajectoryOptions:
    sampler, guidance = stage.sampling["sampler"], stage.sampling["guidance"]
    if request.num_denoising_steps is not None:
        sampler = replace(sampler, num_steps=request.num_denoising_steps)
    lanes = [term for term in request.settings if term.name == LANE_GUIDANCE]
    if lanes:
        strength = lanes[-1].weight
        guidance = replace(guidance, weight=strength, warped_weight=strength)
    return TrajectoryOptions(
        sampler=sampler,
        guidance=guidance,
        lane_agent_ids=lanes[-1].agent_ids if lanes else (),
        terms=request.terms,
        term_guidance=stage.sampling["terms"],
        avoids=all(one.weight > 0 for one in request.settings if one.name == AVOIDANCE),
        samples_unguided=request.reports_cost,
        num_tries=max(_num_tries(request), 1),
        seed=request.scene_seed,
    )


def _samples(
    task: TrajectoryTask, rows: Int[np.ndarray, "G"], motion: Motion
) -> tuple[TrafficSample, ...]:
    """Samples of a motion; static objects keep their velocity."""
    agents, axis = task.scenario.agents, task.scenario.time_axis
    now = task.scenario.current_step
    place = {int(row): index for index, row in enumerate(task.features.agent_row)}
    sampled = np.array([place.get(int(row), -1) for row in rows], int)
    time_s = axis.step_s * np.arange(axis.num_future_steps + 1)
    velocity = agents.velocity_mps[rows, now][:, None].repeat(len(time_s), axis=1)
    position = agents.position_m[rows, now][:, None] + velocity * time_s[:, None]
    heading = agents.heading_rad[rows, now][:, None].repeat(len(time_s), axis=1)
    has = sampled >= 0
    known = agents.activity[rows]
    activity = tuple(Activity(int(one)) for one in known) if known.any() else ()
    samples: list[TrafficSample] = []
    for index in range(len(motion.position_m)):
        here = [one.copy() for one in (position, heading, velocity)]
        for table, values in zip(
            here,
            (motion.position_m, motion.heading_rad, motion.velocity_mps),
            strict=True,
        ):
            table[has] = values[index, sampled[has]]
        samples.append(
            TrafficSample(
                ids=tuple(agents.ids[row] for row in rows),
                kinds=tuple(agents.kinds[row] for row in rows),
                size_m=agents.size_m[rows],
                position_m=here[0],
                heading_rad=here[1],
                velocity_mps=here[2],
                activity=activity,
            )
        )
    return tuple(samples)


def _notes(request: GenerationRequest) -> list[str]:
    known = {LANE_GUIDANCE, AVOIDANCE}
    other = [term.name for term in request.settings if term.name not in known]
    notes = [f"The model takes no guidance {name!r}." for name in other]
    agents = request.scenario.agents
    static_objects = [
        name
        for name in request.agent_ids
        if agents.kinds[agents.row_of[name]] not in ROAD_USER_KINDS
    ]
    if static_objects:
        notes.append(
            f"{', '.join(static_objects)}: no road users, so they keep their velocity."
        )
    return notes
