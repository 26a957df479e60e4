"""Sampler of initial states."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pd_editor.generation.core.config_limits import check_settings
from pd_editor.generation.core.noise_schedule import centered_levels
from pd_editor.generation.core.random_streams import RandomStreams, SceneStreams
from pd_editor.generation.core.sampler import (
    Sampler,
    SamplerConfig,
    SamplerStep,
    sample_steps,
    sampling_mode,
)
from pd_editor.generation.initial_state.network.conditioning import (
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.context import EncodedMap
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    NUM_POSE_PARTS,
    POSITION_UNIT_M,
    decode_activity,
    decode_states,
)
from pd_editor.generation.initial_state.noisy_traffic import noisy_traffic
from pd_editor.generation.initial_state.prediction_error import clean_variance_at
from pd_editor.generation.inputs.scene_batch import SceneTensors

_SPEED: Final = NUM_MOTION_PARTS - 1

InitialStateGuide = Callable[[Tensor, float], Tensor]
"""Changes predicted clean states [S B A P], encoded, at a noise level."""


@dataclass(frozen=True, kw_only=True)
class InitialStateSamplerConfig:
    """Settings of the sampling of initial states."""

    num_steps: int = 8
    """Denoising steps. Distances from recorded states are as with 10; with 6, raw, 8.5
    instead of 6.3 % of the boxes overlap (``train``)."""
    num_high_quality_steps: int = 16
    """Denoising steps of quality "high": raw, 4.8 % of the boxes overlap, and the distance
    of angles is .178 instead of .182 (``train``)."""
    level_emphasis: float = 0.3
    """Concentration of levels in the middle, where lanes, headings and gaps are resolved."""
    eta: float = 1.0
    """Stochasticity: 0 adds no fresh noise but that of ``adds_missing_noise``, 1 is ancestral
    sampling. With 0, errors of early steps remain: 22 instead of 14 % were off the road."""
    adds_missing_noise: bool = True
    """Whether the fresh noise on speeds and activities includes the variance of the clean
    state about its prediction. Without it large steps spread them too little: (``train``)
    moving agents have 6.7 instead of 7.1 m/s, recorded 7.6."""
    fit_density: float = 0.72
    """Factor of the numbers of training squares where the model samples the number of
    agents. With it squares are as dense as recorded ones (``train``); 1 for networks that
    are trained on recordings."""
    is_second_order: bool = True
    """Whether to extrapolate predicted clean speeds and activities (second order)."""
    extrapolates_poses: bool = False
    """Whether to extrapolate poses as well."""

    def __post_init__(self) -> None:
        check_settings(self)


def sample_initial_states(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    *,
    samples: Sequence[int],
    seed: int,
    task: Conditioning | None = None,
    config: InitialStateSamplerConfig | None = None,
    sampler: Sampler = sample_steps,
    guide: InitialStateGuide | None = None,
    square: int = 0,
    rows: Sequence[tuple[int, Int[np.ndarray, "_"]]] | None = None,
    road_map: EncodedMap | None = None,
    num_gradient_steps: int = 0,
) -> Iterator[SamplerStep]:
    """Sample initial states of all agents of B scenes that are not given.

    Yields after each step; a caller cancels by not requesting the next one. The last step
    holds the encoded result: see ``finished_states``. Sample k of a seed does not depend
    on the other samples, apart from rounding.

    Args:
        model: network in evaluation mode.
        scene: scenes; of sampled agents only kind, size and ``has_agent`` are used, of
            given agents also poses and speeds.
        samples: indices of the S samples.
        seed: seed of all samples.
        task: conditioning; None samples all agents in the whole square.
        config: settings of the sampler.
        sampler: takes the steps.
        guide: changes the predicted clean states of each step.
        square: index of the square; each has separate random numbers.
        rows: number of agents of each whole scene, and which of them ``scene`` keeps.
            Each of the B scenes then has one of the samples (S = B), and the result is
            [1, B, A, P]; None: all samples of all scenes.
        road_map: the encoded map of the scenes, if it is known already.
        num_gradient_steps: number of last steps that are differentiable.
    """
    config = InitialStateSamplerConfig() if config is None else config
    if task is None:
        within_kinds = not model.config.orders_all_kinds
        task = sampling_conditioning(scene, within_kinds=within_kinds)
    name = f"states-{square}" if square else "states"
    num_versions = len(samples) if rows is None else 1
    streams = (
        RandomStreams(seed, name, samples)
        if rows is None
        else SceneStreams(seed, name, samples, rows)
    )
    num_parts = model.config.num_state_parts
    num_rows = num_versions * scene.has_agent.numel()
    has_gradient = True if num_gradient_steps else None
    with sampling_mode(num_rows, has_gradient=has_gradient):
        context = model.encode_context(scene, task, road_map)
        levels = centered_levels(config.num_steps, config.level_emphasis)
        encoded = model.encode_level(
            scene.agent_pose.new_tensor(levels)[:, None, None], context
        )
        start = noisy_traffic(model, scene, task, streams)
        missing = None
        if config.adds_missing_noise:
            missing = clean_variance_at(model, levels)
            # On poses this noise would move agents off their lanes.
            missing[:, :NUM_POSE_PARTS] = 0
        side = (task.half_side_m / POSITION_UNIT_M)[:, None, None]

    def denoise(noisy: Tensor, step: int) -> Tensor:
        clean = _inside(model.denoise(noisy, encoded.at(step), context), side)
        return clean if guide is None else _inside(guide(clean, levels[step]), side)

    return sampler(
        denoise,
        start,
        model.schedule,
        levels,
        SamplerConfig(
            eta=config.eta,
            extrapolation=tuple(
                float(
                    config.is_second_order
                    and (part >= _SPEED or config.extrapolates_poses)
                )
                for part in range(num_parts)
            ),
            clean_variance=missing,
            num_gradient_steps=num_gradient_steps,
        ),
        partial(streams.normal, *start.shape[1:]),
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
