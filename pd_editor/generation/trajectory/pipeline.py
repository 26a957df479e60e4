"""Pipeline of the second stage: samples trajectories, or encodes those that there are."""

from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float

from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.generation.core.noise_schedule import even_levels
from pd_editor.generation.core.sampler import Sampler, sample_steps
from pd_editor.generation.trajectory.guidance.nearest_candidate import (
    NearestCandidateGuide,
    TrajectoryGuidance,
)
from pd_editor.generation.trajectory.guidance.term_guide import (
    TermGuide,
    trajectory_terms,
)
from pd_editor.generation.trajectory.guidance.threat_run import (
    ThreatRun,
    ThreatScene,
    ThreatTerm,
    threats_in_force,
)
from pd_editor.generation.trajectory.guidance.trajectory_term import TermGuidance
from pd_editor.generation.trajectory.network.decoding import Motion
from pd_editor.generation.trajectory.sample_yielding import (
    TrajectoryChoices,
    select_jointly,
)
from pd_editor.generation.trajectory.sampler import (
    Continuation,
    GivenTrajectories,
    KnownNoise,
    SamplerStep,
    TrajectoryGuide,
    TrajectoryModel,
    TrajectoryNoise,
    TrajectorySamplerConfig,
    inverted_noise,
    sample_trajectories,
)
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.scenario import Scenario

