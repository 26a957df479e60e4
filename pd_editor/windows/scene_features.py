"""What both stages of the model see of a scene, as plain arrays."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneFeatures:
    """P pieces of lanes, W crosswalks and A road users at the current step.

    Poses are x, y, heading in the scene frame moved to ``center_m``. Agents are all
    road users present at the current step, in the order of the scenario. Indices are
    -1 where there is none.
    """

    center_m: Float[np.ndarray, "2"]
    piece_pose: Float[np.ndarray, "P 3"]
    """Middle of each piece of about 10 m of a centre line, and its direction there."""
    piece_shape: Float[np.ndarray, "P F"]
    """Length, turn, width and so on: see ``PIECE_SHAPE``."""
    piece_kind: Int[np.ndarray, "P"]
    """0 vehicle, 1 bike, 2 bus lane, 3 crosswalk (one per direction)."""
    agent_row: Int[np.ndarray, "A"]
    """Row of each agent in the scenario."""
    agent_pose: Float[np.ndarray, "A 3"]
    agent_speed: Float[np.ndarray, "A"]
    agent_size: Float[np.ndarray, "A 2"]
    agent_kind: Int[np.ndarray, "A"]
    """Index into ``AGENT_KINDS``."""
    near_pieces: Int[np.ndarray, "A M"]
    """The M pieces nearest to each agent, nearest first."""
    near_agents: Int[np.ndarray, "A K"]
    """The K other agents nearest to each agent, nearest first."""
    candidate_m: Float[np.ndarray, "A C H 2"]
    """Candidates at the H future steps, in the frame of the agent's current pose."""
    has_candidate: Bool[np.ndarray, "A C"]
    future_m: Float[np.ndarray, "A H 2"]
    """Recorded positions at the future steps, in the frame of the agent's pose."""
    has_future: Bool[np.ndarray, "A"]
    """Whether every future step is recorded; never true of a scenario without."""
