"""Training loss of the initial-state network."""

import math
from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.generation.core.noise_schedule import centered, noised, relative_noise
from pd_editor.generation.initial_state.network.conditioning import (
    REACH_M,
    Conditioning,
    attribute_codes,
    only_agents,
    order_by,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.features import rotated_back
from pd_editor.generation.initial_state.network.lane_distance import (
    follows_lanes,
    is_on_road,
)
from pd_editor.generation.initial_state.network.state_encoding import (
    NUM_MOTION_PARTS,
    POSITION_UNIT_M,
)
from pd_editor.generation.initial_state.state_overlap import overlap_depth_m
from pd_editor.generation.inputs import SceneTensors
from pd_editor.scene.thresholds import MOVING_MPS

_MIN_HALF_SIDE_M: Final = 25.0
_PARTS: Final = {"position": 2, "heading": 2, "speed": 1}


@dataclass(frozen=True, kw_only=True)
class InitialStateLossConfig:
    """Sampling of training tasks, and the weights of the loss."""

    num_levels: int = 4
    """Noise levels per scene; they share the scene's context."""
    level_emphasis: float = 0.3
    """Concentration of levels in the middle, as in the sampler."""
    decentralized_share: float = 0.1
    """Share of scenes whose agents do not attend to each other."""
    given_share: float = 0.4
    """Share of scenes with a random part of the agents given."""
    small_square_share: float = 0.3
    """Share of scenes whose agents are sampled in a small square."""
    conditioned_share: float = 0.6
    """Share of scenes in which all or some agents are conditioned on an attribute."""
    across_weight: float = 3.0
    """Weight of position errors across the heading, relative to 1 along it: decimetres
    across decide whether a car is in its lane, and metres along it are unpredictable."""
    across_noise_m: float = 4.0
    """That weight applies below this noise only: above, headings are not resolved yet, and
    cars along a street would count more than cars parked beside it."""
    overlap_weight: float = 10.0
    """Weight of overlap; large, because depths are small numbers."""
    overlap_after: float = 0.75
    """Share of the training without overlap loss: an untrained network would only learn to
    spread agents."""
    overlap_noise_m: float = 2.0
    """Overlap counts below this noise only: above, predictions are means over modes."""
    unknown_share: float = 0.25
    """Share of scenes in which the activities of given agents are unknown."""


def initial_state_loss(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    progress: float = 1.0,
    config: InitialStateLossConfig | None = None,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Mean squared error of the network at random levels, and its unweighted parts.

    ``random`` is on the CPU; ``progress`` is the share of the training that is done.
    """
    config = InitialStateLossConfig() if config is None else config
    scene, task = training_task(
        scene, random, config, within_kinds=not model.config.orders_all_kinds
    )
    clean = model.encode_states(scene)
    level = _levels(scene.num_scenes, random, config).to(clean, non_blocking=True)
    shape = (config.num_levels, *clean.shape)
    noise = torch.randn(shape, generator=random).to(clean, non_blocking=True)
    context = model.encode_context(scene, task)
    found = model.denoise(
        noised(model.schedule, clean, noise, level[..., None, None]),
        model.encode_level(level, context),
        context,
    )
    is_sampled = (scene.has_agent & ~task.is_given).to(clean)
    count = is_sampled.sum().clamp_min(1) * config.num_levels
    sigma = relative_noise(model.schedule, level[..., None, None])
    error = (found - clean) / model.output_factors(sigma)[2]
    noise_m = sigma[..., 0] * POSITION_UNIT_M
    squared = squared_error(error, clean[..., 2:4], noise_m, config)
    of_motion, of_activity = squared.tensor_split([NUM_MOTION_PARTS], dim=-1)
    of_motion = (of_motion * is_sampled[..., None]).sum(dim=(0, 1, 2)) / count
    split = of_motion.split([*_PARTS.values()])
    parts = {name: one.mean() for name, one in zip(_PARTS, split, strict=True)}
    if model.config.samples_activity:
        is_known = is_sampled * (scene.agent_activity > 0)
        count = is_known.sum().clamp_min(1) * config.num_levels
        total = (of_activity.mean(dim=-1) * is_known).sum()
        parts["activity"] = total / count
    loss = sum(parts.values(), torch.zeros_like(count))
    if config.overlap_weight and progress >= config.overlap_after:
        parts["overlap"] = _overlap(
            scene, clean, found, is_sampled > 0, noise_m, config
        )
        loss = loss + config.overlap_weight * parts["overlap"]
    return loss, {name: part.detach() for name, part in parts.items()}


def squared_error(
    error: Float[Tensor, "S B A P"],
    direction: Float[Tensor, "B A 2"],
    noise_m: Float[Tensor, "S B #A"],
    config: InitialStateLossConfig,
) -> Float[Tensor, "S B A P"]:
    """Squared errors, with positions resolved along and across the true direction."""
    along, across = rotated_back(error[..., :2], direction[None]).square().unbind(-1)
    weight = torch.where(noise_m < config.across_noise_m, config.across_weight, 1.0)
    own = torch.stack([along, weight * across], dim=-1)
    return torch.cat([own, error[..., 2:].square()], dim=-1)


def training_task(
    scene: SceneTensors,
    random: torch.Generator,
    config: InitialStateLossConfig,
    *,
    within_kinds: bool = True,
) -> tuple[SceneTensors, Conditioning]:
    """Sample the conditioning of training scenes, and remove agents that do not count.

    Agents outside the square are given in half of the scenes, and removed in the others.
    """
    device, num_scenes = scene.has_agent.device, scene.num_scenes

    def chance(*shape: int) -> Float[Tensor, "*s"]:
        return torch.rand(shape, generator=random).to(device, non_blocking=True)

    side = POSITION_UNIT_M * torch.ones(num_scenes, device=device)
    small = _MIN_HALF_SIDE_M + chance(num_scenes) * (side - _MIN_HALF_SIDE_M)
    side = torch.where(chance(num_scenes) < config.small_square_share, small, side)
    distance = scene.agent_pose[..., :2].abs().amax(dim=-1)
    keeps_outside = chance(num_scenes, 1) < 0.5
    reach = torch.where(keeps_outside, REACH_M, side[:, None])
    scene = only_agents(scene, distance <= reach)
    has_agent = scene.has_agent
    is_inside = scene.agent_pose[..., :2].abs().amax(dim=-1) <= side[:, None]
    part = torch.where(chance(num_scenes) < config.given_share, chance(num_scenes), 0.0)
    is_given = has_agent & (~is_inside | (chance(*has_agent.shape) < part[:, None]))

    def some() -> Bool[Tensor, "B A"]:
        """Sample all agents, a random part of them, or none, in each scene."""
        part = torch.where(
            chance(num_scenes) < config.conditioned_share, 2 * chance(num_scenes), 0.0
        )
        return chance(*has_agent.shape) < part[:, None]

    sampled = has_agent & ~is_given
    is_unknown = is_given & (chance(num_scenes, 1) < config.unknown_share)
    scene = replace(
        scene, agent_activity=scene.agent_activity.masked_fill(is_unknown, 0)
    )
    return scene, Conditioning(
        is_given=is_given,
        order=order_by(
            scene.agent_pose[..., 0], scene, is_given, within_kinds=within_kinds
        ),
        moves=attribute_codes(scene.agent_speed >= MOVING_MPS, sampled & some()),
        on_road=attribute_codes(
            is_on_road(scene), sampled & some() & follows_lanes(scene)
        ),
        half_side_m=side,
        is_central=chance(num_scenes) >= config.decentralized_share,
    )


def _levels(
    num_scenes: int, random: torch.Generator, config: InitialStateLossConfig
) -> Float[Tensor, "S B"]:
    """Sample levels 0..1, stratified over the versions of each scene."""
    number = config.num_levels
    offset = torch.rand((number, num_scenes), generator=random)
    even = (torch.arange(number)[:, None] + offset) / number
    return centered(even, config.level_emphasis)


def _overlap(
    scene: SceneTensors,
    clean: Float[Tensor, "B A P"],
    found: Float[Tensor, "S B A P"],
    is_sampled: Bool[Tensor, "B A"],
    noise_m: Float[Tensor, "S B 1"],
    config: InitialStateLossConfig,
) -> Float[Tensor, ""]:
    """Mean squared overlap depth of predicted boxes beyond the true depth, in metres."""
    depth = overlap_depth_m(found, scene) - overlap_depth_m(clean, scene)
    counts = (noise_m < config.overlap_noise_m) & is_sampled
    squared = depth.clamp(min=0, max=math.inf).square().sum(dim=-1)
    return (squared * counts).sum() / counts.sum().clamp_min(1)
