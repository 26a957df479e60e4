"""Loss of sampled initial states: overlaps of boxes."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.experiments.training.own_samples.settings import OwnSamplesConfig
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import DifferentiableSampler
from pd_editor.generation.features.scene_features import PEDESTRIAN
from pd_editor.generation.initial_state.loss import (
    InitialStateLossConfig,
    training_task,
)
from pd_editor.generation.initial_state.network.conditioning import Conditioning
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import (
    POSITION_UNIT_M,
    unit_vectors,
)
from pd_editor.generation.initial_state.sampler import sample_initial_states
from pd_editor.generation.inputs.scene_batch import SceneTensors
from pd_editor.generation.trajectory.guidance.box_conflicts import depth_m

_LEAST_NORM: Final = 1e-6


def initial_state_samples_loss(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    config: OwnSamplesConfig,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Loss of samples of the default number of steps, and its part before weighting.

    Given agents, attributes and squares are those of the loss of denoising.
    """
    scene, task = training_task(
        scene,
        random,
        InitialStateLossConfig(),
        within_kinds=not model.config.orders_all_kinds,
    )
    seed = int(torch.randint(2**31, (), generator=random))
    *_, last = sample_initial_states(
        model,
        scene,
        RandomStreams(seed, "states", range(config.num_samples)),
        task,
        sampler=DifferentiableSampler(num_steps=config.num_gradient_steps),
    )
    depth = collision_depth_m(last.clean, scene, task, config.margin_m)
    is_sampled = scene.has_agent & ~task.is_given
    count = config.num_samples * is_sampled.sum().clamp_min(1)
    collision = (depth.sum(dim=-1) * is_sampled).sum() / count
    return config.collision * collision, {"collision": collision.detach()}


def collision_depth_m(
    states: Float[Tensor, "S B A P"],
    scene: SceneTensors,
    task: Conditioning,
    margin_m: float,
) -> Float[Tensor, "S B A A"]:
    """Depth by which boxes overlap; pairs of pedestrians and given agents do not count."""
    place = states[..., :2] * POSITION_UNIT_M
    axis = unit_vectors(states[..., 2:4])
    # The derivative of the angle is not finite at a zero vector.
    heading = torch.atan2(axis[..., 1], axis[..., 0] + _LEAST_NORM)
    place = torch.where(task.is_given[..., None], scene.agent_pose[..., :2], place)
    heading = torch.where(task.is_given, scene.agent_pose[..., 2], heading)
    size = scene.agent_size
    depth = depth_m(
        place[..., None, :, :] - place[..., :, None, :],
        (heading[..., :, None], heading[..., None, :]),
        (size[:, :, None], size[:, None]),
    )
    walks = scene.agent_kind == PEDESTRIAN
    counts = ~(walks[..., None] & walks[..., None, :])
    counts &= scene.has_agent[..., None] & scene.has_agent[..., None, :]
    counts &= ~(task.is_given[..., None] & task.is_given[..., None, :])
    counts &= ~torch.eye(counts.shape[-1], dtype=torch.bool, device=counts.device)
    return torch.where(counts, (depth + margin_m).clamp_min(0), 0.0)
