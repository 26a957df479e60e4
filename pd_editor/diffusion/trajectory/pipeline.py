"""Pipeline of the second stage: samples trajectories of agents on a scenario."""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pd_editor.diffusion.core.noise_schedule import even_levels
from pd_editor.diffusion.core.sampler import sampling_mode
from pd_editor.diffusion.inputs.scene_batch import SceneTensors, batch_of
from pd_editor.diffusion.inputs.trajectory_pca import TrajectoryBasis
from pd_editor.diffusion.trajectory.continuation import Continuation
from pd_editor.diffusion.trajectory.guidance.latent_motion import (
    KnownMotion,
    LatentMotion,
)
from pd_editor.diffusion.trajectory.guidance.nearest_candidate import (
    NearestCandidateGuide,
    TrajectoryGuidance,
)
from pd_editor.diffusion.trajectory.guidance.term_guidance import TermGuidance
from pd_editor.diffusion.trajectory.guidance.term_guide import TermGuide
from pd_editor.diffusion.trajectory.guidance.term_table import trajectory_terms
from pd_editor.diffusion.trajectory.guidance.threat_run import (
    ThreatRun,
    ThreatScene,
    ThreatTerm,
    threats_in_force,
)
from pd_editor.diffusion.trajectory.guidance.trajectory_term import TermContext
from pd_editor.diffusion.trajectory.joint_selection import (
    TrajectoryChoices,
    select_jointly,
)
from pd_editor.diffusion.trajectory.kept_beginning import KeptBeginning, projected
from pd_editor.diffusion.trajectory.network.context import TrajectoryContext
from pd_editor.diffusion.trajectory.network.decoding import (
    Motion,
    TrajectoryDecoder,
    motion_of,
)
from pd_editor.diffusion.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory.sampler import (
    KnownNoise,
    TrajectoryGuide,
    TrajectorySamplerConfig,
    sample_trajectories,
)
from pd_editor.features.encoded_scene import packed
from pd_editor.features.scene_features import (
    NUM_FUTURE_STEPS,
    STEP_S,
    SceneFeatures,
    scene_features,
)
from pd_editor.scene.guidance_terms import GuidanceTerm, Threaten
from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

_LEAST_KNOWN_STEPS: Final = 10
"""A context agent with fewer future steps is sampled like the others, and kept."""
_LATE_S: Final = 4.0
"""Agents that enter within this time are given, extended back to the current step."""
_SAME_STEP_S: Final = 1e-6
_MOST_AT_ONCE: Final = 24
"""Largest number of trajectories of an agent that are denoised together."""


