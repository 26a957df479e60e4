"""Training objective of each stage: network, losses, first weights and statistics."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.run_config import OwnSamplesConfig
from pd_editor.experiments.training.run_folder import MODEL_NAME
from pd_editor.experiments.training.settings import LOSSES, with_settings
from pd_editor.experiments.training.train_loop import Loss
from pd_editor.generation.checkpoints.model_folder import (
    StageKind,
    TrainedModel,
    load_model,
    made_model,
)
from pd_editor.generation.checkpoints.tensor_file import config_from_json
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.core.sampler import DifferentiableSampler
from pd_editor.generation.features.feature_store import FeatureStore
from pd_editor.generation.features.map_pieces import (
    BOUNDARY_LENGTH_M,
    BOUNDARY_SHAPE,
)
from pd_editor.generation.features.scene_features import PEDESTRIAN, PackedScene
from pd_editor.generation.initial_state.loss import (
    InitialStateLossConfig,
    initial_state_loss,
    training_task,
)
from pd_editor.generation.initial_state.network.agent_count_prior import (
    MOST_ROWS,
    fit_agent_counts,
)
from pd_editor.generation.initial_state.network.conditioning import Conditioning
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.lane_distance import follows_lanes
from pd_editor.generation.initial_state.network.state_encoding import (
    POSITION_UNIT_M,
    unit_vectors,
)
from pd_editor.generation.initial_state.noisy_traffic import (
    fit_moments,
    measured_clean_variance,
)
from pd_editor.generation.initial_state.sampler import sample_initial_states
from pd_editor.generation.inputs import SceneTensors, TrajectoryBasis
from pd_editor.generation.stages import INITIAL_STATES, STAGE_KINDS, TRAJECTORIES
from pd_editor.generation.trajectory.guidance.latent_motion import depth_m
from pd_editor.generation.trajectory.loss import (
    HELD_M,
    TrajectoryLossConfig,
    trajectory_loss,
    with_unknown_activity,
)
from pd_editor.generation.trajectory.network.decoding import TrajectoryDecoder
from pd_editor.generation.trajectory.network.denoiser import TrajectoryDenoiser
from pd_editor.generation.trajectory.network.features import Neighbors
from pd_editor.generation.trajectory.sampler import (
    GivenTrajectories,
    TrajectoryNoise,
    sample_trajectories,
)

_ON_ROAD_M: Final = 0.5
"""Centres count as off the road that are nearer to its edge."""


def trajectory_samples_loss(
    model: TrajectoryDenoiser,
    scene: SceneTensors,
    random: torch.Generator,
    config: OwnSamplesConfig,
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """Loss of samples of the default number of steps, and its parts before weighting.

    As in the loss of denoising, some agents are given, and some activities unknown.
    """
    task = TrajectoryLossConfig()
    scene = with_unknown_activity(scene, random, task)
    share = torch.rand(scene.num_scenes, 1, generator=random)
    has_given = torch.rand(scene.num_scenes, 1, generator=random) < task.given_scenes
    chance = torch.rand(scene.has_agent.shape, generator=random)
    is_given = (has_given & (chance < share)).to(scene.has_agent.device)
    is_given = is_given & scene.has_future
    seed = int(torch.randint(2**31, (), generator=random))
    *_, last = sample_trajectories(
        model,
        scene,
        TrajectoryNoise(
            samples=range(config.num_samples),
            seed=seed,
            # Each sample is a try of its own: independent of the others.
            num_tries=config.num_samples,
        ),
        GivenTrajectories(is_given, scene.future),
        sampler=DifferentiableSampler(num_steps=config.num_gradient_steps),
    )
    latent, is_sampled = last.clean, scene.has_agent & ~is_given
    count = config.num_samples * is_sampled.sum().clamp_min(1)
    parts: dict[str, Tensor] = {}
    if config.collision:
        neighbors = Neighbors.of(scene, model.config.num_near_agents)
        depth = collision_depth_m(
            model.decoder, latent, neighbors, scene, config.margin_m
        )
        parts["collision"] = (depth * is_sampled[..., None]).sum() / count
    if config.road:
        off = off_road_m(model.decoder, latent, scene)
        parts["road"] = (off * is_sampled).sum() / count
    if config.truth:
        parts["truth"] = energy_score_m(
            model.decoder, latent, scene.future, is_sampled & scene.has_future
        )
    weighted = [getattr(config, name) * part for name, part in parts.items()]
    loss = sum(weighted, latent.new_zeros(()))
    return loss, {name: part.detach() for name, part in parts.items()}


def collision_depth_m(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    neighbors: Neighbors,
    scene: SceneTensors,
    margin_m: float,
) -> Float[Tensor, "S B A K_minus_1"]:
    """Depth to which each agent's box overlaps those of neighbours when they first meet.

    Later, when one is inside the other, the shortest way out is to the side; at the first
    contact it is to brake. Pairs that overlap at the current step do not count, nor do
    pairs of pedestrians.
    """
    x, y, course = _motion(decoder, latent, scene.agent_speed)
    near = neighbors.row_of_all()[:, :, 1:].flatten(0, 1)
    pose = neighbors.pose[:, :, 1:].flatten(0, 1)[..., None, :]
    their_x, their_y, their_course = (
        one.flatten(1, 2).index_select(1, near.flatten()).unflatten(1, near.shape)
        for one in (x, y, course)
    )
    cos, sin = pose[..., 2], pose[..., 3]
    offset = torch.stack(
        [
            cos * their_x - sin * their_y + pose[..., 0] - x.flatten(1, 2)[:, :, None],
            sin * their_x + cos * their_y + pose[..., 1] - y.flatten(1, 2)[:, :, None],
        ],
        dim=-1,
    )
    size = scene.agent_size.flatten(0, 1)
    depth = depth_m(
        offset,
        (course.flatten(1, 2)[:, :, None], torch.atan2(sin, cos) + their_course),
        (size[:, None, None], size[near][:, :, None]),
    )
    depth = depth + margin_m
    contact = (depth.detach() > 0).to(depth).argmax(dim=-1, keepdim=True)
    at_contact = depth.gather(-1, contact)[..., 0].clamp_min(0)
    walks = (scene.agent_kind == PEDESTRIAN).flatten()
    counts = neighbors.exists[:, :, 1:].flatten(0, 1) & (depth[..., 0] < 0)
    counts = counts & ~(walks[:, None] & walks[near])
    found = torch.where(counts, at_contact, 0.0)
    return found.unflatten(1, scene.has_agent.shape)


def off_road_m(
    decoder: TrajectoryDecoder, latent: Float[Tensor, "S B A 10"], scene: SceneTensors
) -> Float[Tensor, "S B A"]:
    """Mean distance in time off the drivable area of vehicles that are on it now."""
    x, y, _ = _motion(decoder, latent, scene.agent_speed, 4)
    forward = torch.polar(torch.ones_like(scene.agent_speed), scene.agent_pose[..., 2])
    place = torch.complex(*scene.agent_pose[..., :2].unbind(-1))
    # [S B A T], then a last axis for the pieces of the boundary.
    point = (place[..., None] + torch.complex(x, y) * forward[..., None])[..., None]
    pose = scene.boundary_pose[:, None, None]
    middle = torch.complex(pose[..., 0], pose[..., 1])
    axis = torch.polar(torch.ones_like(pose[..., 2]), pose[..., 2])
    length = scene.boundary_shape[..., BOUNDARY_SHAPE.index("length")]
    half = 0.5 * BOUNDARY_LENGTH_M * length[:, None, None]
    local = (point - middle) * axis.conj()
    beyond = (local.real.abs() - half).clamp_min(0)
    squared = beyond.square() + local.imag.square()
    exists = scene.has_boundary[:, None, None]
    nearest = torch.where(exists, squared, torch.inf).argmin(dim=-1, keepdim=True)
    inside = local.imag.expand_as(squared).gather(-1, nearest)[..., 0]
    distance = (squared.gather(-1, nearest)[..., 0] + 1e-6).sqrt()
    off = torch.where(inside < 0, distance, -distance) + _ON_ROAD_M
    counts = follows_lanes(scene) & scene.has_boundary.any(dim=-1, keepdim=True)
    # Further off the road is other ground, or the map ends.
    counts = counts[..., None] & (off[..., :1] < 0) & (off < 3.0)
    return torch.where(counts, off.clamp_min(0), 0.0)[..., 1:].mean(dim=-1)


def energy_score_m(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    true: Float[Tensor, "B A 10"],
    counts: Bool[Tensor, "B A"],
) -> Float[Tensor, ""]:
    """Mean energy score of agents: distance to the truth, less half that of samples.

    The distance of two trajectories is the root of the mean square distance in time.

    Source: Gneiting and Raftery, Strictly proper scoring rules, 2007.
    """
    weight = decoder.get_buffer("scale_m").square() / decoder.num_steps

    def distance(one: Tensor, other: Tensor) -> Tensor:
        return ((one - other).square() @ weight + 1e-4).sqrt()

    score = distance(latent, true).mean(dim=0)
    num_samples = len(latent)
    if num_samples > 1:
        apart = [
            distance(latent[i], latent[j])
            for i in range(num_samples)
            for j in range(i + 1, num_samples)
        ]
        score = score - 0.5 * torch.stack(apart).mean(dim=0)
    return (score * counts).sum() / counts.sum().clamp_min(1)


def _motion(
    decoder: TrajectoryDecoder,
    latent: Float[Tensor, "S B A 10"],
    speed: Float[Tensor, "B A"],
    stride: int = 1,
) -> tuple[Tensor, Tensor, Tensor]:
    """x, y and heading [S B A T] in each agent's own frame, the current step first."""
    # Boxes are compared every 0.2 s.
    steps = torch.linspace(0, decoder.num_steps, 31, device=latent.device)
    x, y = decoder.points(latent, speed, steps[1::stride].long() - 1)
    ahead_x = torch.diff(x, dim=-1, prepend=torch.zeros_like(x[..., :1])) + HELD_M
    ahead_y = torch.diff(y, dim=-1, prepend=torch.zeros_like(y[..., :1]))
    course = torch.atan2(ahead_y, ahead_x)
    now = (1, 0)
    return tuple(torch.nn.functional.pad(one, now) for one in (x, y, course))  # type: ignore[return-value]


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
    depth = state_collisions_m(last.clean, scene, task, config.margin_m)
    is_sampled = scene.has_agent & ~task.is_given
    count = config.num_samples * is_sampled.sum().clamp_min(1)
    collision = (depth.sum(dim=-1) * is_sampled).sum() / count
    return config.collision * collision, {"collision": collision.detach()}


