"""Errors of predicted clean states, which tell the sampler how much noise is missing."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.generation.core.noise_schedule import noised
from pd_editor.generation.features.encoded_scene import PackedScene
from pd_editor.generation.initial_state.network.conditioning import (
    Conditioning,
    in_square,
    order_by,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import NUM_MOTION_PARTS
from pd_editor.generation.inputs.scene_batch import SceneTensors, batch_of


@torch.no_grad()
def measured_clean_variance(
    model: InitialStateDenoiser, scenes: Iterable[PackedScene]
) -> Float[Tensor, "L P"]:
    """Mean squared error of each part of predicted clean states, at even levels 0..1.

    It estimates the variance of clean states, given noisy ones.
    """
    variance = model.get_buffer("clean_variance")
    random = torch.Generator("cpu").manual_seed(0)
    levels = torch.linspace(0, 1, len(variance), device=variance.device)[:, None]
    total, number = torch.zeros_like(variance), torch.zeros_like(variance[0])
    for packed in scenes:
        scene = in_square(batch_of([packed]).to(variance.device))
        task = _task(model, scene)
        clean = model.encode_states(scene)
        noise = torch.randn((len(levels), *clean.shape), generator=random).to(clean)
        noisy = noised(model.schedule, clean, noise, levels[..., None, None])
        context = model.encode_context(scene, task)
        found = model.denoise(noisy, model.encode_level(levels, context), context)
        counts = _known_parts(scene, clean)
        total += ((found - clean).square() * counts).sum(dim=(1, 2))
        number += counts.sum(dim=(0, 1))
    return total / number.clamp_min(1)


def clean_variance_at(
    model: InitialStateDenoiser, levels: Sequence[float]
) -> Float[Tensor, "T P"]:
    """The measured variance at levels of steps, linear in between."""
    table = model.get_buffer("clean_variance")
    place = table.new_tensor(levels) * (len(table) - 1)
    below = place.long().clamp(0, len(table) - 2)
    return torch.lerp(table[below], table[below + 1], (place - below)[:, None])


def _task(model: InitialStateDenoiser, scene: SceneTensors) -> Conditioning:
    """All agents are sampled, and ordered as in training."""
    task = sampling_conditioning(scene)
    order = order_by(
        scene.agent_pose[..., 0],
        scene,
        task.is_given,
        within_kinds=not model.config.orders_all_kinds,
    )
    return replace(task, order=order)


def _known_parts(
    scene: SceneTensors, clean: Float[Tensor, "B A P"]
) -> Bool[Tensor, "B A P"]:
    counts = scene.has_agent[..., None].repeat(1, 1, clean.shape[-1])
    counts[..., NUM_MOTION_PARTS:] &= (scene.agent_activity > 0)[..., None]
    return counts
