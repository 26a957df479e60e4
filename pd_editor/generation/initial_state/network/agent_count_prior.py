"""Prior of the number of road users by kind, given the length of lanes.

It also covers how many of them move and are on the road, as in the training data.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from pd_editor.generation.features.map_pieces import PIECE_LENGTH_M
from pd_editor.generation.features.scene_features import AGENT_KINDS, PackedScene
from pd_editor.generation.initial_state.network.lane_distance import (
    follows_lanes,
    is_on_road,
)
from pd_editor.generation.inputs import SceneTensors, batch_of
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.thresholds import MOVING_MPS

HALF_SIDES_M: Final = (31.0, 44.0, 62.0)
"""Half sides of the squares that are counted around the centre of each scene."""
MOST_ROWS: Final = 600
"""Number of rows kept for each size of square."""
NUM_ROWS: Final = MOST_ROWS * len(HALF_SIDES_M)
_NUM_LIKE: Final = 40
"""Number of rows with a similar length of lanes, of which some are sampled."""
_NUM_AVERAGED: Final = 4
"""Number of these whose mean is taken. Numbers of one vary by .48 of the mean, of four by
.24; of one place of a training network over 160 s by .12 to .16."""
_NUM_AS_FULL: Final = 10
"""Number of these with a similar number of agents, if that is known."""
_VEHICLE_LANE: Final = 0
_CELLS: Final = (len(AGENT_KINDS), 2, 2)
_NUM_CELLS: Final = 4 * len(AGENT_KINDS)
_ON_ROAD: Final = np.array([[0.0, 1.0], [0.0, 1.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentAttributes:
    """Attributes of A agents, sampled before their states."""

    moves: Bool[np.ndarray, "A"]
    on_road: Bool[np.ndarray, "A"]
    """Whether within ``OFF_LANE_M`` of a centre line; always true for pedestrians."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentCounts:
    """Counts of N squares of training scenes: half side, length of lanes, road users."""

    half_side_m: Float[np.ndarray, "N"]
    lane_m: Float[np.ndarray, "N"]
    """Length of vehicle lanes in the square."""
    counts: Int[np.ndarray, "N K 2 2"]
    """Numbers by ``AGENT_KINDS``, moving (no, yes), and on the road (no, yes)."""

    @classmethod
    def none(cls) -> "AgentCounts":
        """Empty counts."""
        empty = np.zeros(0)
        return cls(
            half_side_m=empty,
            lane_m=empty,
            counts=np.zeros((0, len(AGENT_KINDS), 2, 2), int),
        )

    def as_tensor(self) -> Float[torch.Tensor, "R C"]:
        """One row per square, padded to a constant number, to be stored in a network."""
        counts = self.counts.reshape(-1, _NUM_CELLS)
        rows = np.column_stack([self.half_side_m, self.lane_m, counts])
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
            counts=np.rint(rows[:, 2:]).astype(int).reshape(-1, *_CELLS),
        )

    def sample(
        self,
        lane_m: float,
        half_side_m: float,
        random: np.random.Generator,
        *,
        only_on_road: bool = False,
    ) -> Mapping[AgentKind, int]:
        """Sample mean numbers of training squares of similar size and length of lanes.

        ``only_on_road`` counts agents on the road only.
        """
        like, scale = self._like(lane_m, half_side_m)
        counts = self.counts * _ON_ROAD if only_on_road else self.counts
        drawn = counts[like[random.integers(len(like), size=_NUM_AVERAGED)]]
        sampled = drawn.mean(axis=0).sum(axis=(1, 2)) * scale
        whole = np.floor(sampled + random.random(len(sampled))).astype(int)
        numbers = dict(zip(AGENT_KINDS, whole.tolist(), strict=True))
        return {kind: number for kind, number in numbers.items() if number}

    def sample_attributes(
        self,
        kinds: Int[np.ndarray, "A"],
        present: Int[np.ndarray, "K 2 2"],
        lane_m: float,
        half_side_m: float,
        random: np.random.Generator,
        *,
        moving_share: float | None = None,
        only_on_road: bool = False,
    ) -> AgentAttributes:
        """Sample which agents move and are on the road, as in a similar training square.

        ``kinds`` are indices of ``AGENT_KINDS``; ``present`` counts the agents that are
        in the square already. Without a ``moving_share`` as many move as in training.
        """
        like, scale = self._like(lane_m, half_side_m)
        counted = (self.counts * _ON_ROAD if only_on_road else self.counts)[like]
        apart = np.abs(counted.sum(axis=(1, 2, 3)) * scale - len(kinds) - present.sum())
        as_full = np.argsort(apart, kind="stable")[:_NUM_AS_FULL]
        square = counted[as_full[random.integers(len(as_full))]] * scale
        # A kind that no similar square has follows all squares, or is on the road.
        usual = counted.sum(axis=0) + 1e-3 * self.counts.sum(axis=0)
        usual = _normalized(usual + _ON_ROAD * 1e-6)
        # Pseudo-count: weight of the mean over similar squares, in agents of one
        # square.
        share = np.maximum(square - present, 0.0) + 2.0 * usual
        if only_on_road:
            share = share * _ON_ROAD
        if moving_share is not None:
            share = _normalized(share, axes=(2,))
            share *= np.array([1 - moving_share, moving_share])[:, None]
        share = _normalized(share).reshape(len(AGENT_KINDS), 4).cumsum(axis=1)
        cell = (_spread(kinds, random)[:, None] >= share[kinds, :3]).sum(axis=1)
        return AgentAttributes(moves=cell >= 2, on_road=cell % 2 == 1)

    def _like(
        self, lane_m: float, half_side_m: float
    ) -> tuple[Int[np.ndarray, "L"], float]:
        """Rows of similar size and length of lanes, and the factor of the square's size."""
        sides = np.unique(self.half_side_m)
        side = sides[np.abs(sides - half_side_m).argmin()]
        rows = np.flatnonzero(self.half_side_m == side)
        # A square between two sizes is scaled proportionally.
        scale = float((half_side_m / side) ** 2)
        apart = np.abs(self.lane_m[rows] - lane_m / scale)
        return rows[np.argsort(apart, kind="stable")[:_NUM_LIKE]], scale