_Progress = TypeVar("_Progress")


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions:
    """Options of the sampling of trajectories."""

    sampler: TrajectorySamplerConfig = field(default_factory=TrajectorySamplerConfig)
    steps: Sampler = sample_steps
    """The sampler itself."""
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
    drift: float | None = None
    """Place, in a roll-out, of the noise on its way from one seed to the next ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledTrajectories:
    """Motion of all A agents of the task; only that of sampled agents is meaningful."""

    motion: Motion
    lane_distance_m: float | None = None
    """Mean distance of guided agents to their nearest candidates; None without any."""
    unguided: Motion | None = None
    """The same samples without terms, if they were asked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectorySampling:
    """A denoiser, the task that it samples, and options."""

    model: TrajectoryModel
    task: TrajectoryTask
    options: TrajectoryOptions

    @cached_property
    def threats(self) -> tuple[Threaten, ...]:
        """Threats in force."""
        return threats_in_force(self.options.terms)

    @cached_property
    def num_tries(self) -> int:
        """Number of trajectories from which each one is selected."""
        # A threat is planned against one trajectory, so tries cannot be mixed.
        return 1 if self.threats else self.options.num_tries

    @cached_property
    def is_given(self) -> Bool[torch.Tensor, "1 A"]:
        """Agents whose trajectories are known."""
        scene = self.task.scene
        return torch.from_numpy(self.task.is_given)[None].to(scene.has_agent.device)

    @cached_property
    def keep(self) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Projection of latents to those of locked beginnings; None without any."""
        return self.task.keep(self.model.decoder.basis)

    def lane_guide(self, free: Sequence[int] = ()) -> NearestCandidateGuide:
        """Guide of the sampled agents to their candidates, except those at ``free``."""
        task, options = self.task, self.options
        wanted = task.is_sampled.copy()
        if options.lane_agent_ids:
            rows = task.scenario.agents.rows(options.lane_agent_ids)
            wanted &= np.isin(task.features.agent_row, rows)
        wanted[list(free)] = False
        guidance, is_warped = options.guidance, task.scenario.is_warped
        strength = guidance.warped_weight if is_warped else guidance.weight
        weight = torch.from_numpy(wanted * strength)[None].to(task.scene.agent_speed)
        return NearestCandidateGuide.of(
            self.model.decoder, task.scene, weight, guidance, options.sampler.num_steps
        )

    def term_guide(self, planned: tuple[ThreatTerm, ...] = ()) -> TermGuide | None:
        """Guide by the terms in force and planned threats; None if none applies."""
        task, options = self.task, self.options
        if not options.terms:
            return None
        context = task.term_context(options.term_guidance)
        terms = trajectory_terms(options.terms, context, avoids=options.avoids)
        if not terms and not planned:
            return None
        return TermGuide(
            motion=task.latent_motion(self.model.decoder),
            terms=terms + planned,
            config=options.term_guidance,
            last_level=even_levels(options.sampler.num_steps)[-1],
        )

    def steps(
        self,
        noise: TrajectoryNoise,
        guide: TrajectoryGuide | None,
        given: GivenTrajectories | None = None,
    ) -> Iterator[SamplerStep]:
        """Denoise samples; more agents than those of the task may be given."""
        is_given, latent = given or (False, self.task.scene.future)
        keep = self.keep

        def guided(clean: torch.Tensor, level: float) -> torch.Tensor:
            clean = clean if guide is None else guide(clean, level)
            return clean if keep is None else keep(clean)

        return sample_trajectories(
            self.model,
            self.task.scene,
            noise,
            GivenTrajectories(self.is_given | is_given, latent),
            config=self.options.sampler,
            sampler=self.options.steps,
            guide=guided,
            context=self.task.context(self.model),
        )

    def noise(
        self, numbers: Sequence[int], known: KnownNoise | None, num_tries: int = 1
    ) -> TrajectoryNoise:
        """Random numbers of samples."""
        drift, sampler = self.options.drift, self.options.sampler
        return TrajectoryNoise(
            samples=numbers,
            seed=self.options.seed,
            drift=drift or 0.0,
            mean_per_mps=0.0 if drift is None else sampler.noise_mean_per_mps,
            num_tries=num_tries,
            known=known,
            rows=self.task.kept_rows,
        )

    def threatened(
        self,
        latent: Float[torch.Tensor, "S 1 A 10"],
        numbers: Sequence[int],
        known_noise: KnownNoise | None,
    ) -> Iterator[Float[torch.Tensor, "S 1 A 10"]]:
        """Sample once more with threats to agents whose trajectories are then given.

        Yields predicted latents after each step; the last ones are the result.
        """
        task = self.task
        scene = ThreatScene(
            scenario=task.scenario,
            rows=task.features.agent_row,
            is_sampled=task.is_sampled,
            basis=self.model.decoder.basis,
        )
        first = latent[:, 0].double().cpu().numpy()
        run = ThreatRun.of(scene, self.threats, first, self.options.term_guidance)
        planned = run.terms(task.scene.agent_speed)
        if not planned:
            return
        attackers = [one.attacker for one in run.threats]
        guide = self.term_guide(planned)
        assert guide is not None, "there are terms"
        is_threatened = torch.from_numpy(run.is_given())[None].to(latent.device)
        given = torch.where(is_threatened[..., None], latent, task.scene.future)
        result = latent
        for step in self.steps(
            self.noise(numbers, known_noise),
            _joined(self.lane_guide(attackers), guide, len(numbers)),
            GivenTrajectories(is_threatened, given),
        ):
            result = step.clean
            yield result
        closed = guide.closed(result, self.keep)
        closed = torch.where(is_threatened[..., None], latent, closed)
        done = run.completed(closed[:, 0].double().cpu().numpy())
        result = closed.clone()
        result[:, 0, attackers] = torch.from_numpy(done[:, attackers]).to(result)
        yield result

    def motion(self, latent: Float[torch.Tensor, "S 1 A 10"]) -> Motion:
        """Decode the motion of all agents."""
        return self.task.motion(self.model.decoder.basis, latent)

    def selected(self, latent: Float[torch.Tensor, "S 1 A 10"]) -> list[Motion]:
        """Motion of each sample, selected among its tries so that few agents collide."""
        sampled, tries = self.motion(latent), self.num_tries
        return [
            _chosen(self.task, sampled, slice(first, first + tries))
            for first in range(0, len(latent), tries)
        ]


def sample_task(
    run: TrajectorySampling,
    samples: Sequence[int],
    progress: Callable[[float, Callable[[], Motion]], _Progress],
    continuation: Continuation | None = None,
) -> Generator[_Progress, None, SampledTrajectories]:
    """Sample the trajectories of a task.

    With a ``continuation``, the first try of the first sample deforms the present
    trajectories. Yields ``progress`` of the share that is done and of a function that
    returns the trajectories predicted so far.
    """
    options, tries = run.options, run.num_tries
    if not run.task.is_sampled.any():
        return SampledTrajectories(motion=run.task.no_motion(len(samples)))
    lanes, terms = run.lane_guide(), run.term_guide()
    compares = options.samples_unguided and terms is not None and continuation is None
    motions: list[Motion] = []
    unguided: list[Motion] = []
    distances: list[torch.Tensor] = []
    # Largest number of trajectories of an agent that are denoised together.
    at_once = max(1, 24 // (tries * (1 + compares)))
    for first in range(0, len(samples), at_once):
        chunk = samples[first : first + at_once]
        continues = continuation if first == 0 else None
        known_noise = None if continues is None else continues.known
        numbers = [sample * tries + t for sample in chunk for t in range(tries)]
        count = len(numbers)
        guide = _joined(lanes, terms, count)
        latent = None
        noise = run.noise(numbers * (1 + compares), known_noise, tries)
        for step in run.steps(noise, guide):
            latent = step.clean
            share = (step.index + 1) / step.num_steps * len(chunk)
            done = (first + share) / len(samples)
            yield progress(done, partial(run.motion, latent[:count:tries]))
        assert latent is not None, "there is at least one step"
        if continues is not None:
            latent = continues.corrected(latent, run.model.decoder)
        if terms is not None:
            closed = terms.closed(latent[:count], run.keep)
            latent = torch.cat([closed, latent[count:]])
        if run.threats:
            if options.samples_unguided and terms is None:
                # Without other terms, the first sampling is the unguided one.
                unguided += run.selected(latent)
            for again in run.threatened(latent[:count], numbers, known_noise):
                done = (first + len(chunk)) / len(samples)
                yield progress(done, partial(run.motion, again))
                latent = torch.cat([again, latent[count:]])
        distances.append(lanes.distances_m(latent[:count]))
        found = run.selected(latent)
        motions += found[: len(chunk)]
        unguided += found[len(chunk) :]
    distance = torch.cat(distances)
    return SampledTrajectories(
        motion=_stacked(motions),
        lane_distance_m=float(distance.mean()) if len(distance) else None,
        unguided=_stacked(unguided) if unguided else None,
    )


def sampled_from(
    run: TrajectorySampling, known_noise: KnownNoise
) -> Float[torch.Tensor, "1 A 10"]:
    """Latents of one sample from known noise, without a choice among several tries."""
    guide = _joined(run.lane_guide(), None, 1)
    *_, last = run.steps(run.noise([0], known_noise), guide)
    return last.clean[0]


def _stacked(motions: Sequence[Motion]) -> Motion:
    return Motion(
        position_m=np.stack([one.position_m[0] for one in motions]),
        heading_rad=np.stack([one.heading_rad[0] for one in motions]),
        velocity_mps=np.stack([one.velocity_mps[0] for one in motions]),
    )


def _joined(
    lane_guide: NearestCandidateGuide, terms: TermGuide | None, num_guided: int
) -> TrajectoryGuide | None:
    """Guide to the lanes, then by the terms, which apply to the first samples only."""
    lanes = lane_guide if bool(lane_guide.weight.any()) else None
    if terms is None:
        return lanes

    def guide(clean: torch.Tensor, level: float) -> torch.Tensor:
        if lanes is not None:
            clean = lanes(clean, level)
        guided = terms(clean[:num_guided], level)
        return torch.cat([guided, clean[num_guided:]])

    return guide


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


class PresentTrajectories:
    """Noise of the trajectories of a scenario, and samples from it.

    Both are computed once, for all continuations: the frames of a drag, and its result.
    """

    def __init__(
        self, model: TrajectoryModel, scenario: Scenario, agent_ids: tuple[str, ...]
    ) -> None:
        """Compute the noise of the agents' trajectories that are complete."""
        self.scenario, self.agent_ids = scenario, agent_ids
        self._model = model
        there = scenario.agents.row_of
        rows = [there[name] for name in agent_ids if name in there]
        task = TrajectoryTask.of(
            scenario,
            np.array(rows, int),
            model.decoder.basis,
            config=model.config,
        ).to(model.decoder.get_buffer("mean_m").device)
        self._task = task
        scene = task.scene
        is_given = torch.from_numpy(task.is_given)[None].to(scene.has_future.device)
        self._known = KnownNoise(
            noise=inverted_noise(model, scene, task.context(model), is_given),
            exists=scene.has_future & ~is_given,
        )
        self._samples: dict[TrajectoryOptions, torch.Tensor] = {}

    def continued(
        self, task: TrajectoryTask, options: TrajectoryOptions
    ) -> Continuation:
        """Noise and correction for the agents of another task."""
        reference = self._sample(options)
        exists = self._known.exists
        gap = torch.where(exists[..., None], self._task.scene.future - reference, 0.0)
        ids, agents = self._task.features.agent_row, self._task.scenario.agents
        place = {agents.ids[row]: index for index, row in enumerate(ids)}
        names = task.scenario.agents.ids
        found = [place.get(names[row], -1) for row in task.features.agent_row]
        index = torch.tensor(found, device=exists.device)
        is_same = (index >= 0) & torch.from_numpy(task.is_sampled).to(index.device)
        return Continuation(
            known=KnownNoise(
                noise=self._known.noise[:, index],
                exists=exists[:, index] & is_same,
            ),
            reference=reference[:, index],
            correction=torch.where(is_same[:, None], gap[:, index], 0.0),
        )

    def _sample(self, options: TrajectoryOptions) -> torch.Tensor:
        """The sample from the noise in the scenario itself, without guidance terms.

        Terms are what an edit may change, and a guided sample obeys those in force.
        """
        options = replace(options, num_tries=1, terms=(), samples_unguided=False)
        sample = self._samples.get(options)
        if sample is None:
            run = TrajectorySampling(
                model=self._model, task=self._task, options=options
            )
            sample = sampled_from(run, self._known)
            # Number of settings whose samples are kept.
            if len(self._samples) >= 4:
                self._samples.clear()
            self._samples[options] = sample
        return sample
