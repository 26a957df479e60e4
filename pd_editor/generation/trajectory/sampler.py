"""Sampler of trajectory latents, and its inverse: the noise of given trajectories."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.core.noise_schedule import NoiseSchedule, even_levels
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import (
    Denoise,
    Sampler,
    SamplerConfig,
    SamplerStep,
    preparing_mode,
    sample_steps,
    sampling_mode,
)
from pd_editor.generation.defaults import NUM_STEPS, check_settings
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig

TrajectoryGuide = Callable[[Tensor, float], Tensor]
"""Changes predicted clean latents [S B A 10] at a noise level."""


@runtime_checkable
class TrajectoryModel(Protocol):
    """Denoiser of the latents of trajectories, of which ``TrajectoryDenoiser`` is one."""

    config: TrajectoryConfig
    """Agents that it sees (``num_near_agents``, ``num_blocks``), and candidates."""
    decoder: TrajectoryDecoder
    """Basis of the latents."""

    @property
    def schedule(self) -> NoiseSchedule:
        """Amplitudes of signal and noise."""
        ...

    def encode_context(self, scene: SceneTensors) -> Any:
        """What ``at_levels`` needs of B scenes; computed once for all samples."""
        ...

    def at_levels(self, levels: Float[Tensor, "T 1 #B #A"], context: Any) -> Denoise:
        """Function that predicts clean latents [S B A 10]; those at level 0 are given."""
        ...


class KnownNoise(NamedTuple):
    """Initial noise of agents of the first sample that is not random."""

    noise: Float[Tensor, "B A 10"]
    exists: Bool[Tensor, "B A"]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryNoise:
    """Random numbers of S samples, of which none depends on the others."""

    samples: Sequence[int]
    """Indices of the S samples."""
    seed: int
    """Seed of all samples."""
    drift: float = 0.0
    """Place of the initial noise between that of the seed (0) and independent ones
    (1, 2, ...)."""
    mean_per_mps: float = 0.0
    """Mean of the initial noise's first component for each m/s of an agent's speed."""
    num_tries: int = 1
    """Number of consecutive samples that are tries of one."""
    known: KnownNoise | None = None
    """Initial noise of some agents in the first of the samples."""
    rows: tuple[int, Int[np.ndarray, "A"]] | None = None
    """Number of agents of the whole scene, and which of them the batch has; None: all."""

    def drawn(
        self, scene: SceneTensors
    ) -> tuple[Float[Tensor, "S B A 10"], Callable[[], Float[Tensor, "S B A 10"]]]:
        """Initial noise, and what draws further noise for a step."""
        streams = RandomStreams(self.seed, "futures", self.samples)
        count, kept = self.rows or (scene.has_agent.shape[1], slice(None))
        shape = len(scene.has_agent), count, LATENT_SIZE
        noise = streams.drifted(self.drift, *shape, num_tries=self.num_tries)
        start = noise[:, :, kept].to(scene.future)
        start[..., 0] += self.mean_per_mps * scene.agent_speed
        if self.known is not None:
            noise, exists = self.known
            start[:1] = torch.where(exists[..., None], noise, start[:1])
        return start, lambda: streams.normal(*shape)[:, :, kept]


class GivenTrajectories(NamedTuple):
    """Agents whose latents are fixed."""

    is_given: Bool[Tensor, "#B A"]
    latent: Float[Tensor, "*#S B A 10"]
    """Latents of all samples or of each one; only those of given agents count."""


@dataclass(frozen=True, kw_only=True)
class TrajectorySamplerConfig:
    """Settings of the sampling of trajectories."""

    num_steps: int = NUM_STEPS
    """Denoising steps."""
    waiting_mps: float = 0.0
    """Least speed at which roll-outs show the network who waits in traffic. Simulated
    vehicles wait at exactly 0, recorded ones hardly ever."""
    noise_mean_per_mps: float = 0.0
    """Mean, in roll-outs, of the initial noise's first component, which is about how far
    an agent goes, for each m/s of its speed. At 0 traffic gets slower from window to window."""

    def __post_init__(self) -> None:
        check_settings(self)


def sample_trajectories(
    model: TrajectoryModel,
    scene: SceneTensors,
    noise: TrajectoryNoise,
    given: GivenTrajectories | None = None,
    *,
    config: TrajectorySamplerConfig | None = None,
    sampler: Sampler = sample_steps,
    guide: TrajectoryGuide | None = None,
    context: Any = None,
) -> Iterator[SamplerStep]:
    """Sample trajectories of all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not requesting the next one. The last step
    holds the result: latents [S, B, A, 10], those of given agents bit-identical.

    Args:
        model: Denoiser in evaluation mode.
        scene: Scenes, whose own trajectories are not used.
        noise: Random numbers of the samples.
        given: Agents that are not sampled; None: there are none.
        config: Settings of the sampler.
        sampler: Takes the steps.
        guide: Changes the predicted clean latents of each step.
        context: The encoded scenes, if known already.
    """
    config = TrajectorySamplerConfig() if config is None else config
    levels = even_levels(config.num_steps)
    if given is not None and not bool(given.is_given.any()):
        given = None

    with preparing_mode(len(noise.samples) * scene.has_agent.numel(), sampler):
        start, fresh_noise = noise.drawn(scene)
        table = scene.future.new_tensor(levels)[:, None, None, None]
        if given is not None:
            table = torch.where(given.is_given, 0.0, table)
        context = model.encode_context(scene) if context is None else context
        predict = model.at_levels(table, context)

    def held(latent: Float[Tensor, "S B A 10"]) -> Float[Tensor, "S B A 10"]:
        if given is None:
            return latent
        return torch.where(given.is_given[..., None], given.latent.to(latent), latent)

    def denoise(noisy: Tensor, step: int) -> Tensor:
        clean = predict(held(noisy), step)
        return held(clean if guide is None else guide(clean, levels[step]))

    return sampler(denoise, start, model.schedule, levels, SamplerConfig(), fresh_noise)


_NUM_STEPS: Final = 4
_NUM_ITERATIONS: Final = 2
"""Iterations per step. On 6 real scenarios the error is 1.7 m (root mean square over a
trajectory, moving agents), with 1 iteration 1.9 m and with 4 1.5 m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuation:
    """Noise of the present trajectories of one scene, and the inversion's error.

    The noise is computed by inverting the sampler (DDIM inversion: Song et al., Denoising
    diffusion implicit models, 2021, section 4.3; fixed-point form: Pan et al., Effective
    real image editing with accelerated iterative diffusion inversion, 2023). Samples of the
    edited scene from it deform the present trajectories. The error of the inversion is
    added as long as the sample is near the one of the scene before the edit, so that an
    edit without effect on an agent does not change its trajectory.
    """

    known: KnownNoise
    reference: Float[Tensor, "B A 10"]
    """Sample from this noise in the scene before the edit."""
    correction: Float[Tensor, "B A 10"]
    """Present latents minus ``reference``; 0 without noise."""

    def corrected(
        self, latent: Float[Tensor, "S B A 10"], decoder: TrajectoryDecoder
    ) -> Float[Tensor, "S B A 10"]:
        """Add the correction to the first sample."""
        scale = decoder.get_buffer("scale_m") / decoder.num_steps**0.5
        change = (latent[:1] - self.reference) * scale
        # Change of a sample at which the correction has faded to 37 %.
        share = torch.exp(-change.square().sum(dim=-1) / 4.0**2)
        first = torch.addcmul(latent[:1], share[..., None], self.correction)
        return torch.cat([first, latent[1:]])


