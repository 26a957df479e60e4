"""Agents' poses between the steps of a scenario, for drawing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import interpolate_angle


@dataclass(frozen=True, kw_only=True, eq=False)
class AgentPoses:
    """All agents at one moment."""

    position_m: Float[np.ndarray, "A 2"]
    heading_rad: Float[np.ndarray, "A"]
    is_present: Bool[np.ndarray, "A"]


def poses_at(agents: AgentTracks, step: float) -> AgentPoses:
    """Poses at a fractional step, interpolated between its two neighbours.

    If only one neighbour exists, an agent has its pose for that half of the interval.
    """
    before = int(np.clip(np.floor(step), 0, agents.num_steps - 1))
    after = min(before + 1, agents.num_steps - 1)
    fraction = float(np.clip(step - before, 0.0, 1.0))
    here, there = agents.is_valid[:, before], agents.is_valid[:, after]
    weight = np.where(here & there, fraction, np.where(here, 0.0, 1.0))
    start, end = agents.position_m[:, before], agents.position_m[:, after]
    return AgentPoses(
        position_m=start + weight[:, None] * (end - start),
        heading_rad=interpolate_angle(
            agents.heading_rad[:, before], agents.heading_rad[:, after], weight
        ),
        is_present=np.where(fraction < 0.5, here, there) | (here & there),
    )


def yaw_quaternions(heading_rad: Float[np.ndarray, "N"]) -> Float[np.ndarray, "N 4"]:
    """Rotations about +z as w, x, y, z."""
    quaternions = np.zeros((len(heading_rad), 4))
    quaternions[:, 0] = np.cos(heading_rad / 2)
    quaternions[:, 3] = np.sin(heading_rad / 2)
    return quaternions
