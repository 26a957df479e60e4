"""Drawing futures: from noise to latents of futures."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.core.drawing_steps import drawing_steps
from pd_editor.diffusion.core.random_streams import RandomStreams
from pd_editor.diffusion.core.sampler import ddim, levels_of
from pd_editor.diffusion.defaults import NUM_STEPS
from pd_editor.diffusion.fused.folded_denoiser import FoldedDenoiser
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.trajectory.denoiser import TrajectoryDenoiser
from pd_editor.diffusion.trajectory.features import STANDING_MPS

_STANDING_SPREAD: Final = 1.08
"""Of the noise of standing agents: with it 14.4 % come to be more than 2 m away, 11.1
without; 14.6 recorded (``train``)."""

TrajectoryGuide = Callable[[Tensor, float], Tensor]
"""From believed clean latents [S B A 10] and the share of steps done to better ones."""


@dataclass(frozen=True, kw_only=True)
class TrajectorySamplerConfig:
    """How futures are drawn."""

    num_steps: int = NUM_STEPS
    fresh_noise: float = 0.0
    """Share of the noise that is drawn anew at each step: 0 none, 1 ancestral."""
    num_tries: int = 1
    """So many consecutive samples are tries of one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrajectoryStep:
    """What is known after a step."""

    index: int
    num_steps: int
    latent: Float[Tensor, "S B A 10"]
    """Futures believed in."""


def sample_trajectories(
    model: TrajectoryDenoiser | FoldedDenoiser,
    scene: SceneTensors,
    *,
    samples: Sequence[int],
    seed: int,
    is_given: Bool[Tensor, "B A"] | None = None,
    config: TrajectorySamplerConfig | None = None,
    guide: TrajectoryGuide | None = None,
) -> Generator[TrajectoryStep, None, Float[Tensor, "S B A 10"]]:
    """Draw futures of all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not asking for the next one. Sample k
    of a seed is the same alone and among others, but for float rounding.

    Args:
        model: In evaluation mode; who draws often gives it folded.
        scene: Futures are read of given agents only.
        samples: Indices of the S samples to draw.
        seed: Of all samples.
        is_given: Agents whose future latents stay as they are; None: nobody.
        config: Steps and noise.
        guide: Changes the believed clean latents of each step.

    Returns:
        Latents [S, B, A, 10]; those of given agents are bit-identical.
    """
    network = model if isinstance(model, FoldedDenoiser) else FoldedDenoiser(model)
    given = torch.zeros_like(scene.has_agent) if is_given is None else is_given
    config = TrajectorySamplerConfig() if config is None else config
    streams = RandomStreams(seed, "futures", samples)
    steps = _steps(network, scene, streams, given, config, guide)
    return drawing_steps(steps, len(samples) * scene.has_agent.numel())


def _steps(
    network: FoldedDenoiser,
    scene: SceneTensors,
    streams: RandomStreams,
    given: Bool[Tensor, "B A"],
    config: TrajectorySamplerConfig,
    guide: TrajectoryGuide | None,
) -> Generator[TrajectoryStep, None, Float[Tensor, "S B A 10"]]:
    levels = levels_of(config.num_steps)
    context = network.context(scene)
    start = starting_latents(scene, streams, config.num_tries)
    drawing = network.drawing(context, given, levels[:-1], len(start))
    latent = start
    done = 0
    is_anybody_given = bool(given.any())

    def held(latent: Tensor) -> Tensor:
        if not is_anybody_given:
            return latent
        return torch.where(given[..., None], scene.future, latent)

    def denoise(noisy: Tensor, _: float) -> Tensor:
        clean = drawing.denoise(held(noisy), done)
        if guide is not None:
            clean = guide(clean, done / config.num_steps)
        return held(clean)

    steps = ddim(
        denoise,
        start,
        network.model.schedule,
        levels,
        eta=config.fresh_noise,
        streams=streams,
    )
    for step in steps:
        latent, done = step.clean, step.index + 1
        yield TrajectoryStep(index=step.index, num_steps=step.num_steps, latent=latent)
    return latent


def starting_latents(
    scene: SceneTensors, streams: RandomStreams, num_tries: int
) -> Float[Tensor, "S B A 10"]:
    """The noise that denoising begins with."""
    noise = streams.spread_normal(*scene.future.shape, num_tries=num_tries)
    stands = (scene.agent_speed < STANDING_MPS)[..., None]
    return noise.to(scene.future) * torch.where(stands, _STANDING_SPREAD, 1.0)
