"""Sampler of initial states."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pd_editor.generation.core.noise_schedule import centered_levels
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import (
    Sampler,
    SamplerConfig,
    SamplerStep,
    preparing_mode,
    sample_steps,
)
from pd_editor.generation.defaults import check_settings
from pd_editor.generation.initial_state.network.conditioning import (
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.map_tokens import EncodedMap
from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    NUM_POSE_PARTS,
    POSITION_UNIT_M,
    decode_activity,
    decode_states,
)
from pd_editor.generation.initial_state.noisy_traffic import (
    clean_variance_at,
    noisy_traffic,
)
from pd_editor.generation.inputs import SceneTensors

_SPEED: Final = NUM_MOTION_PARTS - 1

InitialStateGuide = Callable[[Tensor, float], Tensor]
"""Changes predicted clean states [S B A P], encoded, at a noise level."""


@dataclass(frozen=True, kw_only=True)
class InitialStateSamplerConfig:
    """Settings of the sampling of initial states."""

    num_steps: int = 8
    """Denoising steps; twice as many for quality "high"."""
    level_emphasis: float = 0.3
    """Concentration of levels in the middle, where lanes, headings and gaps are resolved."""
    eta: float = 1.0
    """Stochasticity: 0 adds no fresh noise, 1 is ancestral sampling. Fresh noise on speeds
    and activities includes the variance of the clean state about its prediction, without
    which large steps spread them too little. With 0, errors of early steps remain."""
    fit_density: float = 0.72
    """Factor of the numbers of training squares where the model samples the number of
    agents; 1 for networks that are trained on recordings."""
    is_second_order: bool = True
    """Whether to extrapolate predicted clean speeds and activities (second order)."""

    def __post_init__(self) -> None:
        check_settings(self)


def sample_initial_states(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    streams: RandomStreams,
    task: Conditioning | None = None,
    *,
    config: InitialStateSamplerConfig | None = None,
    sampler: Sampler = sample_steps,
    guide: InitialStateGuide | None = None,
    road_map: EncodedMap | None = None,
) -> Iterator[SamplerStep]:
    """Sample initial states of all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not requesting the next one. The last step
    holds the encoded result: see ``finished_states``. Sample k of a seed does not depend
    on the other samples, apart from rounding.

    Args:
        model: network in evaluation mode.
        scene: scenes; of sampled agents only kind, size and ``has_agent`` are used, of
            given agents also poses and speeds.
        streams: random numbers of the samples.
        task: conditioning; None samples all agents in the whole square.
        config: settings of the sampler.
        sampler: takes the steps.
        guide: changes the predicted clean states of each step.
        road_map: the encoded map of the scenes, if it is known already.
    """
    config = InitialStateSamplerConfig() if config is None else config
    levels = centered_levels(config.num_steps, config.level_emphasis)
    if task is None:
        within_kinds = not model.config.orders_all_kinds
        task = sampling_conditioning(scene, within_kinds=within_kinds)
    side = (task.half_side_m / POSITION_UNIT_M)[:, None, None]

    with preparing_mode(streams.num_samples * scene.has_agent.numel(), sampler):
        start = noisy_traffic(model, scene, task, streams)
        context = model.encode_context(scene, task, road_map)
        encoded = model.encode_level(start.new_tensor(levels)[:, None, None], context)
        steps = _step_settings(model, config, levels)

    def denoise(noisy: Tensor, step: int) -> Tensor:
        clean = _inside(model.denoise(noisy, encoded.at(step), context), side)
        return clean if guide is None else _inside(guide(clean, levels[step]), side)

    fresh_noise = partial(streams.normal, *start.shape[1:])
    return sampler(denoise, start, model.schedule, levels, steps, fresh_noise)


def _step_settings(
    model: InitialStateDenoiser,
    config: InitialStateSamplerConfig,
    levels: Sequence[float],
) -> SamplerConfig:
    """Poses are predicted in the first order, speeds and activities in the second."""
    missing = None
    if config.eta:
        missing = clean_variance_at(model, levels)
        # On poses this noise would move agents off their lanes.
        missing[:, :NUM_POSE_PARTS] = 0
    parts = range(model.config.num_state_parts)
    return SamplerConfig(
        eta=config.eta,
        extrapolation=tuple(
            float(config.is_second_order and part >= _SPEED) for part in parts
        ),
        clean_variance=missing,
    )


def finished_states(
    scene: SceneTensors, task: Conditioning, clean: Float[Tensor, "S B A P"]
) -> Float[Tensor, "S B A 5"]:
    """Decode sampled states; those of given agents are restored bit-identically.

    x and y in metres around the centre of the scene, cosine and sine of the heading,
    speed in m/s.
    """
    heading = scene.agent_pose[..., 2]
    given = torch.cat(
        [
            scene.agent_pose[..., :2],
            torch.stack([heading.cos(), heading.sin(), scene.agent_speed], dim=-1),
        ],
        dim=-1,
    )
    return torch.where(task.is_given[..., None], given, decode_states(clean))


def finished_activity(
    scene: SceneTensors, task: Conditioning, clean: Float[Tensor, "S B A P"]
) -> Int[Tensor, "S B A"]:
    """Sampled ``Activity``; that of given agents is unchanged."""
    return torch.where(task.is_given, scene.agent_activity, decode_activity(clean))


def _inside(
    clean: Float[Tensor, "S B A P"], side: Float[Tensor, "B 1 1"]
) -> Float[Tensor, "S B A P"]:
    """Clamp positions of states to the square."""
    place = torch.minimum(torch.maximum(clean[..., :2], -side), side)
    return torch.cat([place, clean[..., 2:]], dim=-1)
