"""Small made-up scenes for the tests of the first stage."""

from typing import Any

import numpy as np
import torch

from pd_editor.generation.features.map_pieces import BOUNDARY_SHAPE, PIECE_SHAPE
from pd_editor.generation.features.scene_features import PackedScene
from pd_editor.generation.initial_state.network.denoiser import (
    InitialStateConfig,
    InitialStateDenoiser,
)
from pd_editor.generation.initial_state.pipeline import place_in_squares
from pd_editor.generation.inputs import SceneTensors, batch_of
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.scenario import Scenario

torch.set_num_threads(1)

SIZES = np.array([[4.6, 1.9], [12, 2.9], [2.1, 0.8], [1.8, 0.7], [0.7, 0.8]], float)


def packed_scene(
    num_agents: int, num_pieces: int = 12, seed: int = 0, *, kinds: int = 5
) -> PackedScene:
    """Agents on and beside a street along x, 3.5 m to each side of the middle."""
    random = np.random.default_rng(seed)
    along = np.linspace(-60, 60, num_pieces)
    side = np.where(np.arange(num_pieces) % 2, 1.0, -1.0)
    pieces = np.column_stack([along, 1.75 * side, np.where(side > 0, np.pi, 0.0)])
    shape = np.tile(np.linspace(0.5, 1, len(PIECE_SHAPE)), (num_pieces, 1))
    kind = random.integers(0, kinds, num_agents)
    pose = np.column_stack(
        [
            random.uniform(-58, 58, num_agents),
            random.normal(0, 3, num_agents),
            random.uniform(-np.pi, np.pi, num_agents),
        ]
    )
    speed = np.where(random.random(num_agents) < 0.5, 0.0, random.uniform(1, 15))
    other = np.random.default_rng([seed, 1])
    boundary = np.column_stack(
        [pieces[:, :2] + other.normal(0, 4, (num_pieces, 2)), pieces[:, 2]]
    )
    activity = np.where(speed > 0, Activity.DRIVING, other.integers(0, 3, num_agents))
    return PackedScene(
        piece_pose=pieces.astype(np.float32),
        piece_shape=shape.astype(np.float32),
        piece_kind=(np.arange(num_pieces) % 4),
        piece_signal=np.linspace(0, 1, 2 * num_pieces, dtype="f4").reshape(-1, 2),
        boundary_pose=boundary.astype(np.float32),
        boundary_shape=other.normal(0, 1, (num_pieces, len(BOUNDARY_SHAPE))).astype(
            np.float32
        ),
        agent_pose=pose.astype(np.float32),
        agent_speed=speed.astype(np.float32),
        agent_size=SIZES[kind].astype(np.float32),
        agent_kind=kind,
        agent_activity=activity,
        near_pieces=np.full((num_agents, 24), -1),
        near_boundary=np.full((num_agents, 8), -1),
        near_agents=np.full((num_agents, 16), -1),
        candidates=np.zeros((num_agents, 0, 10), np.float32),
        has_candidate=np.zeros((num_agents, 0), bool),
        future=np.zeros((num_agents, 10), np.float32),
        has_future=np.zeros(num_agents, bool),
    )


def scene_batch(*counts: int, seed: int = 0) -> SceneTensors:
    """A scene for each number of agents."""
    return batch_of(
        [packed_scene(n, 12 + 3 * n, seed + i) for i, n in enumerate(counts)]
    )


def trained_a_little(model: InitialStateDenoiser) -> InitialStateDenoiser:
    """With small random numbers instead of the zeros that some layers begin with."""
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
    return model


def small_model(
    *, is_ordered: bool = False, is_differential: bool = True, seed: int = 0
) -> InitialStateDenoiser:
    """A tiny network with random weights."""
    torch.manual_seed(seed)
    config = InitialStateConfig(
        width=32,
        num_heads=2,
        num_layers=2,
        num_near_pieces=6,
        relation_width=16,
        is_ordered=is_ordered,
        is_differential=is_differential,
    )
    return InitialStateDenoiser(config).eval()


def placed_states(*given: Any, **more: Any) -> list[Scenario]:
    """What ``place_in_squares`` returns."""
    steps = place_in_squares(*given, **more)
    try:
        while True:
            next(steps)
    except StopIteration as stop:
        return stop.value
