"""Locks: what of an agent is kept when traffic is generated or edited."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool

from pd_editor.base.errors import EditError
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.time_axis import TimeAxis

MAX_KEPT_S: Final = 60.0
"""Longest locked beginning of a trajectory."""
Kept = Literal["trajectory", "beginning", "state"]


@dataclass(frozen=True, kw_only=True)
class Lock:
    """What of an agent is kept: its current state, and its motion for some time.

    Kind, size and activity belong to the state.
    """

    kept_s: float | None = None
    """Kept seconds after the current step: 0 keeps the state alone, None the whole track."""

    def __post_init__(self) -> None:
        kept = self.kept_s
        if kept is not None and not (math.isfinite(kept) and 0 <= kept <= MAX_KEPT_S):
            raise EditError(
                f"A lock keeps {kept:g} s of a trajectory; expected 0 (the state alone)"
                f" to {MAX_KEPT_S:g} s."
            )

    @property
    def keeps(self) -> Kept:
        """What of the motion is kept: all of it, only the first seconds, or nothing."""
        if self.kept_s is None:
            return "trajectory"
        return "beginning" if self.kept_s else "state"

    def later(self, seconds: float) -> "Lock":
        """The lock as it stands some seconds later."""
        return (
            self
            if self.kept_s is None
            else Lock(kept_s=max(self.kept_s - seconds, 0.0))
        )

    @property
    def in_words(self) -> str:
        """What is kept: "trajectory", "state" or "first 2 s"."""
        if self.kept_s is None:
            return "trajectory"
        return f"first {self.kept_s:g} s" if self.kept_s else "state"


STATE_LOCK: Final = Lock(kept_s=0.0)
TRAJECTORY_LOCK: Final = Lock()


def kept_steps(
    agents: AgentTracks, axis: TimeAxis, locks: Mapping[str, Lock]
) -> Bool[np.ndarray, "A T"]:
    """Steps that the locks keep of each agent.

    The kept beginning of a trajectory ends at the last step of it at which the agent
    exists.
    """
    is_kept = np.zeros((len(agents), axis.num_steps), bool)
    now = axis.current_step
    for agent_id, lock in locks.items():
        row = agents.row_of.get(agent_id)
        if row is None:
            continue
        if lock.kept_s is None:
            is_kept[row] = True
            continue
        num_steps = round(lock.kept_s / axis.step_s)
        exists = agents.is_valid[row, now : now + num_steps + 1]
        last = int(np.flatnonzero(exists)[-1]) if exists.any() else 0
        is_kept[row, now : now + last + 1] = True
    return is_kept