_Progress = TypeVar("_Progress")


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions:
    """Options of the sampling of trajectories."""

    sampler: TrajectorySamplerConfig = field(default_factory=TrajectorySamplerConfig)
    guidance: TrajectoryGuidance = field(default_factory=TrajectoryGuidance)
    lane_agent_ids: tuple[str, ...] = ()
    """Agents that are guided to their candidates; empty means all."""
    terms: tuple[GuidanceTerm, ...] = ()
    """What the user asks of trajectories."""
    term_guidance: TermGuidance = field(default_factory=TermGuidance)
    avoids: bool = True
    """Whether agents that are led somewhere avoid collisions."""
    samples_unguided: bool = False
    """Whether each sample is also made without the terms, from the same noise."""
    num_tries: int = 1
    """Trajectories sampled per sample, from which the least colliding ones are selected."""
    seed: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryTask:
    """A scenario as the network's input; G rows of it are sampled."""

    scenario: Scenario
    features: SceneFeatures
    scene: SceneTensors
    is_given: Bool[np.ndarray, "A"]
    is_sampled: Bool[np.ndarray, "A"]
    late: Int[np.ndarray, "L"]
    """Rows of the scenario's agents that enter later and are to be avoided."""
    kept: KeptBeginning
    _contexts: dict[TrajectoryDenoiser, TrajectoryContext] = field(
        default_factory=dict, repr=False
    )

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        rows: Int[np.ndarray, "G"],
        basis: TrajectoryBasis,
        *,
        knows_leaders: bool = True,
    ) -> "TrajectoryTask":
        """Make a task of all road users at the current step and those that enter soon.

        Agents that are not sampled are given if their trajectories are known. With
        ``knows_leaders`` some candidates follow the agent ahead.
        """
        late = LateAgents.of(scenario).but_continuing(rows)
        known = _with_late_agents(scenario, late)
        features = scene_features(known, knows_leaders=knows_leaders)
        scene = _without_gaps(batch_of([packed(features, basis.encode)]))
        is_sampled = np.isin(features.agent_row, rows)
        is_given = ~is_sampled & features.has_future
        partly = np.flatnonzero(~is_sampled & ~is_given)
        latent, is_known = _completed(known, features, partly, basis)
        scene.future[0, partly[is_known]] = torch.from_numpy(latent).float()
        is_given[partly[is_known]] = True
        return cls(
            scenario=scenario,
            features=features,
            scene=scene,
            is_given=is_given,
            is_sampled=is_sampled,
            late=late.row,
            kept=KeptBeginning.of(scenario, features.agent_row, is_sampled),
        )

    def of_edited(
        self, scenario: Scenario, rows: Int[np.ndarray, "G"]
    ) -> "TrajectoryTask | None":
        """The same task of a scenario whose guidance alone differs, else None."""
        mine = self.scenario
        names = ("road_map", "agents", "time_axis", "applied_warp", "locks")
        is_same = all(getattr(mine, one) is getattr(scenario, one) for one in names)
        is_same = is_same and mine.focal_id == scenario.focal_id
        sampled = self.features.agent_row[self.is_sampled]
        if not is_same or not np.array_equal(sampled, np.sort(rows)):
            return None
        return replace(self, scenario=scenario)

    def context(self, model: TrajectoryDenoiser) -> TrajectoryContext:
        """The encoded scene, computed once."""
        context = self._contexts.get(model)
        if context is None:
            with sampling_mode(self.scene.has_agent.numel()):
                context = self._contexts[model] = model.encode_context(self.scene)
        return context

    def to(self, device: torch.device) -> "TrajectoryTask":
        """Move the tensors to a device."""
        return replace(self, scene=self.scene.to(device), _contexts={})

    def term_context(self, config: TermGuidance) -> TermContext:
        """What guidance terms are made from."""
        agents, now = self.scenario.agents, self.scenario.current_step
        rows = self.features.agent_row
        return TermContext(
            scenario=self.scenario,
            config=config,
            ids=tuple(agents.ids[row] for row in rows),
            kinds=tuple(agents.kinds[row] for row in rows),
            is_sampled=self.is_sampled,
            is_standing=agents.speed_mps()[rows, now] < STANDING_MPS,
            like=self.scene.agent_speed,
            duration_s=NUM_FUTURE_STEPS * STEP_S,
        )

    def latent_motion(self, decoder: TrajectoryDecoder) -> LatentMotion:
        """Motion of all A agents as a function of latents, in the scene frame."""
        agents, axis = self.scenario.agents, self.scenario.time_axis
        now, rows = self.scenario.current_step, self.features.agent_row
        like = self.scene.agent_speed

        def tensor(values: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(values).to(like)

        count = decoder.num_steps
        steps = slice(now, now + count + 1)
        exists = agents.is_valid[rows, steps]
        missing = [(0, 0), (0, count + 1 - exists.shape[1])]
        # Recorded positions are at the model's steps only on the same time axis.
        same = abs(axis.step_s - STEP_S) < _SAME_STEP_S
        is_known = np.pad(exists & ~self.is_sampled[:, None], missing) & same
        pairs = [*missing, (0, 0)]
        return LatentMotion.of(
            decoder,
            num_steps=count,
            origin_m=tensor(agents.position_m[rows, now]),
            heading_rad=tensor(agents.heading_rad[rows, now]),
            speed_mps=tensor(agents.speed_mps()[rows, now]),
            size_m=tensor(agents.size_m[rows]),
            is_sampled=torch.from_numpy(self.is_sampled).to(like.device),
            known=KnownMotion(
                position_m=tensor(np.pad(agents.position_m[rows, steps], pairs)),
                velocity_mps=tensor(np.pad(agents.velocity_mps[rows, steps], pairs)),
                heading_rad=tensor(np.pad(agents.heading_rad[rows, steps], missing)),
                exists=torch.from_numpy(is_known | self.is_sampled[:, None]).to(
                    like.device
                ),
                is_known=torch.from_numpy(is_known).to(like.device),
            ),
        )

    def no_motion(self, num_samples: int) -> Motion:
        """Zero motion, if no agent is sampled."""
        steps = self.scenario.time_axis.num_future_steps + 1
        shape = (num_samples, len(self.features.agent_row), steps)
        return Motion(
            position_m=np.zeros((*shape, 2)),
            heading_rad=np.zeros(shape),
            velocity_mps=np.zeros((*shape, 2)),
        )

    def motion(
        self, basis: TrajectoryBasis, latent: Float[torch.Tensor, "S 1 A 10"]
    ) -> Motion:
        """Decode the motion of all A agents of the features."""
        agents, now = self.scenario.agents, self.scenario.current_step
        rows = self.features.agent_row
        return self.kept.joined(
            motion_of(
                basis,
                latent[:, 0].double().cpu().numpy(),
                agents.position_m[rows, now],
                agents.heading_rad[rows, now],
                agents.velocity_mps[rows, now],
                self.scenario.time_axis,
            )
        )

    def keep(
        self, basis: TrajectoryBasis
    ) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Projection of latents to those of locked beginnings; None without any."""
        if not len(self.kept):
            return None
        tables = self.kept.projection(basis, self.scene.has_agent.shape[1])
        matrix, offset = (
            torch.from_numpy(one)[None].to(self.scene.future) for one in tables
        )
        return lambda latent: projected(latent, matrix, offset)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledTrajectories:
    """Motion of all A agents of the task; only that of sampled agents is meaningful."""

    motion: Motion
    lane_cost_m: tuple[float, float]
    """Mean distance to the nearest candidate before and after the last guided step."""
    unguided: Motion | None = None
    """The same samples without terms, if they were asked for."""


def sample_task(
    model: TrajectoryDenoiser,
    task: TrajectoryTask,
    samples: Sequence[int],
    options: TrajectoryOptions,
    progress: Callable[[float, Callable[[], Motion]], _Progress],
    continuation: Continuation | None = None,
) -> Generator[_Progress, None, SampledTrajectories]:
    """Sample the trajectories of a task.

    With a ``continuation``, the first try of the first sample deforms the present
    trajectories. Yields ``progress`` of the share that is done and of a function that returns the
    trajectories predicted so far.
    """
    if not task.is_sampled.any():
        return SampledTrajectories(
            motion=task.no_motion(len(samples)), lane_cost_m=(0.0, 0.0)
        )
    basis = model.decoder.basis
    threats = threats_in_force(options.terms)
    # A threat is planned against one trajectory, so tries cannot be mixed.
    tries = 1 if threats else options.num_tries
    pull = _pull(task, options)
    guide = NearestCandidateGuide.of(
        model, task.scene, pull, options.guidance, options.sampler.num_steps
    )
    keep = task.keep(basis)
    term_guide = _term_guide(model, task, options)
    compares = term_guide is not None and options.samples_unguided
    if continuation is not None:
        compares = False
    motions: list[Motion] = []
    unguided: list[Motion] = []
    at_once = max(1, _MOST_AT_ONCE // (tries * (1 + compares)))
    for first in range(0, len(samples), at_once):
        chunk = samples[first : first + at_once]
        continues = continuation if first == 0 else None
        numbers = [sample * tries + t for sample in chunk for t in range(tries)]
        steps = sample_trajectories(
            model,
            task.scene,
            samples=numbers * (1 + compares),
            seed=options.seed,
            is_given=torch.from_numpy(task.is_given)[None].to(
                task.scene.has_agent.device
            ),
            num_tries=tries,
            config=options.sampler,
            context=task.context(model),
            guide=_joined(
                guide if bool(pull.any()) else None, term_guide, len(numbers)
            ),
            known_noise=None if continues is None else continues.known,
            keep=keep,
        )
        latent = None
        for step in steps:
            latent = step.clean
            share = (step.index + 1) / step.num_steps * len(chunk)
            predicted = latent[: len(numbers) : tries]
            yield progress(
                (first + share) / len(samples),
                lambda predicted=predicted: task.motion(basis, predicted),
            )
        assert latent is not None, "there is at least one step"
        if continues is not None:
            latent = continues.corrected(latent, model.decoder)
        if term_guide is not None:
            count = len(numbers)
            closed = term_guide.closed(latent[:count], keep)
            latent = torch.cat([closed, latent[count:]])
        if threats:
            if not compares and options.samples_unguided and term_guide is None:
                # Without other terms, the first sampling is the unguided one.
                unguided.extend(
                    _chosen(task, task.motion(basis, latent), slice(index, index + 1))
                    for index in range(len(chunk))
                )
            second = _threatened(
                model,
                task,
                options,
                threats,
                latent[: len(numbers)],
                numbers,
                continues,
            )
            for step in second:
                yield progress(
                    (first + len(chunk)) / len(samples),
                    lambda step=step: task.motion(basis, step),
                )
                latent = torch.cat([step, latent[len(numbers) :]])
        sampled = task.motion(basis, latent)
        for index in range(len(chunk) * (1 + compares)):
            part = slice(index * tries, (index + 1) * tries)
            found = motions if index < len(chunk) else unguided
            found.append(_chosen(task, sampled, part))
    return SampledTrajectories(
        motion=_stacked(motions),
        lane_cost_m=guide.cost_m(),
        unguided=_stacked(unguided) if unguided else None,
    )


def _stacked(motions: Sequence[Motion]) -> Motion:
    return Motion(
        position_m=np.stack([one.position_m[0] for one in motions]),
        heading_rad=np.stack([one.heading_rad[0] for one in motions]),
        velocity_mps=np.stack([one.velocity_mps[0] for one in motions]),
    )


def _joined(
    lanes: TrajectoryGuide | None, terms: TrajectoryGuide | None, num_guided: int
) -> TrajectoryGuide | None:
    """Guide to the lanes, then by the terms, which apply to the first samples only."""
    if terms is None:
        return lanes

    def guide(clean: torch.Tensor, level: float) -> torch.Tensor:
        if lanes is not None:
            clean = lanes(clean, level)
        guided = terms(clean[:num_guided], level)
        return torch.cat([guided, clean[num_guided:]])

    return guide


def _term_guide(
    model: TrajectoryDenoiser,
    task: TrajectoryTask,
    options: TrajectoryOptions,
    planned: tuple[ThreatTerm, ...] = (),
) -> TermGuide | None:
    """Guide by the terms in force and planned threats; None if none applies."""
    if not options.terms:
        return None
    context = task.term_context(options.term_guidance)
    terms = trajectory_terms(options.terms, context, avoids=options.avoids) + planned
    if not terms:
        return None
    return TermGuide(
        motion=task.latent_motion(model.decoder),
        terms=terms,
        config=options.term_guidance,
        last_level=even_levels(options.sampler.num_steps)[-1],
    )


def _threatened(
    model: TrajectoryDenoiser,
    task: TrajectoryTask,
    options: TrajectoryOptions,
    threats: Sequence[Threaten],
    latent: Float[torch.Tensor, "S 1 A 10"],
    numbers: Sequence[int],
    continuation: Continuation | None,
) -> Iterator[Float[torch.Tensor, "S 1 A 10"]]:
    """Sample once more with threats to agents whose trajectories are then given.

    Yields predicted latents after each step; the last ones are the result.
    """
    basis = model.decoder.basis
    scene = ThreatScene(
        scenario=task.scenario,
        rows=task.features.agent_row,
        is_sampled=task.is_sampled,
        basis=basis,
    )
    run = ThreatRun.of(
        scene, threats, latent[:, 0].double().cpu().numpy(), options.term_guidance
    )
    planned = run.terms(task.scene.agent_speed)
    if not planned:
        return
    device = latent.device
    is_threatened = torch.from_numpy(run.is_given())[None].to(device)
    pull = _pull(task, options)
    pull[:, [one.attacker for one in run.threats]] = 0.0
    lanes = NearestCandidateGuide.of(
        model, task.scene, pull, options.guidance, options.sampler.num_steps
    )
    guide = _term_guide(model, task, options, planned)
    assert guide is not None, "there are terms"
    keep = task.keep(basis)
    steps = sample_trajectories(
        model,
        task.scene,
        samples=numbers,
        seed=options.seed,
        is_given=torch.from_numpy(task.is_given)[None].to(device) | is_threatened,
        given=torch.where(is_threatened[..., None], latent, task.scene.future),
        config=options.sampler,
        guide=_joined(lanes if bool(pull.any()) else None, guide, len(numbers)),
        known_noise=None if continuation is None else continuation.known,
        keep=keep,
    )
    result = latent
    for step in steps:
        result = step.clean
        yield result
    closed = torch.where(is_threatened[..., None], latent, guide.closed(result, keep))
    done = run.completed(closed[:, 0].double().cpu().numpy())
    attackers = [one.attacker for one in run.threats]
    result = closed.clone()
    result[:, 0, attackers] = torch.from_numpy(done[:, attackers]).to(result)
    yield result


def sampled_from(
    model: TrajectoryDenoiser,
    task: TrajectoryTask,
    known_noise: KnownNoise,
    options: TrajectoryOptions,
) -> Float[torch.Tensor, "1 A 10"]:
    """Latents of one sample from known noise, without a choice among several tries."""
    pull = _pull(task, options)
    guide = NearestCandidateGuide.of(
        model, task.scene, pull, options.guidance, options.sampler.num_steps
    )
    steps = sample_trajectories(
        model,
        task.scene,
        samples=[0],
        seed=options.seed,
        is_given=torch.from_numpy(task.is_given)[None].to(task.scene.has_agent.device),
        config=options.sampler,
        context=task.context(model),
        guide=guide if bool(pull.any()) else None,
        known_noise=known_noise,
        keep=task.keep(model.decoder.basis),
    )
    *_, last = steps
    return last.clean[0]


def _without_gaps(scene: SceneTensors) -> SceneTensors:
    """Remove candidate slots that no agent uses."""
    most = int(scene.has_candidate.sum(dim=-1).max()) if scene.has_agent.any() else 0
    return replace(
        scene,
        candidates=scene.candidates[:, :, :most],
        has_candidate=scene.has_candidate[:, :, :most],
    )


def _pull(
    task: TrajectoryTask, options: TrajectoryOptions
) -> Float[torch.Tensor, "1 A"]:
    wanted = task.is_sampled.copy()
    if options.lane_agent_ids:
        rows = task.scenario.agents.rows(options.lane_agent_ids)
        wanted &= np.isin(task.features.agent_row, rows)
    guidance = options.guidance
    strength = guidance.warped_weight if task.scenario.is_warped else guidance.weight
    weight = torch.from_numpy(wanted * strength)[None]
    return weight.to(task.scene.agent_speed)


def _chosen(task: TrajectoryTask, sampled: Motion, part: slice) -> Motion:
    """Joint selection among several tries, so that few agents collide."""
    position, heading = sampled.position_m[part], sampled.heading_rad[part]
    velocity = sampled.velocity_mps[part]
    choice = np.zeros(position.shape[1], int)
    if len(position) > 1:
        choices, is_sampled = _with_the_rest(task, position, heading)
        choice = select_jointly(choices, is_sampled)[: len(choice)]
    agent = np.arange(len(choice))
    return Motion(
        position_m=position[choice, agent][None],
        heading_rad=heading[choice, agent][None],
        velocity_mps=velocity[choice, agent][None],
    )


def _with_the_rest(
    task: TrajectoryTask,
    position: Float[np.ndarray, "K A S 2"],
    heading: Float[np.ndarray, "K A S"],
) -> tuple[TrajectoryChoices, Bool[np.ndarray, "B"]]:
    """Choices of sampled agents, then all other agents as recorded."""
    agents, now = task.scenario.agents, task.scenario.current_step
    rows, is_sampled = task.features.agent_row, task.is_sampled
    rest = np.setdiff1d(np.arange(len(agents)), rows[is_sampled])
    rest = rest[agents.is_valid[rest, now] | np.isin(rest, task.late)]
    shape = (len(position), len(rest), *position.shape[2:])
    return TrajectoryChoices(
        position_m=np.concatenate(
            [position, np.broadcast_to(agents.position_m[rest, now:], shape)], axis=1
        ),
        heading_rad=np.concatenate(
            [heading, np.broadcast_to(agents.heading_rad[rest, now:], shape[:3])],
            axis=1,
        ),
        exists=np.concatenate(
            [
                np.broadcast_to(is_sampled[:, None], position.shape[1:3]),
                agents.is_valid[rest, now:],
            ]
        ),
        size_m=np.concatenate([agents.size_m[rows], agents.size_m[rest]]),
    ), np.concatenate([is_sampled, np.zeros(len(rest), bool)])


def _with_late_agents(scenario: Scenario, late: LateAgents) -> Scenario:
    """The scenario in which late agents that are seen soon enough exist from now on."""
    axis = scenario.time_axis
    soon = late.entering_by(axis.current_step + round(_LATE_S / axis.step_s))
    if not len(soon.row):
        return scenario
    return replace(scenario, agents=soon.extended_backwards(scenario))


def _completed(
    scenario: Scenario,
    features: SceneFeatures,
    partly: Int[np.ndarray, "N"],
    basis: TrajectoryBasis,
) -> tuple[Float[np.ndarray, "M 10"], Bool[np.ndarray, "N"]]:
    """Latents of context agents with partly known trajectories, and their mask."""
    agents, axis = scenario.agents, scenario.time_axis
    is_known = np.zeros(len(partly), bool)
    if abs(axis.step_s - basis.step_s) > 1e-6 or not len(partly):
        return np.zeros((0, 10)), is_known
    now, rows = scenario.current_step, features.agent_row[partly]
    steps = slice(now + 1, now + 1 + basis.num_steps)
    exists = agents.is_valid[rows, steps]
    exists = exists & np.isfinite(agents.position_m[rows, steps]).all(axis=-1)
    is_known = exists.sum(axis=1) >= _LEAST_KNOWN_STEPS
    rows, exists = rows[is_known], exists[is_known]
    gap = agents.position_m[rows, steps] - agents.position_m[rows, now][:, None]
    turn = np.exp(-1j * agents.heading_rad[rows, now])[:, None]
    gap = np.where(exists[..., None], gap, 0.0)
    local = (gap[..., 0] + 1j * gap[..., 1]) * turn
    future = np.zeros((len(rows), basis.num_steps, 2))
    future[:, : local.shape[1]] = np.stack([local.real, local.imag], axis=-1)
    valid = np.zeros(future.shape[:2], bool)
    valid[:, : exists.shape[1]] = exists
    speed = np.asarray(features.agent_speed[partly][is_known], float)
    return basis.completed(future, valid, speed), is_known
