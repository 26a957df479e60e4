"""Encoding of initial states for diffusion."""

from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pd_editor.generation.core.devices import constant
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.thresholds import MOVING_MPS

POSITION_UNIT_M: Final = 62.0
"""Half side of the training square, the unit of encoded positions."""
NUM_POSE_PARTS: Final = 4
"""Number of parts of the pose: x, y, cos, sin."""
NUM_MOTION_PARTS: Final = 5
"""Number of parts of the motion: those of the pose, then the speed."""
ACTIVITIES: Final = (Activity.PARKED, Activity.WAITING, Activity.DRIVING)
"""Activities with one part of a state each, after the motion, if they are sampled."""
_MOTION_SPREAD: Final = (0.5, 0.5, 0.7, 0.7, 0.8)
_ACTIVITY_SPREAD: Final = 0.5
_STANDING_CODE: Final = -0.5
_MOVING_UNIT: Final = 2.0
_SLOWEST_CODE: Final = MOVING_MPS**0.5 / _MOVING_UNIT
"""Code of the slowest moving agents."""


def state_spread(*, samples_activity: bool) -> tuple[float, ...]:
    """Approximate standard deviation of each encoded part in traffic."""
    activity = (_ACTIVITY_SPREAD,) * len(ACTIVITIES) if samples_activity else ()
    return _MOTION_SPREAD + activity


def encode_states(
    pose: Float[Tensor, "*b 3"],
    speed: Float[Tensor, "*b"],
    activity: Int[Tensor, "*b"] | None = None,
) -> Float[Tensor, "*b P"]:
    """Encode poses x, y, heading around the centre, speeds in m/s, and activities.

    Positions are in units of 62 m, headings are unit vectors. More than half of all
    vehicles are stationary: they have a separate code, well apart from the square roots
    of speeds, so that both the atom and the tail can be sampled. Activities are one part
    for each of ``ACTIVITIES``, 0.5 or -0.5; all 0 if unknown.
    """
    code = (speed.clamp_min(MOVING_MPS)).sqrt() / _MOVING_UNIT
    code = torch.where(speed < MOVING_MPS, _STANDING_CODE, code)
    heading = pose[..., 2]
    parts = [
        pose[..., :2] / POSITION_UNIT_M,
        torch.stack([heading.cos(), heading.sin(), code], dim=-1),
    ]
    if activity is not None:
        values = constant(ACTIVITIES, activity)
        is_one = (activity[..., None] == values).to(code)
        parts.append((is_one - 0.5) * (activity > 0)[..., None])
    return torch.cat(parts, dim=-1)


def decode_states(codes: Float[Tensor, "*b P"]) -> Float[Tensor, "*b 5"]:
    """Decode states to metres, unit headings and m/s; inverse of ``encode_states``.

    Stationary agents have speed 0.
    """
    speed = (codes[..., 4].clamp_min(_SLOWEST_CODE) * _MOVING_UNIT) ** 2
    stands = is_standing(codes)
    return torch.cat(
        [
            codes[..., :2] * POSITION_UNIT_M,
            unit_vectors(codes[..., 2:4]),
            torch.where(stands, 0.0, speed)[..., None],
        ],
        dim=-1,
    )


def decode_activity(codes: Float[Tensor, "*b P"]) -> Int[Tensor, "*b"]:
    """Decode ``Activity``: stationary agents park or wait, whichever is more likely.

    Unknown if codes contain no activity.
    """
    found = torch.full(codes.shape[:-1], Activity.UNKNOWN, device=codes.device)
    if codes.shape[-1] == NUM_MOTION_PARTS:
        return found
    parked, waiting, _ = codes[..., NUM_MOTION_PARTS:].unbind(-1)
    found = torch.where(parked > waiting, Activity.PARKED, Activity.WAITING)
    return torch.where(is_standing(codes), found, Activity.DRIVING)


def is_standing(codes: Float[Tensor, "*b P"]) -> Bool[Tensor, "*b"]:
    """Which encoded states are stationary."""
    return codes[..., 4] < (_SLOWEST_CODE + _STANDING_CODE) / 2


def unit_vectors(vectors: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 2"]:
    """Unit vectors; along x for zero vectors."""
    length = vectors.norm(dim=-1, keepdim=True)
    along_x = torch.zeros_like(vectors)
    along_x[..., 0] = 1.0
    return torch.where(length > 1e-6, vectors / length.clamp_min(1e-6), along_x)
