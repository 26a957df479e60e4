"""Activity of an agent at the current step: parked, waiting in traffic, or driving."""

from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.scene.thresholds import MOVING_MPS


class Activity(IntEnum):
    """Categorical attribute of an agent; Argoverse 2 files do not contain it."""

    UNKNOWN = 0
    PARKED = 1
    """Stationary beside the traffic, without the intention to drive."""
    WAITING = 2
    """Stationary in traffic, for example at a light or in a queue."""
    DRIVING = 3
    """Moving."""

    @property
    def in_words(self) -> str:
        """As users read it; people do not drive."""
        words = {Activity.UNKNOWN: "not known", Activity.DRIVING: "moving"}
        return words.get(self, self.name.lower())


def stands(speed_mps: Float[np.ndarray, "*s"]) -> Bool[np.ndarray, "*s"]:
    """Whether agents of these speeds stand."""
    return speed_mps < MOVING_MPS


def activity_at(
    activity: Int[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Make known activities consistent with speeds: moving agents are driving."""
    is_standing = stands(speed_mps)
    known = np.where(
        is_standing & (activity == Activity.DRIVING), Activity.WAITING, activity
    )
    return np.where(~is_standing & (known > 0), Activity.DRIVING, known)


def true_activity(
    is_parked: Bool[np.ndarray, "A"], speed_mps: Float[np.ndarray, "A"]
) -> Int[np.ndarray, "A"]:
    """Activities of agents for which it is known whether they are parked."""
    standing = np.where(is_parked, Activity.PARKED, Activity.WAITING)
    return activity_at(standing, speed_mps)
