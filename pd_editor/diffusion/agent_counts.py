"""How many road users of each kind a stretch of road has, as in the training data."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.windows.lane_pieces import PIECE_LENGTH_M
from pd_editor.windows.packed_scene import PackedScene
from pd_editor.windows.scene_features import AGENT_KINDS

HALF_SIDES_M: Final = (31.0, 44.0, 62.0)
"""Squares that are counted around the middle of each scene."""
MOST_ROWS: Final = 600
"""Rows kept for each of them."""
NUM_ROWS: Final = MOST_ROWS * len(HALF_SIDES_M)
_NUM_LIKE: Final = 40
"""Rows with a like length of lanes, one of which is drawn."""
_VEHICLE_LANE: Final = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentCounts:
    """Squares of N training scenes: half side, length of lanes, road users by kind."""

    half_side_m: Float[np.ndarray, "N"]
    lane_m: Float[np.ndarray, "N"]
    """Of vehicle lanes in the square."""
    counts: Int[np.ndarray, "N K"]
    """Of each of ``AGENT_KINDS``."""

    @classmethod
    def none(cls) -> "AgentCounts":
        """Nothing counted yet."""
        empty = np.zeros(0)
        return cls(
            half_side_m=empty,
            lane_m=empty,
            counts=np.zeros((0, len(AGENT_KINDS)), int),
        )

    def as_tensor(self) -> Float[torch.Tensor, "R C"]:
        """One row per square; always as many rows, so that networks can keep them."""
        rows = np.column_stack([self.half_side_m, self.lane_m, self.counts])
        table = torch.zeros((NUM_ROWS, rows.shape[1]))
        table[: len(rows)] = torch.from_numpy(rows)
        return table

    @classmethod
    def from_tensor(cls, table: Float[torch.Tensor, "R C"]) -> "AgentCounts":
        """Inverse of ``as_tensor``."""
        rows = table[table[:, 0] > 0].cpu().double().numpy()
        return cls(
            half_side_m=rows[:, 0],
            lane_m=rows[:, 1],
            counts=np.rint(rows[:, 2:]).astype(int),
        )

    def draw(
        self, lane_m: float, half_side_m: float, random: np.random.Generator
    ) -> Mapping[AgentKind, int]:
        """The numbers of a training square of about that size and length of lanes."""
        sides = np.unique(self.half_side_m)
        side = sides[np.abs(sides - half_side_m).argmin()]
        rows = np.flatnonzero(self.half_side_m == side)
        # A square between the sizes has its share of agents and lanes.
        scale = (half_side_m / side) ** 2
        apart = np.abs(self.lane_m[rows] - lane_m / scale)
        like = rows[np.argsort(apart, kind="stable")[:_NUM_LIKE]]
        drawn = self.counts[like[random.integers(len(like))]] * scale
        whole = np.floor(drawn + random.random(len(drawn))).astype(int)
        numbers = dict(zip(AGENT_KINDS, whole.tolist(), strict=True))
        return {kind: number for kind, number in numbers.items() if number}


def fit_agent_counts(scenes: Iterable[PackedScene], *, seed: int = 0) -> AgentCounts:
    """Count the road users of training scenes; a random part of them is kept."""
    rows = [[side, *_counted(scene, side)] for scene in scenes for side in HALF_SIDES_M]
    table = np.array(rows, float).reshape(-1, 2 + len(AGENT_KINDS))
    random = np.random.default_rng(seed)
    kept = np.concatenate(
        [
            np.sort(random.permutation(np.flatnonzero(table[:, 0] == side))[:MOST_ROWS])
            for side in HALF_SIDES_M
        ]
    )
    return AgentCounts(
        half_side_m=table[kept, 0],
        lane_m=table[kept, 1],
        counts=np.rint(table[kept, 2:]).astype(int),
    )


def lane_length_m(
    piece_pose: Float[np.ndarray, "P 3"],
    piece_shape: Float[np.ndarray, "P F"],
    piece_kind: Int[np.ndarray, "P"],
    half_side_m: float,
) -> float:
    """Length of vehicle lanes in a square around the middle."""
    counts = _is_inside(piece_pose, half_side_m) & (piece_kind == _VEHICLE_LANE)
    return float(piece_shape[counts, 0].sum() * PIECE_LENGTH_M)


def _counted(scene: PackedScene, half_side_m: float) -> list[float]:
    length = lane_length_m(
        scene.piece_pose, scene.piece_shape, scene.piece_kind, half_side_m
    )
    kinds = scene.agent_kind[_is_inside(scene.agent_pose, half_side_m)]
    return [length, *np.bincount(kinds, minlength=len(AGENT_KINDS)).tolist()]


def _is_inside(
    pose: Float[np.ndarray, "N 3"], half_side_m: float
) -> Bool[np.ndarray, "N"]:
    return np.all(np.abs(pose[:, :2]) <= half_side_m, axis=1)