def state_collisions_m(
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


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the model: network, loss and statistics."""

    kind: StageKind
    loss_type: type[Any]
    """Flat dataclass of the loss settings, the last argument of the loss."""
    configured_loss: Callable[
        [Any, Any, torch.Generator, float, Any],
        tuple[torch.Tensor, Mapping[str, torch.Tensor]],
    ]
    samples_loss: Callable[
        [Any, Any, torch.Generator, OwnSamplesConfig],
        tuple[torch.Tensor, Mapping[str, torch.Tensor]],
    ]
    with_basis: Callable[[Any, TrajectoryBasis], nn.Module]
    """Makes a new network for latents of a basis."""

    fit_statistics: Callable[[nn.Module, FeatureStore], None] = lambda _model, _store: (
        None
    )
    """Stores statistics of the data in the network."""
    measure: Callable[[nn.Module, FeatureStore], None] = lambda _model, _store: None
    """Stores in a trained network what its sampler needs to know of the data and of the
    network's errors."""

    def loss(
        self, settings: Mapping[str, Any], own_samples: Mapping[str, Any] | None = None
    ) -> Loss:
        """Loss with some settings; the others have their defaults.

        With a weight of the network's own samples, their loss is added.

        Raises:
            ModelError: a setting is unknown or invalid.
        """
        usual = asdict(self.loss_type())
        config = config_from_json(self.loss_type, usual | dict(settings), "loss")
        samples = with_settings(OwnSamplesConfig(), own_samples or {}, "own_samples")

        def loss(
            model: Any, batch: Any, random: torch.Generator, progress: float
        ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
            found, parts = self.configured_loss(model, batch, random, progress, config)
            if not samples.weight:
                return found, parts
            added, further = self.samples_loss(model, batch, random, samples)
            return found + samples.weight * added, {
                **parts,
                **{f"own_{name}": part for name, part in further.items()},
            }

        return loss

    def fresh_model(self, config: Any, basis: TrajectoryBasis, seed: int) -> nn.Module:
        """Randomly initialised network; the seed determines its weights."""
        kind = replace(
            self.kind, make_model=lambda given: self.with_basis(given, basis)
        )
        return made_model(kind, config, seed=seed)


def _count_agents(model: nn.Module, store: FeatureStore) -> None:
    assert isinstance(model, InitialStateDenoiser)
    model.set_agent_counts(fit_agent_counts(_some(store, MOST_ROWS)))


def _measure(model: nn.Module, store: FeatureStore) -> None:
    assert isinstance(model, InitialStateDenoiser)
    moments = fit_moments(model, _some(store, MOST_ROWS))
    model.get_buffer("state_moments").copy_(moments)
    # Number of scenes on which errors are measured.
    variance = measured_clean_variance(model, _some(store, 64))
    model.get_buffer("clean_variance").copy_(variance)


def _some(store: FeatureStore, most: int) -> Iterator[PackedScene]:
    """At most so many scenes, from everywhere in a store."""
    step = max(-(-len(store) // most), 1)
    return (store[index] for index in range(0, len(store), step))


def _trajectory_loss(
    model: nn.Module,
    batch: SceneTensors,
    random: torch.Generator,
    _progress: float,
    config: TrajectoryLossConfig,
) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
    assert isinstance(model, TrajectoryDenoiser)
    return trajectory_loss(model, batch, random, config)


STAGES: Final[Mapping[str, Stage]] = {
    "init": Stage(
        kind=INITIAL_STATES,
        loss_type=LOSSES["init"],
        configured_loss=initial_state_loss,
        samples_loss=initial_state_samples_loss,
        with_basis=lambda config, _: INITIAL_STATES.make_model(config),
        fit_statistics=_count_agents,
        measure=_measure,
    ),
    "traj": Stage(
        kind=TRAJECTORIES,
        loss_type=LOSSES["traj"],
        configured_loss=_trajectory_loss,
        samples_loss=trajectory_samples_loss,
        with_basis=TrajectoryDenoiser,
    ),
}


def starting_model(folder: Path) -> TrainedModel:
    """Load the model of a folder, which may be that of a run.

    Raises:
        ModelError: the folder holds no model.
    """
    inner = folder / MODEL_NAME
    return load_model(inner if os.path.isdir(inner) else folder, STAGE_KINDS)


def basis_of(model: TrainedModel) -> TrajectoryBasis | None:
    """Trajectory basis of a model; None without the trajectory stage."""
    stage = model.stages.get(TRAJECTORIES.name)
    if stage is None:
        return None
    assert isinstance(stage.model, TrajectoryDenoiser)
    return stage.model.decoder.basis


def start_from(model: nn.Module, earlier: Mapping[str, Tensor], source: object) -> None:
    """Initialise a network with the weights of an earlier, possibly smaller one.

    Tensors of the same name and shape are copied. Of larger tensors, the earlier part is
    copied; new columns (inputs) are zero, so that they have no effect at first; new rows
    (outputs) keep their random initialisation.

    Raises:
        TrainingError: a tensor is smaller than before, or has other axes.
    """
    own = model.state_dict()
    with torch.no_grad():
        for name, old in earlier.items():
            new = own.get(name)
            if new is None:
                continue
            grown = new.ndim == old.ndim and all(
                mine >= theirs
                for mine, theirs in zip(new.shape, old.shape, strict=False)
            )
            if not grown:
                raise TrainingError(
                    f"{source}: {name} is of shape {tuple(old.shape)}, and this network "
                    f"has {tuple(new.shape)}; a run can start from smaller networks only."
                )
            if new.ndim == 2:
                new[: old.shape[0], old.shape[1] :] = 0
            new[tuple(slice(size) for size in old.shape)] = old.to(new)
