"""Training loss of initial states: clean states at every noise level."""

import math
from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.core.noise_schedule import centered, preconditioning
from pd_editor.diffusion.initial_state.box_overlap import overlap_depth_m
from pd_editor.diffusion.initial_state.conditioning import (
    REACH_M,
    Conditioning,
    attribute_codes,
    only_agents,
    order_by,
)
from pd_editor.diffusion.initial_state.denoiser import InitialStateDenoiser
from pd_editor.diffusion.initial_state.features import rotated_back
from pd_editor.diffusion.initial_state.lane_distance import follows_lanes, is_on_road
from pd_editor.diffusion.initial_state.state_encoding import (
    NUM_MOTION_PARTS,
    POSITION_UNIT_M,
    STANDING_SPEED_MPS,
)
from pd_editor.diffusion.inputs.scene_batch import SceneTensors

_MIN_HALF_SIDE_M: Final = 25.0
_PARTS: Final = {"position": (0, 1), "heading": (2, 3), "speed": (4,)}


@dataclass(frozen=True, kw_only=True)
class InitialStateLossConfig:
    """What each training step samples, and the weights of the loss."""

    num_levels: int = 4
    """Noise levels per scene; they share the scene's context."""
    level_emphasis: float = 0.3
    """As of the sampler's levels."""
    decentralized_share: float = 0.1
    """Share of scenes whose agents do not see each other."""
    given_share: float = 0.4
    """Share of scenes with a random part of the agents given."""
    small_square_share: float = 0.3
    conditioned_share: float = 0.6
    """Share of scenes in which an attribute of all or some agents is set."""
    across_weight: float = 3.0
    """Of position errors across the heading, against 1 along it: decimetres decide
    whether a car is in its lane, and metres along it cannot be known."""
    across_noise_m: float = 4.0
    """Below this noise only: above, headings are not known yet, and cars along a street
    would count more than cars parked beside it."""
    overlap_weight: float = 10.0
    """Depths are small numbers: the weight is large so that they count at all."""
    overlap_after: float = 0.75
    """Share of the training without it: a network that cannot place agents yet would
    learn to spread them."""
    overlap_noise_m: float = 2.0
    """Overlap counts below this noise only: above, clean states are blurred means."""
    unknown_share: float = 0.25
    """Share of scenes in which the activities of given agents are unknown."""


def initial_state_loss(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    progress: float = 1.0,
    config: InitialStateLossConfig | None = None,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Mean squared error of the network at random levels, and its parts.

    Args:
        model: the network.
        scene: clean scenes.
        random: random numbers, on the CPU.
        progress: share of the training that is done.
        config: what each step draws.

    Returns:
        The loss, and its terms before weighting: position, heading, speed, activity,
        overlap.
    """
    config = InitialStateLossConfig() if config is None else config
    scene, task = training_task(scene, random, config)
    clean = model.encode_states(scene)
    level = _levels(scene.num_scenes, random, config).to(clean)
    scale = model.schedule.sigma(level[..., None, None])
    shape = (config.num_levels, *clean.shape)
    noise = torch.randn(shape, generator=random).to(clean)
    context = model.encode_context(scene, task)
    found = model.denoise(
        clean + scale * noise, model.encode_level(level, context), context
    )
    is_drawn = (scene.has_agent & ~task.is_given).to(clean)
    count = is_drawn.sum().clamp_min(1) * config.num_levels
    error = (found - clean) / preconditioning(scale, model.get_buffer("spread"))[2]
    noise_m = scale[..., 0] * POSITION_UNIT_M
    squared = squared_error(error, clean[..., 2:4], noise_m, config)
    of_motion, of_activity = squared.tensor_split([NUM_MOTION_PARTS], dim=-1)
    of_motion = (of_motion * is_drawn[..., None]).sum(dim=(0, 1, 2)) / count
    parts = {name: of_motion[list(where)].mean() for name, where in _PARTS.items()}
    if model.config.samples_activity:
        is_known = is_drawn * (scene.agent_activity > 0)
        count = is_known.sum().clamp_min(1) * config.num_levels
        total = (of_activity.mean(dim=-1) * is_known).sum()
        parts["activity"] = total / count
    loss = sum(parts.values(), torch.zeros_like(count))
    if config.overlap_weight and progress >= config.overlap_after:
        parts["overlap"] = _overlap(scene, clean, found, is_drawn > 0, noise_m, config)
        loss = loss + config.overlap_weight * parts["overlap"]
    return loss, {name: part.detach() for name, part in parts.items()}


def squared_error(
    error: Float[Tensor, "S B A P"],
    direction: Float[Tensor, "B A 2"],
    noise_m: Float[Tensor, "S B #A"],
    config: InitialStateLossConfig,
) -> Float[Tensor, "S B A P"]:
    """Squares of errors, those of positions along and across the true direction."""
    along, across = rotated_back(error[..., :2], direction[None]).square().unbind(-1)
    weight = torch.where(noise_m < config.across_noise_m, config.across_weight, 1.0)
    own = torch.stack([along, weight * across], dim=-1)
    return torch.cat([own, error[..., 2:].square()], dim=-1)


def training_task(
    scene: SceneTensors, random: torch.Generator, config: InitialStateLossConfig
) -> tuple[SceneTensors, Conditioning]:
    """Random conditioning of real scenes, and the scenes with the agents that count.

    Agents outside the square are given in half of the scenes, absent in the others.
    """
    device, num_scenes = scene.has_agent.device, scene.num_scenes

    def chance(*shape: int) -> Float[Tensor, "*s"]:
        return torch.rand(shape, generator=random).to(device)

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
        """All agents, a random part of them, or none, in each scene."""
        part = torch.where(
            chance(num_scenes) < config.conditioned_share, 2 * chance(num_scenes), 0.0
        )
        return chance(*has_agent.shape) < part[:, None]

    drawn = has_agent & ~is_given
    is_unknown = is_given & (chance(num_scenes, 1) < config.unknown_share)
    scene = replace(
        scene, agent_activity=scene.agent_activity.masked_fill(is_unknown, 0)
    )
    return scene, Conditioning(
        is_given=is_given,
        order=order_by(scene.agent_pose[..., 0], scene, is_given),
        moves=attribute_codes(scene.agent_speed >= STANDING_SPEED_MPS, drawn & some()),
        on_road=attribute_codes(
            is_on_road(scene), drawn & some() & follows_lanes(scene)
        ),
        half_side_m=side,
        is_central=chance(num_scenes) >= config.decentralized_share,
    )


def _levels(
    num_scenes: int, random: torch.Generator, config: InitialStateLossConfig
) -> Float[Tensor, "S B"]:
    """Levels 0..1, spread over the versions of each scene."""
    number = config.num_levels
    offset = torch.rand((number, num_scenes), generator=random)
    even = (torch.arange(number)[:, None] + offset) / number
    return centered(even, config.level_emphasis)


def _overlap(
    scene: SceneTensors,
    clean: Float[Tensor, "B A P"],
    found: Float[Tensor, "S B A P"],
    is_drawn: Bool[Tensor, "B A"],
    noise_m: Float[Tensor, "S B 1"],
    config: InitialStateLossConfig,
) -> Float[Tensor, ""]:
    """Mean squared depth in metres by which predicted boxes overlap too much."""
    depth = overlap_depth_m(found, scene) - overlap_depth_m(clean, scene)
    counts = (noise_m < config.overlap_noise_m) & is_drawn
    squared = depth.clamp(min=0, max=math.inf).square().sum(dim=-1)
    return (squared * counts).sum() / counts.sum().clamp_min(1)
