"""Noisy traffic, from which sampling starts, and the variance of what is predicted."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.core.noise_schedule import noised
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.features.scene_features import AGENT_KINDS, PackedScene
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_YES,
    UNCONDITIONED,
    Conditioning,
    in_square,
    order_by,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import (
    NUM_ATTRIBUTE_CODES,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    NUM_POSE_PARTS,
    POSITION_UNIT_M,
)
from pd_editor.generation.inputs import SceneTensors, batch_of
from pd_editor.scene.thresholds import MOVING_MPS

_LEAST_AGENTS: Final = 40
"""Agents of a kind that are fewer in the data have the moments of all kinds."""


def noisy_traffic(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    task: Conditioning,
    streams: RandomStreams,
) -> Float[Tensor, "S B A P"]:
    """Sample traffic with the noise of level 1, from which sampling starts.

    The noise does not hide everything, so that a network finds in it what traffic it
    begins with. Agents are spread over the lanes in the square in the order of their
    ranks, with speeds and activities of the training data's moments.
    """
    one = torch.ones(1, device=scene.agent_pose.device)
    size = (*scene.has_agent.shape, model.config.num_state_parts)
    normal = streams.normal(*size).to(scene.agent_pose)
    clean = streams.normal(*size).to(scene.agent_pose)
    pose, others = clean.tensor_split([NUM_POSE_PARTS], dim=-1)
    place = _on_lanes(scene, task, pose[..., :2])
    if model.config.is_ordered:
        within_kinds = not model.config.orders_all_kinds
        place = _in_order(place, scene, task, within_kinds=within_kinds)
    direction = model.get_buffer("spread")[2:NUM_POSE_PARTS] * pose[..., 2:]
    table = model.get_buffer("state_moments").to(pose)[scene.agent_kind, task.moves]
    mean, factor = table[..., :1, :], table[..., 1:, :]
    others = (mean + others[..., None, :] @ factor).squeeze(-2)
    clean = torch.cat([place, direction, others], dim=-1)
    return model.schedule.alpha(one) * clean + model.schedule.sigma(one) * normal


def fit_moments(
    model: InitialStateDenoiser, scenes: Iterable[PackedScene]
) -> Float[Tensor, "K 3 N M"]:
    """Moments of encoded speeds and activities in the squares of training scenes.

    By kind of the agents, and by whether they move: all, standing, moving. The first of N
    rows is the mean, the others are the transposed Cholesky factor of the covariance.
    What the scenes do not show keeps the values in the network.
    """
    codes, kinds, moves = [], [], []
    for packed in scenes:
        scene = in_square(batch_of([packed]))
        is_known = scene.has_agent & (scene.agent_activity > 0)
        counts = is_known if bool(is_known.any()) else scene.has_agent
        codes.append(model.encode_states(scene)[counts][:, NUM_POSE_PARTS:].double())
        kinds.append(scene.agent_kind[counts])
        moves.append(scene.agent_speed[counts] >= MOVING_MPS)
    code, kind, is_moving = torch.cat(codes), torch.cat(kinds), torch.cat(moves)
    moments = model.get_buffer("state_moments").clone()
    for attribute in range(NUM_ATTRIBUTE_CODES):
        of_all = torch.ones_like(is_moving)
        if attribute != UNCONDITIONED:
            of_all = is_moving == (attribute == CONDITIONED_YES)
        for index in range(len(AGENT_KINDS)):
            of_kind = of_all & (kind == index)
            rows = of_kind if int(of_kind.sum()) >= _LEAST_AGENTS else of_all
            if int(rows.sum()) >= _LEAST_AGENTS:
                moments[index, attribute] = _moments(code[rows]).to(moments)
    return moments


def _moments(code: Float[Tensor, "A M"]) -> Float[Tensor, "N M"]:
    """Mean, and the transposed Cholesky factor of the covariance."""
    # Variance that makes the covariance of constant parts regular.
    trace = 1e-6 * torch.eye(code.shape[1], dtype=code.dtype)
    factor = torch.linalg.cholesky(torch.cov(code.T) + trace)
    return torch.cat([code.mean(dim=0, keepdim=True), factor.T])


def _on_lanes(
    scene: SceneTensors, task: Conditioning, normal: Float[Tensor, "S B A 2"]
) -> Float[Tensor, "S B A 2"]:
    """Encoded places of random lane pieces in the square; anywhere in it without any."""
    share = torch.special.ndtr(normal)
    side = task.half_side_m[:, None, None]
    anywhere = side * (2 * share - 1)
    place = scene.piece_pose[..., :2].expand(len(side), -1, -1)
    is_inside = scene.has_piece & (place.abs() <= side).all(dim=-1)
    count = is_inside.sum(dim=-1)[:, None]
    if place.shape[1]:
        first = torch.argsort(~is_inside, dim=-1, stable=True)
        index = (share[..., 0] * count).long().minimum((count - 1).clamp_min(0))
        scene_row = torch.arange(len(side), device=first.device)[:, None]
        found = place[scene_row, first[scene_row, index]]
        anywhere = torch.where(count[..., None] > 0, found, anywhere)
    return anywhere / POSITION_UNIT_M


def _in_order(
    place: Float[Tensor, "S B A 2"],
    scene: SceneTensors,
    task: Conditioning,
    *,
    within_kinds: bool,
) -> Float[Tensor, "S B A 2"]:
    """Exchange places between sampled agents so that ranks increase along x."""
    group: Int[Tensor, "B A"] = scene.agent_kind if within_kinds else 0 * task.order
    group = torch.where(task.order > 0, group, len(AGENT_KINDS))
    target = _order(task.order, group).expand(place.shape[:-1])
    source = _order(place[..., 0], group.expand(place.shape[:-1]))
    places = place.gather(-2, source[..., None].expand_as(place))
    return places.scatter(-2, target[..., None].expand_as(place), places)


def _order(key: Tensor, group: Int[Tensor, "*b A"]) -> Int[Tensor, "*b A"]:
    """Indices that sort by group, and by the key within groups."""
    first = torch.argsort(key, dim=-1, stable=True)
    then = torch.argsort(group.gather(-1, first), dim=-1, stable=True)
    return first.gather(-1, then)


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
