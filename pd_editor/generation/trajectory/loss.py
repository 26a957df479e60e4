"""Training loss of the trajectory network."""

from dataclasses import dataclass, replace
from typing import Final, Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.generation.core.devices import constant
from pd_editor.generation.core.noise_schedule import noised
from pd_editor.generation.inputs import SceneTensors
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.network.features import Neighbors
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.thresholds import STANDING_MPS

_MOST_OVERLAP_LEVEL: Final = 0.5
"""Above this level predictions are means over modes, which may overlap."""
_DISCS: Final = (-1.0, 0.0, 1.0)
HELD_M: Final = 0.2
"""An agent that moves less between two steps keeps its heading."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryLossConfig:
    """Sampling of training tasks, and the weights of the loss."""

    num_levels: int = 4
    """Noise levels per scene; they share the scene's context."""
    given_scenes: float = 0.3
    """Share of scenes with a random part of the agents given clean."""
    metre_share: float = 0.5
    """Weight of errors in metres relative to errors of latents."""
    early_prediction_weight: float = 0.2
    """Weight of the predictions of all blocks but the last one."""
    overlap_weight: float = 2.0
    """Weight of the overlap of predicted boxes."""
    starting_weight: float = 1.0
    """Weight of stationary agents that start, which makes starts more likely."""
    counted_error: Literal["clean", "noise"] = "clean"
    """Whether the error of the clean latents counts, relative to the noise but at most
    five times, or that of the noise, as in the paper."""
    unknown_scenes: float = 0.4
    """Share of scenes without known activities."""
    unknown_agents: float = 0.2
    """Share of agents whose activity is unknown in the other scenes."""


