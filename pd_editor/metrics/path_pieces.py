"""Paths cut into short pieces, whose bounding boxes are small."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

PIECE_STEPS: Final = 12


def in_pieces(values: np.ndarray) -> np.ndarray:
    """[A H ...] as [A K 12 ...], padded at the end with zeros (false)."""
    num_agents, num_steps = values.shape[:2]
    padding = [(0, 0)] * values.ndim
    padding[1] = (0, -num_steps % PIECE_STEPS)
    num_pieces = -(-num_steps // PIECE_STEPS)
    shape = (num_agents, num_pieces, PIECE_STEPS, *values.shape[2:])
    return np.pad(values, padding).reshape(shape)


def joined_pieces(values: np.ndarray, num_steps: int) -> np.ndarray:
    """[A*K 12] as [A H], without the padding; inverse of ``in_pieces``."""
    num_pieces = -(-num_steps // PIECE_STEPS)
    return values.reshape(-1, num_pieces * PIECE_STEPS)[:, :num_steps]


def bounds_m(
    position_m: Float[np.ndarray, "*rows S 2"], is_valid: Bool[np.ndarray, "*rows S"]
) -> tuple[Float[np.ndarray, "*rows 2"], Float[np.ndarray, "*rows 2"]]:
    """Least and greatest coordinates; an empty box where no step is valid."""
    mask = is_valid[..., None]
    return (
        np.where(mask, position_m, np.inf).min(axis=-2, initial=np.inf),
        np.where(mask, position_m, -np.inf).max(axis=-2, initial=-np.inf),
    )
