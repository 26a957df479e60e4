"""What the models are trained on, of one window."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedScene:
    """``SceneFeatures`` with futures and candidates as D numbers each, their latents.

    P pieces, A agents, M and K neighbours, C candidates. Float arrays are float32;
    indices are -1 where there is none. Valid candidates come first in each row.
    """

    piece_pose: Float[np.ndarray, "P 3"]
    """x, y, heading, around the middle of the scene."""
    piece_shape: Float[np.ndarray, "P F"]
    piece_kind: Int[np.ndarray, "P"]
    agent_pose: Float[np.ndarray, "A 3"]
    agent_speed: Float[np.ndarray, "A"]
    agent_size: Float[np.ndarray, "A 2"]
    agent_kind: Int[np.ndarray, "A"]
    near_pieces: Int[np.ndarray, "A M"]
    near_agents: Int[np.ndarray, "A K"]
    candidates: Float[np.ndarray, "A C D"]
    """Zero where ``has_candidate`` is false."""
    has_candidate: Bool[np.ndarray, "A C"]
    future: Float[np.ndarray, "A D"]
    """Zero where ``has_future`` is false."""
    has_future: Bool[np.ndarray, "A"]
