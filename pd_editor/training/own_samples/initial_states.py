"""Loss of sampled initial states: overlaps of boxes, and realism."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from pd_editor.diffusion.initial_state.loss import (
    InitialStateLossConfig,
    training_task,
)
from pd_editor.diffusion.initial_state.network.conditioning import Conditioning
from pd_editor.diffusion.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.diffusion.initial_state.network.state_encoding import (
    POSITION_UNIT_M,
    unit_vectors,
)
from pd_editor.diffusion.initial_state.sampler import sample_initial_states
from pd_editor.diffusion.inputs.scene_batch import SceneTensors
from pd_editor.diffusion.trajectory.guidance.box_conflicts import depth_m
from pd_editor.features.scene_features import PEDESTRIAN
from pd_editor.training.own_samples.settings import OwnSamplesConfig
from pd_editor.training.own_samples.state_critic import (
    ComparedStates,
    StateCritic,
    as_decoded,
)

_LEAST_NORM: Final = 1e-6


def initial_state_samples_loss(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    config: OwnSamplesConfig,
    critic: StateCritic | None = None,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Loss of samples of the default number of steps, and its parts before weighting.

    Given agents, attributes and squares are those of the loss of denoising. The critic
    learns as well, where gradients are recorded.
    """
    learns = torch.is_grad_enabled()
    judges = critic is not None and critic.is_warm
    differentiates = learns and (judges or bool(config.collision))
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
        samples=range(config.num_samples),
        seed=seed,
        task=task,
        num_gradient_steps=config.num_gradient_steps if differentiates else 0,
    )
    # Samples without gradient were made in inference mode: only a copy can be learned from.
    states = last.clean if differentiates else last.clean.clone()
    is_sampled = scene.has_agent & ~task.is_given
    parts: dict[str, Tensor] = {}
    if config.collision:
        depth = collision_depth_m(states, scene, task, config.margin_m)
        count = config.num_samples * is_sampled.sum().clamp_min(1)
        parts["collision"] = (depth.sum(dim=-1) * is_sampled).sum() / count
    loss = states.new_zeros(()) + config.collision * parts.get("collision", 0.0)
    if critic is not None:
        compared = _compared(model, scene, task, states, random, config)
        if learns:
            parts["critic"] = critic.learn(compared)
        if judges:
            parts["realism"] = critic.realism_loss(compared)
            loss = loss + config.realism * parts["realism"]
    return loss, {name: part.detach() for name, part in parts.items()}


def _compared(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    task: Conditioning,
    states: Float[Tensor, "S B A P"],
    random: torch.Generator,
    config: OwnSamplesConfig,
) -> ComparedStates:
    """What the critic compares: sampled agents whose true activity is known."""
    true = model.encode_states(scene)
    level = config.critic_highest_level * torch.rand(states.shape[:2], generator=random)
    noise = torch.randn((2, *states.shape), generator=random).to(true)
    counts = scene.has_agent & ~task.is_given
    if model.config.samples_activity:
        counts = counts & (scene.agent_activity > 0)
    return ComparedStates(
        scene=scene,
        task=task,
        true=true,
        sampled=as_decoded(states),
        level=level.to(true),
        true_noise=noise[0],
        sampled_noise=noise[1],
        counts=counts.to(true),
    )


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
