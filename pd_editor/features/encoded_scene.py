"""What the models are trained on, of one window."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.features.scene_features import SceneFeatures

LATENT_SIZE: Final = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedScene:
    """``SceneFeatures`` with futures and candidates as D numbers each, their latents.

    P pieces, E of the boundary, A agents, M, N and K neighbours, C candidates. Float arrays are float32;
    indices are -1 where there is none. Valid candidates come first in each row.
    """

    piece_pose: Float[np.ndarray, "P 3"]
    """x, y, heading, around the middle of the scene."""
    piece_shape: Float[np.ndarray, "P F"]
    piece_kind: Int[np.ndarray, "P"]
    boundary_pose: Float[np.ndarray, "E 3"]
    boundary_shape: Float[np.ndarray, "E G"]
    agent_pose: Float[np.ndarray, "A 3"]
    agent_speed: Float[np.ndarray, "A"]
    agent_size: Float[np.ndarray, "A 2"]
    agent_kind: Int[np.ndarray, "A"]
    agent_activity: Int[np.ndarray, "A"]
    near_pieces: Int[np.ndarray, "A M"]
    near_boundary: Int[np.ndarray, "A N"]
    near_agents: Int[np.ndarray, "A K"]
    candidates: Float[np.ndarray, "A C D"]
    """Zero where ``has_candidate`` is false."""
    has_candidate: Bool[np.ndarray, "A C"]
    future: Float[np.ndarray, "A D"]
    """Zero where ``has_future`` is false."""
    has_future: Bool[np.ndarray, "A"]


Encoder = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Latents of futures [.. H 2] at speeds, as ``TrajectoryBasis.encode`` makes them."""


def packed(features: SceneFeatures, encode: Encoder) -> PackedScene:
    """A scene with latents in the place of candidates and futures."""
    speed = features.agent_speed
    has_candidate, has_future = features.has_candidate, features.has_future
    candidates = np.zeros((*has_candidate.shape, LATENT_SIZE), np.float32)
    agent, slot = np.nonzero(has_candidate)
    candidates[agent, slot] = encode(features.candidate_m[agent, slot], speed[agent])
    future = np.zeros((len(speed), LATENT_SIZE), np.float32)
    future[has_future] = encode(features.future_m[has_future], speed[has_future])
    return PackedScene(
        piece_pose=features.piece_pose,
        piece_shape=features.piece_shape,
        piece_kind=features.piece_kind,
        boundary_pose=features.boundary_pose,
        boundary_shape=features.boundary_shape,
        agent_pose=features.agent_pose,
        agent_speed=features.agent_speed,
        agent_size=features.agent_size,
        agent_kind=features.agent_kind,
        agent_activity=features.agent_activity,
        near_pieces=features.near_pieces,
        near_boundary=features.near_boundary,
        near_agents=features.near_agents,
        candidates=candidates,
        has_candidate=has_candidate,
        future=future,
        has_future=has_future,
    )
