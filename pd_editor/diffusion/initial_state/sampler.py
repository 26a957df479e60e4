"""Drawing initial states: from noise to poses, one scale after another."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.core.drawing_steps import drawing_steps
from pd_editor.diffusion.core.random_streams import RandomStreams
from pd_editor.diffusion.fused.folded_pose_denoiser import FoldedPoseDenoiser
from pd_editor.diffusion.initial_state.conditioning import PoseTask, drawing_task
from pd_editor.diffusion.initial_state.denoiser import PoseDenoiser
from pd_editor.diffusion.initial_state.noise import (
    first_noise,
    noise_scale,
    sampling_levels,
)
from pd_editor.diffusion.initial_state.state_encoding import (
    POSITION_UNIT_M,
    decode_states,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors

NUM_STEPS: Final = 10
"""Default number of calls of the network. With 7, and earlier weights, 13.3 instead of
11.9 % were off the road, and the distance of speeds from recorded ones was .103 instead
of .078; 12 are no better but in who is off the road (``train``)."""

PoseGuide = Callable[[Tensor, float], Tensor]
"""From believed clean states [S B A 5], encoded, and the level, to better ones."""


@dataclass(frozen=True, kw_only=True)
class PoseSamplerConfig:
    """How states are drawn."""

    num_steps: int = NUM_STEPS
    fresh_noise: float = 1.0
    """Share of the noise that is drawn anew at each step: 0 none, 1 ancestral.

    Without, errors of early steps stay: 22 instead of 14 % came to be off the road.
    """
    speed_spread: float = 1.15
    """Factor of that noise for speeds, which the network blurs: at 1 the median of those
    who move is 6.1 m/s, 6.9 with it, 7.8 recorded (``train``)."""
    is_second_order: bool = True
    """Extrapolate the clean states from the last two steps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseStep:
    """What is known after a step."""

    index: int
    num_steps: int
    states: Float[Tensor, "S B A 5"]
    """x and y in metres, cos, sin, speed in m/s: as ``sample_states`` returns them."""


def sample_states(
    model: PoseDenoiser | FoldedPoseDenoiser,
    scene: SceneTensors,
    *,
    samples: Sequence[int],
    seed: int,
    task: PoseTask | None = None,
    config: PoseSamplerConfig | None = None,
    guide: PoseGuide | None = None,
) -> Generator[PoseStep, None, Float[Tensor, "S B A 5"]]:
    """Draw initial states for all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not asking for the next one. Sample k
    of a seed is the same alone and among others, but for float rounding.

    Args:
        model: in evaluation mode; who draws often gives it folded.
        scene: its pieces, and of its agents kind, size and ``has_agent``; poses and
            speeds are read of given agents only.
        samples: indices of the S samples to draw.
        seed: of all samples.
        task: who is given, and the square; None draws everybody in the whole square.
        config: steps and noise.
        guide: changes the believed clean states of each step.

    Returns:
        States [S, B, A, 5]: x and y in metres around the middle of the scene, cosine
        and sine of the heading, speed in m/s. Given agents come out bit-identical.
    """
    config = PoseSamplerConfig() if config is None else config
    task = drawing_task(scene) if task is None else task
    streams = RandomStreams(seed, "states", samples)
    network = (
        model if isinstance(model, FoldedPoseDenoiser) else FoldedPoseDenoiser(model)
    )
    steps = _steps(network, scene, streams, task, config, guide)
    return drawing_steps(steps, len(samples) * scene.has_agent.numel())


def _steps(
    network: FoldedPoseDenoiser,
    scene: SceneTensors,
    streams: RandomStreams,
    task: PoseTask,
    config: PoseSamplerConfig,
    guide: PoseGuide | None,
) -> Generator[PoseStep, None, Float[Tensor, "S B A 5"]]:
    noisy = first_noise(streams.normal(*scene.has_agent.shape, 5).to(scene.agent_pose))
    levels = sampling_levels(config.num_steps)
    drawing = network.drawing(scene, task, levels, len(noisy))
    side = (task.half_side_m / POSITION_UNIT_M)[:, None, None]
    last = None
    states = noisy
    for index, level in enumerate(levels):
        clean = drawing.denoise(noisy, index)
        clean = _inside(clean, side)
        if guide is not None:
            clean = _inside(guide(clean, level), side)
        better = clean
        if config.is_second_order and last is not None:
            better = 1.5 * clean - 0.5 * last
        last, states = clean, _finished(scene, task, clean)
        if index + 1 < len(levels):
            noisy = _next(noisy, better, level, levels[index + 1], config, streams)
        yield PoseStep(index=index, num_steps=len(levels), states=states)
    return states


def _inside(
    clean: Float[Tensor, "S B A 5"], side: Float[Tensor, "B 1 1"]
) -> Float[Tensor, "S B A 5"]:
    """States with places moved into the square."""
    place = torch.minimum(torch.maximum(clean[..., :2], -side), side)
    return torch.cat([place, clean[..., 2:]], dim=-1)


def _next(
    noisy: Float[Tensor, "S B A 5"],
    clean: Float[Tensor, "S B A 5"],
    level: float,
    next_level: float,
    config: PoseSamplerConfig,
    streams: RandomStreams,
) -> Float[Tensor, "S B A 5"]:
    """Noisy states at the next level."""
    both = torch.tensor([level, next_level], device=noisy.device)
    scale, next_scale = noise_scale(both)
    left = (1 - (next_scale / scale).square()).clamp_min(0).sqrt()
    fresh = config.fresh_noise * next_scale * left
    kept = (next_scale.square() - fresh.square()).clamp_min(0).sqrt()
    result = clean + kept / scale * (noisy - clean)
    if config.fresh_noise:
        factors = fresh.new_tensor([1.0] * 4 + [config.speed_spread])
        noise = streams.normal(*noisy.shape[1:]).to(noisy)
        result = result + factors * fresh * noise
    return result


def _finished(
    scene: SceneTensors, task: PoseTask, clean: Float[Tensor, "S B A 5"]
) -> Float[Tensor, "S B A 5"]:
    """States in metres, with those of the given agents put back."""
    heading = scene.agent_pose[..., 2]
    given = torch.cat(
        [
            scene.agent_pose[..., :2],
            torch.stack([heading.cos(), heading.sin(), scene.agent_speed], dim=-1),
        ],
        dim=-1,
    )
    return torch.where(task.is_given[..., None], given, decode_states(clean))
