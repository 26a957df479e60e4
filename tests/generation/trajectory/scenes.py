"""Small made-up scenes for the tests of the second stage."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import torch

from pd_editor.generation.core.noise_schedule import NoiseSchedule
from pd_editor.generation.core.sampler import (
    Denoise,
    SamplerConfig,
    SamplerStep,
    sample_steps,
)
from pd_editor.generation.features.map_pieces import BOUNDARY_SHAPE, PIECE_SHAPE
from pd_editor.generation.features.scene_features import PackedScene
from pd_editor.generation.inputs import (
    SceneTensors,
    TrajectoryBasis,
    batch_of,
)
from pd_editor.generation.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.scene.agent_kind import Activity

# More threads than free cores make tiny networks many times slower.
torch.set_num_threads(1)

TIME_S = 0.1 * np.arange(1, 60)
PLAIN = {
    "num_near_agents": 8,
    "sees_gaps": False,
    "sees_signals": False,
    "sees_boundary": False,
    "sees_activity": False,
    "knows_leaders": False,
}
"""Configuration of networks with few inputs."""


def futures(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Arcs with all kinds of speeds, accelerations and turns: [N 59 2], speeds [N]."""
    random = np.random.default_rng(seed)
    speed = random.uniform(0, 15, count) * (random.random(count) < 0.7)
    gain = random.normal(0, 1, count) * (speed > 0)
    along = np.maximum(speed[:, None] + 0.5 * gain[:, None] * TIME_S, 0) * TIME_S
    turn = random.normal(0, 0.01, count)[:, None] * along
    shape = np.stack([np.sinc(turn / np.pi), np.sin(turn / 2) ** 2 * 2], axis=-1)
    shape[..., 1] /= np.where(turn == 0, 1, turn)
    return along[..., None] * shape, speed


@cache
def arc_basis() -> TrajectoryBasis:
    return TrajectoryBasis.fit(*futures(500, seed=9))


def packed_scene(num_agents: int, num_pieces: int = 30, seed: int = 0) -> PackedScene:
    """Agents anywhere, with candidates and futures; the last agent has no future."""
    random = np.random.default_rng(seed)
    basis = arc_basis()
    future, speed = futures(num_agents, seed)
    pose = np.column_stack(
        [random.uniform(-20, 20, (num_agents, 2)), random.uniform(-3, 3, num_agents)]
    )
    pieces = np.column_stack(
        [random.uniform(-40, 40, (num_pieces, 2)), random.uniform(-3, 3, num_pieces)]
    )
    candidates = random.normal(0, 1, (num_agents, 24, 10))
    has_candidate = np.arange(24) < random.integers(0, 24, num_agents)[:, None]
    has_future = np.arange(num_agents) < max(num_agents - 1, 1)
    near = np.argsort(np.hypot(*(pieces[None, :, :2] - pose[:, None, :2]).T).T, axis=1)
    near_pieces = np.full((num_agents, 24), -1)
    near_pieces[:, : min(24, num_pieces)] = near[:, :24]
    gap = np.hypot(*(pose[None, :, :2] - pose[:, None, :2]).T).T
    np.fill_diagonal(gap, np.inf)
    near_agents = np.full((num_agents, 16), -1)
    count = min(16, num_agents - 1)
    near_agents[:, :count] = np.argsort(gap, axis=1)[:, :count]
    other = np.random.default_rng([seed, 1])
    boundary = pieces + np.array([0.0, 4.0, 0.0])
    near_boundary = near_pieces[:, :8]
    return PackedScene(
        piece_pose=pieces.astype(np.float32),
        piece_shape=random.normal(0, 1, (num_pieces, len(PIECE_SHAPE))).astype("f4"),
        piece_kind=random.integers(0, 4, num_pieces),
        piece_signal=np.linspace(0, 1, 2 * num_pieces, dtype="f4").reshape(-1, 2),
        boundary_pose=boundary.astype(np.float32),
        boundary_shape=other.normal(0, 1, (num_pieces, len(BOUNDARY_SHAPE))).astype(
            np.float32
        ),
        agent_pose=pose.astype(np.float32),
        agent_speed=speed.astype(np.float32),
        agent_size=np.tile(np.float32([4.6, 1.9]), (num_agents, 1)),
        agent_kind=random.integers(0, 5, num_agents),
        agent_activity=other.integers(0, len(Activity), num_agents),
        near_pieces=near_pieces,
        near_boundary=near_boundary,
        near_agents=near_agents,
        candidates=(candidates * has_candidate[..., None]).astype(np.float32),
        has_candidate=has_candidate,
        future=(basis.encode(future, speed) * has_future[:, None]).astype(np.float32),
        has_future=has_future,
    )


def scene_batch(*counts: int, seed: int = 0) -> SceneTensors:
    """A scene for each number of agents."""
    return batch_of(
        [packed_scene(n, 20 + 3 * n, seed + i) for i, n in enumerate(counts)]
    )


def small_model(seed: int = 0, **changes: object) -> TrajectoryDenoiser:
    """A tiny network with random weights."""
    torch.manual_seed(seed)
    values = {"width": 32, "num_heads": 2, "num_blocks": 2, "edge_width": 16}
    config = TrajectoryConfig(**(values | changes))  # type: ignore[arg-type]
    model = TrajectoryDenoiser(config, arc_basis()).eval()
    # Fresh null tokens are zero, which would hide what they do.
    torch.nn.init.normal_(model.map_tokens.null_token)
    torch.nn.init.normal_(model.candidate_tokens.null_token)
    return model


def ancestral(
    denoise: Denoise,
    start: torch.Tensor,
    schedule: NoiseSchedule,
    levels: Sequence[float],
    config: SamplerConfig,
    fresh_noise: Callable[[], torch.Tensor],
) -> Iterator[SamplerStep]:
    """A sampler that draws fresh noise in each step."""
    config = replace(config, eta=1.0)
    return sample_steps(denoise, start, schedule, levels, config, fresh_noise)
