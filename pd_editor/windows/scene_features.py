"""What both stages of the model see of a scene, as plain arrays."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind

AGENT_KINDS: Final = (
    AgentKind.VEHICLE,
    AgentKind.BUS,
    AgentKind.MOTORCYCLIST,
    AgentKind.CYCLIST,
    AgentKind.PEDESTRIAN,
)
NUM_PIECE_KINDS: Final = 4
NUM_NEAR_PIECES: Final = 24
NUM_NEAR_AGENTS: Final = 8
NUM_CANDIDATES: Final = 24
NUM_FUTURE_STEPS: Final = 59
STEP_S: Final = 0.1
PIECE_LENGTH_M: Final = 10.0

PIECE_SHAPE: Final = (
    "length",
    "turn_before",
    "turn",
    "turn_after",
    "left_width",
    "right_width",
    "has_left",
    "has_right",
    "is_intersection",
    "has_successor",
    "has_predecessor",
    "branches",
)
"""What is told of each piece, scaled to about one.

Its length in tens of metres; the turns of the piece before, of itself and of the one
after in radians, left positive; the distances to both boundaries in units of 2 m;
whether there are lanes to both sides; whether its lane is in an intersection; whether
another piece follows it, leads to it; whether several follow it.
"""
MIRRORED_SHAPE: Final = (0, 1, 2, 3, 5, 4, 7, 6, 8, 9, 10, 11)
"""Where each number of ``PIECE_SHAPE`` comes from when the scene is mirrored."""
MIRRORED_SHAPE_SIGNS: Final = (1, -1, -1, -1, 1, 1, 1, 1, 1, 1, 1, 1)


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
