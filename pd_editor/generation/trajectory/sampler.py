"""Sampler of trajectory latents."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.core.config_limits import check_settings
from pd_editor.generation.core.noise_schedule import NoiseSchedule, even_levels
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import (
    Denoise,
    Sampler,
    SamplerConfig,
    SamplerStep,
    sample_steps,
    sampling_mode,
)
from pd_editor.generation.defaults import NUM_STEPS
from pd_editor.generation.features.encoded_scene import LATENT_SIZE
from pd_editor.generation.inputs.scene_batch import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.denoiser import TrajectoryConfig
from pd_editor.scene.thresholds import STANDING_MPS

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


@dataclass(frozen=True, kw_only=True)
class TrajectorySamplerConfig:
    """Settings of the sampling of trajectories."""

    num_steps: int = NUM_STEPS
    """Denoising steps."""
    eta: float = 0.0
    """Stochasticity: 0 adds no fresh noise (DDIM), 1 is ancestral sampling."""
    standing_noise: float = 1.0
    """Factor of the initial noise of stationary agents: a larger one makes more start."""

    def __post_init__(self) -> None:
        check_settings(self)


def sample_trajectories(
    model: TrajectoryModel,
    scene: SceneTensors,
    *,
    samples: Sequence[int],
    seed: int,
    drift: float = 0.0,
    num_tries: int = 1,
    is_given: Bool[Tensor, "B A"] | None = None,
    given: Float[Tensor, "*#S B A 10"] | None = None,
    config: TrajectorySamplerConfig | None = None,
    sampler: Sampler = sample_steps,
    guide: TrajectoryGuide | None = None,
    known_noise: KnownNoise | None = None,
    context: Any = None,
    keep: Callable[[Tensor], Tensor] | None = None,
    rows: tuple[int, Int[np.ndarray, "A"]] | None = None,
    num_gradient_steps: int = 0,
) -> Iterator[SamplerStep]:
    """Sample trajectories of all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not requesting the next one. The last step
    holds the result: latents [S, B, A, 10], those of given agents bit-identical. Sample k
    of a seed does not depend on the other samples, apart from rounding.

    Args:
        model: Denoiser in evaluation mode.
        scene: Scenes; only the trajectories of given agents are used.
        samples: Indices of the S samples.
        seed: Seed of all samples.
        drift: Place of the initial noise between that of the seed (0) and independent
            ones (1, 2, ...).
        num_tries: Number of consecutive samples that are tries of one.
        is_given: Given agents, whose latents are fixed; None: no agent.
        given: Latents of given agents, of all samples or of each one; None: those of
            the scene.
        config: Settings of the sampler.
        sampler: Takes the steps.
        guide: Changes the predicted clean latents of each step.
        known_noise: Initial noise of some agents in the first of the samples.
        context: The encoded scenes, if known already.
        keep: Moves them to those of locked beginnings, after the guide.
        rows: Number of agents of the whole scene, and which of them are here.
        num_gradient_steps: Number of last steps that are differentiable.
    """
    config = TrajectorySamplerConfig() if config is None else config
    streams = RandomStreams(seed, "futures", samples)
    if is_given is not None and not bool(is_given.any()):
        is_given = None
    has_gradient = True if num_gradient_steps else None
    num_rows = len(samples) * scene.has_agent.numel()
    with sampling_mode(num_rows, has_gradient=has_gradient):
        if context is None:
            context = model.encode_context(scene)
        levels = even_levels(config.num_steps)
        table = scene.future.new_tensor(levels)[:, None, None, None]
        if is_given is not None:
            table = torch.where(is_given, 0.0, table)
        denoised = model.at_levels(table, context)
        num_agents, kept = rows or (scene.has_agent.shape[1], slice(None))
        shape = len(scene.has_agent), num_agents, LATENT_SIZE
        noise = streams.drifted(drift, *shape, num_tries=num_tries)[:, :, kept]
        start = starting_latents(scene, noise, config.standing_noise)
        if known_noise is not None:
            noise, exists = known_noise
            start[:1] = torch.where(exists[..., None], noise, start[:1])

    known = scene.future if given is None else given.to(scene.future)

    def held(latent: Float[Tensor, "S B A 10"]) -> Float[Tensor, "S B A 10"]:
        if is_given is None:
            return latent
        return torch.where(is_given[..., None], known, latent)

    def denoise(noisy: Tensor, step: int) -> Tensor:
        clean = denoised(held(noisy), step)
        clean = clean if guide is None else guide(clean, levels[step])
        return held(clean if keep is None else keep(clean))

    return sampler(
        denoise,
        start,
        model.schedule,
        levels,
        SamplerConfig(eta=config.eta, num_gradient_steps=num_gradient_steps),
        lambda: streams.normal(*shape)[:, :, kept],
    )


def starting_latents(
    scene: SceneTensors, noise: Float[Tensor, "S B A 10"], standing_noise: float
) -> Float[Tensor, "S B A 10"]:
    """The initial noise, from a standard normal one."""
    stands = (scene.agent_speed < STANDING_MPS)[..., None]
    return noise.to(scene.future) * torch.where(stands, standing_noise, 1.0)
