"""Relative poses, the only positional input of the trajectory network.

They are invariant to rotations and translations of the scene.
"""

from typing import Final

import torch
from jaxtyping import Float, Int, Shaped
from torch import Tensor

NUM_POSE_FEATURES: Final = 10

_FAR_M: Final = 30.0
NEAR_M: Final = 4.0


def relative_pose(
    pose: Float[Tensor, "*#shape 3"], seen_from: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 4"]:
    """x, y in metres, cosine and sine of ``pose`` in the frame of ``seen_from``."""
    gap = pose[..., :2] - seen_from[..., :2]
    cos, sin = seen_from[..., 2].cos(), seen_from[..., 2].sin()
    turn = pose[..., 2] - seen_from[..., 2]
    return torch.stack(
        [
            cos * gap[..., 0] + sin * gap[..., 1],
            cos * gap[..., 1] - sin * gap[..., 0],
            turn.cos(),
            turn.sin(),
        ],
        dim=-1,
    )


def pose_features(relative: Float[Tensor, "*shape 4"]) -> Float[Tensor, "*shape 10"]:
    """Features of a relative pose, of about unit scale and finer at short distances.

    They are the position in the viewer's frame at two scales, closeness, direction, and
    the viewer's position in the other frame, which for a lane is the offset along and
    beside it.
    """
    x, y, cos, sin = relative.unbind(-1)
    distance = torch.sqrt(x.square() + y.square() + 1e-6)
    squash = 1 / (distance + NEAR_M)
    ahead = -(cos * x + sin * y)
    beside = sin * x - cos * y
    return torch.stack(
        [
            x / _FAR_M,
            y / _FAR_M,
            x * squash,
            y * squash,
            NEAR_M * squash,
            cos,
            sin,
            ahead * squash,
            beside * squash,
            torch.tanh(beside / NEAR_M),
        ],
        dim=-1,
    )


def gathered(
    values: Shaped[Tensor, "B N *feature"], index: Int[Tensor, "B A K"]
) -> Shaped[Tensor, "B A K *feature"]:
    """Gather rows of each scene by index; an arbitrary row where the index is -1."""
    num_scenes, num_rows = values.shape[:2]
    first = torch.arange(num_scenes, device=values.device) * num_rows
    return selected(values.flatten(0, 1), index.clamp_min(0) + first[:, None, None])


def selected(
    table: Shaped[Tensor, "N ..."], row: Int[Tensor, "..."]
) -> Shaped[Tensor, "..."]:
    """Rows of a table, in the shape of their indices; faster than indexing."""
    return table.index_select(0, row.flatten()).unflatten(0, row.shape)