def trajectory_loss(
    model: TrajectoryDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    config: TrajectoryLossConfig | None = None,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Mean squared error of clean trajectories at random levels, and its parts.

    Agents without a complete trajectory are in the scene, at level 1, but not in the loss.

    Returns:
        The loss, and terms before weighting: latent, metres (mean square distance of
        points), early, overlap (mean square depth in metres of those near the truth).
    """
    config = TrajectoryLossConfig() if config is None else config
    scene = with_unknown_activity(scene, random, config)
    level, is_sampled = _levels(scene, random, config)
    clean = scene.future
    shape = (config.num_levels, *clean.shape)
    noise = torch.randn(shape, generator=random).to(clean, non_blocking=True)
    noisy = torch.where(
        scene.has_future[..., None],
        noised(model.schedule, clean, noise, level[..., None]),
        noise,
    )
    context = model.encode_context(scene)
    predictions = model.predictions(noisy, model.encode_level(level), context)
    weight = _weight(model, scene, level, is_sampled, config)
    scale = model.decoder.get_buffer("scale_m")
    mixed = _component_weights(scale, config.metre_share)

    def error(prediction: Tensor, components: Tensor) -> Tensor:
        squared = (prediction - clean).square() @ components
        return (squared * weight).sum()

    metres = scale.square() / model.decoder.num_steps
    early = [error(one, mixed) for one in predictions[:-1]]
    parts = {
        "latent": error(predictions[-1], torch.full_like(scale, 1 / len(scale))),
        "metres": error(predictions[-1], metres),
        "early": torch.stack(early).mean() if early else weight.new_zeros(()),
    }
    loss = (
        error(predictions[-1], mixed) + config.early_prediction_weight * parts["early"]
    )
    if config.overlap_weight:
        few = int(config.num_levels * _MOST_OVERLAP_LEVEL) or 1
        last = predictions[-1][:few]
        error_m = ((last - clean).square() @ metres).detach().sqrt()
        # Overlap does not count for trajectories with larger errors: early in the
        # training it would prevent learning.
        is_near = (level[:few] < _MOST_OVERLAP_LEVEL) & (error_m < 1.5)
        parts["overlap"] = _overlap(
            model.decoder, last, scene, context.neighbors, is_near, is_sampled
        )
        loss = loss + config.overlap_weight * parts["overlap"]
    return loss, {name: part.detach() for name, part in parts.items()}


def _weight(
    model: TrajectoryDenoiser,
    scene: SceneTensors,
    level: Float[Tensor, "S B A"],
    is_sampled: Bool[Tensor, "*#S B A"],
    config: TrajectoryLossConfig,
) -> Float[Tensor, "S B A"]:
    """Weight of each agent's error at its level; 0 for given ones."""
    noise_share = model.schedule.sigma(level).square()
    if config.counted_error == "noise":
        ratio = model.schedule.alpha(level).square() / noise_share
        # Given agents have no noise.
        weight = torch.where(is_sampled, ratio, 0.0)
    else:
        # Least noise variance by which errors are weighted: near level 0 all errors are
        # small.
        weight = is_sampled / noise_share.clamp_min(0.2)
    weight = weight / (is_sampled.sum() * config.num_levels).clamp_min(1)
    return torch.where(starts(model, scene), config.starting_weight * weight, weight)


def _overlap(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    scene: SceneTensors,
    neighbors: Neighbors,
    is_near: Bool[Tensor, "S B A"],
    is_sampled: Bool[Tensor, "*#S B A"],
) -> Float[Tensor, ""]:
    """Mean square depth of overlaps of agents near the truth that it does not have."""
    depth = overlap_depth_m(decoder, latent, neighbors, scene)
    there = overlap_depth_m(decoder, scene.future[None], neighbors, scene)
    # Both agents of a pair: one with a large error must not push others away.
    both = is_near.flatten(1)[:, neighbors.row_of_all()[:, :, 1:]]
    squared = ((depth - there).clamp_min(0).square() * both).sum(-1)
    counts = is_sampled * is_near
    return (squared * counts).sum() / counts.sum().clamp_min(1)


def starts(model: TrajectoryDenoiser, scene: SceneTensors) -> Bool[Tensor, "B A"]:
    """Stationary agents that are displaced at the end of their trajectory."""
    end = model.decoder.num_steps
    last = torch.arange(end - 1, end, device=scene.future.device)
    x, y = model.decoder.points(scene.future, scene.agent_speed, last)
    # Least final displacement of a stationary agent that starts.
    has_left = torch.hypot(x, y)[..., 0] > 2.0
    return has_left & (scene.agent_speed < STANDING_MPS) & scene.has_future


def _levels(
    scene: SceneTensors, random: torch.Generator, config: TrajectoryLossConfig
) -> tuple[Float[Tensor, "S B A"], Bool[Tensor, "B A"]]:
    """Sample the noise level of each agent, and which agents are denoised.

    Levels are stratified over the versions of a scene; given agents are at 0.
    """
    device = scene.has_agent.device

    def chance(*shape: int) -> Tensor:
        return torch.rand(shape, generator=random).to(device, non_blocking=True)

    scenes = scene.num_scenes
    offset = chance(config.num_levels, scenes)
    level = torch.arange(config.num_levels, device=device)[:, None] + offset
    level = (level / config.num_levels).clamp_min(1e-3)
    part = torch.where(
        chance(scenes) < config.given_scenes, chance(scenes), torch.zeros(())
    )
    is_given = scene.has_future & (chance(*scene.has_agent.shape) < part[:, None])
    each = level[..., None].expand(-1, -1, scene.has_agent.shape[1])
    each = torch.where(scene.has_future, each, torch.ones_like(each))
    each = torch.where(is_given, torch.zeros_like(each), each)
    return each, scene.has_future & ~is_given


def with_unknown_activity(
    scene: SceneTensors, random: torch.Generator, config: TrajectoryLossConfig
) -> SceneTensors:
    """Make some activities unknown, as those of recorded agents are."""
    activity = scene.agent_activity
    unknown = torch.rand(len(activity), 1, generator=random) < config.unknown_scenes
    unknown = unknown | (
        torch.rand(activity.shape, generator=random) < config.unknown_agents
    )
    unknown = unknown.to(activity.device, non_blocking=True)
    return replace(
        scene, agent_activity=activity.masked_fill(unknown, Activity.UNKNOWN)
    )


def _component_weights(
    scale_m: Float[Tensor, "10"], metre_share: float
) -> Float[Tensor, "10"]:
    # Weighted by scale, not by its square, with which only the first would count.
    by_scale = scale_m / scale_m.sum()
    return metre_share * by_scale + (1 - metre_share) / len(scale_m)


def overlap_depth_m(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    neighbors: Neighbors,
    scene: SceneTensors,
) -> Float[Tensor, "S B A K"]:
    """Largest overlap depth over time of each agent with each of its K neighbours."""
    flat = latent.flatten(1, 2)
    x, y = _disc_centers(
        decoder, flat, scene.agent_speed.flatten(), scene.agent_size.flatten(0, 1)
    )
    near = neighbors.row_of_all()[:, :, 1:].flatten(0, 1)
    pose = neighbors.pose[:, :, 1:].flatten(0, 1)[..., None, None, :]
    rows = near.flatten()
    their_x = x.index_select(1, rows).unflatten(1, near.shape)
    their_y = y.index_select(1, rows).unflatten(1, near.shape)
    gap_x = pose[..., 2] * their_x - pose[..., 3] * their_y + pose[..., 0]
    gap_y = pose[..., 3] * their_x + pose[..., 2] * their_y + pose[..., 1]
    own_x, own_y = x[:, :, None, :, :, None], y[:, :, None, :, :, None]
    distance = torch.sqrt(
        (gap_x[..., None, :] - own_x).square()
        + (gap_y[..., None, :] - own_y).square()
        + 1e-4
    )
    radius = 0.5 * scene.agent_size[..., 1].flatten()
    reach = radius[:, None] + radius[near]
    depth = (reach - distance.amin(dim=(-1, -2, -3))).clamp_min(0)
    depth = torch.where(neighbors.exists[:, :, 1:].flatten(0, 1), depth, 0.0)
    return depth.unflatten(1, latent.shape[1:3])


def _disc_centers(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S G 10"],
    speed: Float[Tensor, "G"],
    size: Float[Tensor, "G 2"],
) -> tuple[Float[Tensor, "S G T D"], Float[Tensor, "S G T D"]]:
    """Centres of the discs along each box, in the frame of its agent's current pose."""
    steps = torch.linspace(0, decoder.num_steps, 13, device=latent.device)
    x, y = decoder.points(latent, speed, steps[1:].long() - 1)
    ahead_x = torch.diff(x, dim=-1, prepend=torch.zeros_like(x[..., :1])) + HELD_M
    ahead_y = torch.diff(y, dim=-1, prepend=torch.zeros_like(y[..., :1]))
    length = torch.sqrt(ahead_x.square() + ahead_y.square() + 1e-6)
    half = 0.5 * (size[:, 0] - size[:, 1]).clamp_min(0)
    along = half[:, None, None] * constant(_DISCS, latent)
    return (
        x[..., None] + (ahead_x / length)[..., None] * along,
        y[..., None] + (ahead_y / length)[..., None] * along,
    )