def inverted_noise(
    model: TrajectoryModel,
    scene: SceneTensors,
    context: Any,
    is_given: Bool[Tensor, "B A"],
) -> Float[Tensor, "B A 10"]:
    """Noise from which deterministic sampling leads to the trajectories of ``scene``."""
    clean = scene.future
    schedule, levels = model.schedule, even_levels(_NUM_STEPS)
    with sampling_mode(scene.has_agent.numel()):
        table = clean.new_tensor(levels)[:, None, None, None]
        denoise = model.at_levels(torch.where(is_given, 0.0, table), context)
        edges = clean.new_tensor([*levels, 0.0])[:, None]
        alphas, sigmas = schedule.alpha(edges), schedule.sigma(edges)
        noisy = clean[None]
        for index in reversed(range(_NUM_STEPS)):
            alpha, sigma = alphas[index], sigmas[index]
            target, next_alpha, next_sigma = noisy, alphas[index + 1], sigmas[index + 1]
            noisy = torch.where(is_given[..., None], clean, alpha * target)
            for _ in range(_NUM_ITERATIONS):
                predicted = denoise(noisy, index)
                noise = (noisy - alpha * predicted) / sigma
                signal = (target - next_sigma * noise) / next_alpha
                found = alpha * signal + sigma * noise
                noisy = torch.where(is_given[..., None], clean, found)
    return noisy[0]
