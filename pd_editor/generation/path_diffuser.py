"""Path Diffuser as a ``ScenarioGenerator``: initial states, then trajectories."""

import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, cast

import numpy as np
from jaxtyping import Int
from torch import nn

from pd_editor.analysis.guidance.report import guidance_reports
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
from pd_editor.generation.core.sampler import Sampler, sample_steps
from pd_editor.generation.core.traced_step import trace_steps
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.initial_state.attributes import (
    AttributeRequest,
    attribute_notes,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.pipeline import (
    InitialStateOptions,
    SquarePlacement,
    place_in_squares,
    placed_again,
)
from pd_editor.generation.initial_state.placement_rules import (
    PLACEMENT_RULES,
    KeptPaths,
    PlacementRule,
)
from pd_editor.generation.initial_state.squares import (
    colliding_with_kept,
    num_overlapping,
    without_new,
    without_overlapping,
    without_unfit,
)
from pd_editor.generation.request_options import (
    check_request,
    initial_state_options,
    near_lanes,
    requested_placings,
    trajectory_options,
    yields,
)
from pd_editor.generation.samples import (
    Sampled,
    lane_measures,
    placement_notes,
    request_notes,
    samples_of,
)
from pd_editor.generation.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.generation.trajectory.pipeline import (
    PresentTrajectories,
    TrajectorySampling,
    sample_task,
)
from pd_editor.generation.trajectory.sample_yielding import with_yielding
from pd_editor.generation.trajectory.sampler import TrajectoryModel
from pd_editor.generation.trajectory.task import TrajectoryTask, guidance_looks_at
from pd_editor.scene.generation import (
    CAPABILITIES,
    MAX_SEED,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    TrafficSample,
)
from pd_editor.scene.guidance_terms import GuidanceTerm, PairGuidance
from pd_editor.scene.paths.lasting_tracks import lasting
from pd_editor.scene.scenario import Scenario

Preview = Callable[[], tuple[TrafficSample, ...]]

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
        placement_rules: Sequence[PlacementRule] = PLACEMENT_RULES,
        sampler: Sampler = sample_steps,
        initial_state_model: InitialStateDenoiser | None = None,
        trajectory_model: TrajectoryModel | None = None,
    ) -> None:
        """Make a generator; weights are read on first use.

        Placed agents that break one of ``placement_rules`` are sampled again. Both stages
        use the ``sampler``. A model, which is an ``nn.Module``, takes the place of the
        folder's, whose settings apply. What is not the folder's is named in provenance.

        Raises:
            GenerationError: a GPU is requested, and there is none; or a model is none.
        """
        for argument, given, kind in (
            ("initial_state_model", initial_state_model, InitialStateDenoiser),
            ("trajectory_model", trajectory_model, TrajectoryModel),
        ):
            # From Python 3.12 on, isinstance misses the sub-modules of an nn.Module.
            names = (n for n in {*kind.__annotations__, *vars(kind)} if n[0] != "_")
            if given is not None and not all(hasattr(given, one) for one in names):
                raise GenerationError(
                    f"{argument} is of type {type(given).__name__}; expected one with all "
                    f"members of {kind.__name__}."
                )
        self._folder, self._sampler = Path(folder), sampler
        models = (initial_state_model, cast("nn.Module | None", trajectory_model))
        names = (INITIAL_STATES.name, TRAJECTORIES.name)
        self._networks = {n: one for n, one in zip(names, models, strict=True) if one}
        own = [sampler] * (sampler is not sample_steps)
        own += map(type, self._networks.values())
        self._name = "+".join([name, *(getattr(one, "__name__", "own") for one in own)])
        self._rules = tuple(placement_rules)
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
                    loaded = load_model(self._folder, STAGE_KINDS)
                    self._model = loaded.with_networks(self._networks)
                    for name, stage in self._model.stages.items():
                        lay_out_weights(stage.model.to(self._device))
                        if name not in self._networks:
                            trace_steps(stage.model)
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
            notes=(*found.yielding_notes(), *found.notes, *request_notes(request)),
            measures=found.measures,
            slowed_ids=found.slowed_ids if any(found.slowed_ids) else (),
            guidance=found.reports,
        )

    def _initial_states(self) -> TrainedStage:
        return self.model().stage(INITIAL_STATES.name)

    def _trajectories(self) -> TrainedStage:
        return self.model().stage(TRAJECTORIES.name)

    def _sampled_states_and_trajectories(
        self, request: GenerationRequest
    ) -> Generator[GenerationProgress, None, Sampled]:
        stage = self._initial_states()
        model = stage.model
        assert isinstance(model, InitialStateDenoiser)
        request, far_notes = near_lanes(request)
        options = initial_state_options(request, stage, self._rules)
        options = replace(options, steps=self._sampler)
        # New agents that may be left out are not placed again.
        once = options if request.admits is None else replace(options, conflicts=None)
        count = request.num_samples
        asked = [requested_placings(stage, request, one) for one in range(count)]
        placings = {index: squares for index, (squares, _) in enumerate(asked)}
        samples: list[Sampled] = []
        placed: list[tuple[Scenario, tuple[str, ...]]] = []
        fits: list[tuple[int, int]] = []
        for first in range(0, count, _MOST_PLACED_TOGETHER):
            batch = range(first, min(first + _MOST_PLACED_TOGETHER, count))
            scenes = yield from place_in_squares(
                model,
                request.scenario,
                {index: placings[index] for index in batch},
                seed=request.scene_seed,
                options=once,
                generated_ids=request.agent_ids,
                progress=partial(_placing_progress, batch, count),
            )
            for number, (index, scenario) in enumerate(zip(batch, scenes, strict=True)):
                fitting, new_ids, driven = yield from self._driven_states(
                    request,
                    options,
                    scenario,
                    placings[index],
                    index,
                    partial(_driving_progress, batch, number, count),
                )
                placed.append((fitting, (*request.resampled_state_ids, *new_ids)))
                fits.append((len(new_ids), asked[index][1]))
                samples.append(driven)
        crowded = max(num_overlapping(scenario, ids) for scenario, ids in placed)
        notes = [
            *attribute_notes(placed, AttributeRequest.of(request)),
            *placement_notes(request, fits, crowded),
            *far_notes,
        ]
        return Sampled.joined(samples, notes)

    def _driven_states(
        self,
        request: GenerationRequest,
        options: InitialStateOptions,
        scenario: Scenario,
        squares: tuple[SquarePlacement, ...],
        index: int,
        progress: Callable[[float, Preview], DenoisingProgress],
    ) -> Generator[GenerationProgress, None, tuple[Scenario, tuple[str, ...], Sampled]]:
        """Trajectories from placed states, of which those in the way are placed again.

        Where a placed agent will drive is not known when states are sampled, so it may
        collide with a kept one later; new agents that still do are left out in the end.
        Returns the scenario with the states that were used, the new agents in it, and the
        trajectories.
        """
        model = self._initial_states().model
        assert isinstance(model, InitialStateDenoiser)
        wanted = tuple(name for one in squares for name in one.new_ids)
        if request.admits is not None:
            kept = KeptPaths.of(request.scenario, request.agent_ids)
            scenario = without_unfit(
                scenario, wanted, request.admits, options.conflicts, kept
            )
        clears = request.refines_states and yields(request)
        tries = _MOST_PLACINGS if clears and request.admits is None else 1
        best: _Placed | None = None
        for attempt in range(tries):
            if best is not None:
                (scenario,) = yield from place_in_squares(
                    model,
                    best.scenario,
                    {index: placed_again(squares, best.in_the_way)},
                    seed=(request.scene_seed + attempt * _SEED_STEP) % MAX_SEED,
                    options=options,
                    generated_ids=request.agent_ids + best.new_ids,
                    progress=lambda _share: progress(1.0, tuple),
                )
            found = yield from self._driven_once(
                request,
                scenario,
                tuple(name for name in wanted if name in scenario.agents.row_of),
                index,
                progress if best is None else lambda _share, one: progress(1.0, one),
            )
            if best is None or len(found.in_the_way) < len(best.in_the_way):
                best = found
            if not best.in_the_way:
                break
        assert best is not None
        if not clears:
            return best.scenario, best.new_ids, best.sampled
        fitting, new_ids = without_new(best.scenario, best.new_ids, best.in_the_way)
        gone = frozenset(best.new_ids).difference(new_ids)
        return fitting, new_ids, best.sampled.without(gone) if gone else best.sampled

    def _driven_once(
        self,
        request: GenerationRequest,
        scenario: Scenario,
        new_ids: tuple[str, ...],
        index: int,
        progress: Callable[[float, Preview], DenoisingProgress],
    ) -> Generator[GenerationProgress, None, "_Placed"]:
        """Trajectories from placed states, and who collides with kept agents."""
        if request.refines_states:
            scenario, new_ids = without_overlapping(scenario, new_ids)
        sampled = yield from self._sampled_trajectories(
            request,
            scenario,
            request.agent_ids + new_ids,
            range(index, index + 1),
            progress,
        )
        placed_ids = request.resampled_state_ids + new_ids
        return _Placed(
            scenario=scenario,
            new_ids=new_ids,
            sampled=sampled,
            in_the_way=colliding_with_kept(
                scenario, sampled.samples[0], placed_ids, new_ids
            ),
        )

    def _sampled_trajectories(
        self,
        request: GenerationRequest,
        scenario: Scenario,
        ids: tuple[str, ...],
        indices: range,
        progress: Callable[[float, Preview], DenoisingProgress],
    ) -> Generator[DenoisingProgress, None, Sampled]:
        stage = self._trajectories()
        model = cast("TrajectoryModel", stage.model)
        rows = scenario.agents.rows(ids)
        kept = {one.other_id for one in request.terms if isinstance(one, PairGuidance)}
        known = lasting(scenario, kept.difference(ids))
        task = self._task(known, rows, model, request.terms)
        options = replace(trajectory_options(request, stage), steps=self._sampler)
        if request.drift is not None:
            task = task.with_noise_of(request.drift.ids)
            task = task.with_waiting_at(options.sampler.waiting_mps)
        continuation = None
        if request.before_edit is not None:
            present = self._present_trajectories(request.before_edit, ids, model)
            continuation = present.continued(task, options)
        sampled = yield from sample_task(
            TrajectorySampling(model=model, task=task, options=options),
            indices,
            lambda share, predicted: progress(
                share, lambda: samples_of(task, rows, predicted())
            ),
            continuation,
        )
        is_yielding = yields(request)
        samples = [
            with_yielding(scenario, rows, one, request.terms)
            if is_yielding
            else (one, ())
            for one in samples_of(task, rows, sampled.motion)
        ]
        unguided = ()
        if sampled.unguided is not None:
            unguided = samples_of(task, rows, sampled.unguided)
        if is_yielding:
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
        return Sampled(
            samples=tuple(sample for sample, _ in samples),
            slowed_ids=tuple(slowed for _, slowed in samples),
            notes=(),
            measures=lane_measures(sampled.lane_distance_m),
            reports=reports,
        )

    def _task(
        self,
        scenario: Scenario,
        rows: Int[np.ndarray, "G"],
        model: TrajectoryModel,
        terms: tuple[GuidanceTerm, ...],
    ) -> TrajectoryTask:
        """The network's input, which edits of the guidance alone do not change."""
        newest, also = self._newest_task, guidance_looks_at(scenario, rows, terms)
        task = newest and newest.of_edited(scenario, rows, also)
        if task is None:
            task = TrajectoryTask.of(
                scenario,
                rows,
                model.decoder.basis,
                config=model.config,
                also=also,
            ).to(self._device)
        self._newest_task = task
        return task

    def _present_trajectories(
        self, scenario: Scenario, ids: tuple[str, ...], model: TrajectoryModel
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
class _Placed:
    """Placed states and the trajectories sampled from them."""

    scenario: Scenario
    new_ids: tuple[str, ...]
    sampled: Sampled
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
