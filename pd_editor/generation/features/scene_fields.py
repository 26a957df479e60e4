"""The table of what both networks see of a scene; files and batches are built from it."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from pd_editor.generation.features.map_pieces import (
    BOUNDARY_SHAPE,
    PIECE_SHAPE,
    PIECE_SIGNAL,
)

NUM_NEAR_PIECES: Final = 24
NUM_NEAR_BOUNDARY: Final = 8
NUM_NEAR_AGENTS: Final = 16
LATENT_SIZE: Final = 10
Axis = Literal["piece", "boundary", "agent"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneTokens:
    """P pieces of lanes, E of the boundary and A road users at the current step.

    Poses are x, y, heading in the scene frame moved to the middle of the scene. Float
    arrays are float32. Indices are -1 where there is none.
    """

    piece_pose: Float[np.ndarray, "P 3"]
    """Middle of each piece of about 10 m of a centre line, and its direction there."""
    piece_shape: Float[np.ndarray, "P F"]
    """Length, turn, width and so on: see ``PIECE_SHAPE``."""
    piece_kind: Int[np.ndarray, "P"]
    """0 vehicle, 1 bike, 2 bus lane, 3 crosswalk (one per direction)."""
    piece_signal: Float[np.ndarray, "P S"]
    """What the signal ahead says: see ``PIECE_SIGNAL``."""
    boundary_pose: Float[np.ndarray, "E 3"]
    """Middle of each piece of the drivable area's boundary, the ground on its left."""
    boundary_shape: Float[np.ndarray, "E G"]
    """The numbers named by ``BOUNDARY_SHAPE``."""
    agent_pose: Float[np.ndarray, "A 3"]
    agent_speed: Float[np.ndarray, "A"]
    agent_size: Float[np.ndarray, "A 2"]
    agent_kind: Int[np.ndarray, "A"]
    """Index into ``AGENT_KINDS``."""
    agent_activity: Int[np.ndarray, "A"]
    """``Activity``, made to agree with the speed; 0 where it is unknown."""
    near_pieces: Int[np.ndarray, "A M"]
    """The M pieces nearest to each agent, nearest first."""
    near_boundary: Int[np.ndarray, "A N"]
    """The N pieces of the boundary nearest to each agent, nearest first."""
    near_agents: Int[np.ndarray, "A K"]
    """The K other agents nearest to each agent, nearest first."""


@dataclass(frozen=True, kw_only=True)
class SceneField:
    """A field of ``PackedScene``: an array with a row for each token of an axis."""

    name: str
    axis: Axis
    shape: tuple[int, ...] = ()
    """Of a row."""
    stored: DTypeLike = np.float32
    """On disk."""
    fill: int = 0
    """Of rows that a batch adds."""

    @property
    def column(self) -> str:
        """Its name among the columns of its axis on disk."""
        return self.name.removeprefix(f"{self.axis}_")

    def in_memory(self, values: np.ndarray) -> np.ndarray:
        """A copy of stored values in the type that networks take."""
        kinds = {"f": np.float32, "i": np.int64, "b": np.bool_}
        return values.astype(kinds[values.dtype.kind])


SCENE_FIELDS: Final = (
    SceneField(name="piece_pose", axis="piece", shape=(3,)),
    SceneField(
        name="piece_shape", axis="piece", shape=(len(PIECE_SHAPE),), stored=np.float16
    ),
    SceneField(name="piece_kind", axis="piece", stored=np.int8),
    SceneField(
        name="piece_signal", axis="piece", shape=(len(PIECE_SIGNAL),), stored=np.float16
    ),
    SceneField(name="boundary_pose", axis="boundary", shape=(3,)),
    SceneField(
        name="boundary_shape",
        axis="boundary",
        shape=(len(BOUNDARY_SHAPE),),
        stored=np.float16,
    ),
    SceneField(name="agent_pose", axis="agent", shape=(3,)),
    SceneField(name="agent_speed", axis="agent"),
    SceneField(name="agent_size", axis="agent", shape=(2,), stored=np.float16),
    SceneField(name="agent_kind", axis="agent", stored=np.int8),
    SceneField(name="agent_activity", axis="agent", stored=np.int8),
    SceneField(
        name="near_pieces",
        axis="agent",
        shape=(NUM_NEAR_PIECES,),
        stored=np.int16,
        fill=-1,
    ),
    SceneField(
        name="near_boundary",
        axis="agent",
        shape=(NUM_NEAR_BOUNDARY,),
        stored=np.int16,
        fill=-1,
    ),
    SceneField(
        name="near_agents",
        axis="agent",
        shape=(NUM_NEAR_AGENTS,),
        stored=np.int16,
        fill=-1,
    ),
    SceneField(name="future", axis="agent", shape=(LATENT_SIZE,), stored=np.float16),
    SceneField(name="has_future", axis="agent", stored=np.bool_),
)
"""All but the candidates, whose number differs among scenes and agents."""
CANDIDATE_FIELDS: Final = (
    SceneField(name="candidates", axis="agent"),
    SceneField(name="has_candidate", axis="agent", stored=np.bool_),
)
