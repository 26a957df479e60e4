"""Paths divided into short pieces with small bounding boxes, for fast searches."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

PIECE_STEPS: Final = 12


def in_pieces(values: np.ndarray) -> np.ndarray:
    """Reshape [A H ...] to [A K 12 ...], padded at the end with zeros (false)."""
    num_agents, num_steps = values.shape[:2]
    num_pieces = -(-num_steps // PIECE_STEPS)
    # Much faster than np.pad, and this is called for every sample.
    whole = np.zeros(
        (num_agents, num_pieces * PIECE_STEPS, *values.shape[2:]), values.dtype
    )
    whole[:, :num_steps] = values
    return whole.reshape(num_agents, num_pieces, PIECE_STEPS, *values.shape[2:])


def joined_pieces(values: np.ndarray, num_steps: int) -> np.ndarray:
    """Reshape [A*K 12] to [A H] without the padding; inverse of ``in_pieces``."""
    num_pieces = -(-num_steps // PIECE_STEPS)
    return values.reshape(-1, num_pieces * PIECE_STEPS)[:, :num_steps]


def bounds_m(
    position_m: Float[np.ndarray, "*rows S 2"], is_valid: Bool[np.ndarray, "*rows S"]
) -> tuple[Float[np.ndarray, "*rows 2"], Float[np.ndarray, "*rows 2"]]:
    """Least and greatest coordinates over valid steps; an empty box without any."""
    low, high = [], []
    # Axis by axis: reductions over the last axis are several times quicker.
    for axis in (0, 1):
        values = position_m[..., axis]
        low.append(np.where(is_valid, values, np.inf).min(axis=-1, initial=np.inf))
        high.append(np.where(is_valid, values, -np.inf).max(axis=-1, initial=-np.inf))
    return np.stack(low, axis=-1), np.stack(high, axis=-1)


def rectangles_meet(
    low_a_m: Float[np.ndarray, "*a 2"],
    high_a_m: Float[np.ndarray, "*a 2"],
    low_b_m: Float[np.ndarray, "*b 2"],
    high_b_m: Float[np.ndarray, "*b 2"],
) -> Bool[np.ndarray, "*c"]:
    """Whether axis-aligned rectangles intersect; shapes are broadcast."""
    meet = low_a_m[..., 0] <= high_b_m[..., 0]
    meet = meet & (low_b_m[..., 0] <= high_a_m[..., 0])
    meet &= low_a_m[..., 1] <= high_b_m[..., 1]
    meet &= low_b_m[..., 1] <= high_a_m[..., 1]
    return meet


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPieces:
    """Paths of A agents, each divided into K pieces of P steps (N = A K)."""

    position_m: Float[np.ndarray, "N P 2"]
    is_valid: Bool[np.ndarray, "N P"]
    low_m: Float[np.ndarray, "A K 2"]
    """Least coordinates within reach of each piece's valid steps."""
    high_m: Float[np.ndarray, "A K 2"]

    @classmethod
    def of(
        cls,
        position_m: Float[np.ndarray, "A H 2"],
        is_valid: Bool[np.ndarray, "A H"],
        reach_m: Float[np.ndarray, "A"],
    ) -> "PathPieces":
        """Divide paths with the same number of steps."""
        position, valid = in_pieces(position_m), in_pieces(is_valid)
        low, high = bounds_m(position, valid)
        return cls(
            position_m=position.reshape(-1, PIECE_STEPS, 2),
            is_valid=valid.reshape(-1, PIECE_STEPS),
            low_m=low - reach_m[:, None, None],
            high_m=high + reach_m[:, None, None],
        )

    @property
    def path_bounds_m(
        self,
    ) -> tuple[Float[np.ndarray, "A 2"], Float[np.ndarray, "A 2"]]:
        """Least and greatest coordinates within reach of each path."""
        return self.low_m.min(axis=1), self.high_m.max(axis=1)

    def near_boxes(
        self,
        agent: Int[np.ndarray, "Q"],
        box: Int[np.ndarray, "Q"],
        low_m: Float[np.ndarray, "B 2"],
        high_m: Float[np.ndarray, "B 2"],
    ) -> tuple[Int[np.ndarray, "R"], Int[np.ndarray, "R"]]:
        """Pieces of agents, and their axis-aligned boxes whose bounds are within reach.

        They include each given box that is within reach of a valid step of the piece,
        and are sorted by piece.
        """
        is_near = rectangles_meet(
            self.low_m[agent], self.high_m[agent], low_m[box, None], high_m[box, None]
        )
        pair, part = np.nonzero(is_near)
        piece = agent[pair] * self.low_m.shape[1] + part
        order = np.argsort(piece, kind="stable")
        return piece[order], box[pair[order]]
