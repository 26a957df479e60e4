"""What an agent is about at the current step: parked, waiting in traffic, or driving."""

from enum import IntEnum
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

STANDING_SPEED_MPS: Final = 0.5
"""Agents slower than this stand."""


class Activity(IntEnum):
    """A categorical attribute of an agent; no file of Argoverse 2 tells it."""

    UNKNOWN = 0
    PARKED = 1
    """It stands beside the traffic for good."""
    WAITING = 2
    """It stands in traffic, at a light or in a queue."""
    DRIVING = 3
    """It moves."""


def activity_at(
    activity: Int[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Known activities made to agree with speeds: what moves is neither parked nor waits."""
    stands = speed_mps < STANDING_SPEED_MPS
    known = np.where(
        stands & (activity == Activity.DRIVING), Activity.WAITING, activity
    )
    return np.where(~stands & (known > 0), Activity.DRIVING, known)


def true_activity(
    is_parked: Bool[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Activities where it is known which agents are parked."""
    standing = np.where(is_parked, Activity.PARKED, Activity.WAITING)
    return activity_at(standing, speed_mps)