def fit_agent_counts(scenes: Iterable[PackedScene]) -> AgentCounts:
    """Count the road users of training scenes, and keep a random subset of rows."""
    rows = [
        [side, *found] for scene in scenes for side, found in _counted(scene).items()
    ]
    table = np.array(rows, float).reshape(-1, 2 + _NUM_CELLS)
    random = np.random.default_rng(0)
    kept = np.concatenate(
        [
            np.sort(random.permutation(np.flatnonzero(table[:, 0] == side))[:MOST_ROWS])
            for side in HALF_SIDES_M
        ]
    )
    return AgentCounts(
        half_side_m=table[kept, 0],
        lane_m=table[kept, 1],
        counts=np.rint(table[kept, 2:]).astype(int).reshape(-1, *_CELLS),
    )


def lane_length_m(
    piece_pose: Float[np.ndarray, "P 3"],
    piece_shape: Float[np.ndarray, "P F"],
    piece_kind: Int[np.ndarray, "P"],
    half_side_m: float,
) -> float:
    """Length of vehicle lanes in a square around the centre."""
    counts = _is_inside(piece_pose, half_side_m) & (piece_kind == _VEHICLE_LANE)
    return float(piece_shape[counts, 0].sum() * PIECE_LENGTH_M)


def cells_of(
    scene: SceneTensors, counts: Bool[np.ndarray, "B A"]
) -> Int[np.ndarray, "B K 2 2"]:
    """Numbers of some agents of each scene, as in ``AgentCounts.counts``."""
    on_road = (is_on_road(scene) | ~follows_lanes(scene)).cpu().numpy()
    moves = scene.agent_speed.cpu().numpy() >= MOVING_MPS
    cells = 4 * scene.agent_kind.cpu().numpy() + 2 * moves + on_road
    return np.stack(
        [
            np.bincount(cell[counted], minlength=_NUM_CELLS).reshape(_CELLS)
            for cell, counted in zip(cells, counts, strict=True)
        ]
    )


def _counted(scene: PackedScene) -> dict[float, list[float]]:
    """Length of lanes and number of agents in each cell, by half side."""
    tensors = batch_of([scene])
    padding = np.zeros(len(tensors.agent_kind[0]) - len(scene.agent_kind), bool)
    found: dict[float, list[float]] = {}
    for side in HALF_SIDES_M:
        inside = np.append(_is_inside(scene.agent_pose, side), padding)
        length = lane_length_m(
            scene.piece_pose, scene.piece_shape, scene.piece_kind, side
        )
        found[side] = [length, *cells_of(tensors, inside[None]).flatten().tolist()]
    return found


def _spread(
    kinds: Int[np.ndarray, "A"], random: np.random.Generator
) -> Float[np.ndarray, "A"]:
    """Stratified uniform numbers by kind, so that shares are as exact as possible."""
    found = np.zeros(len(kinds))
    for kind in np.unique(kinds):
        rows = np.flatnonzero(kinds == kind)
        found[rows] = (random.permutation(len(rows)) + random.random()) / len(rows)
    return found


def _normalized(
    values: Float[np.ndarray, "K 2 2"], axes: tuple[int, ...] = (1, 2)
) -> Float[np.ndarray, "K 2 2"]:
    return values / values.sum(axis=axes, keepdims=True)


def _is_inside(
    pose: Float[np.ndarray, "N 3"], half_side_m: float
) -> Bool[np.ndarray, "N"]:
    return np.all(np.abs(pose[:, :2]) <= half_side_m, axis=1)
