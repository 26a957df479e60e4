"""Limits of what an agent can do: accelerations, curvature and speed, by kind."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.motion import TURNING_MPS
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.geometry.angles import unit_vector

_SPAN: Final = 3
"""Accelerations are second differences over this number of steps to either side."""


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Largest accelerations, curvature and speed of a kind of agent."""

    acceleration_mps2: float
    braking_mps2: float
    lateral_mps2: float
    curvature_1pm: float
    speed_mps: float


_OF_VEHICLES: Final = MotionLimits(
    acceleration_mps2=4.0,
    braking_mps2=8.0,
    lateral_mps2=6.0,
    curvature_1pm=0.2,
    speed_mps=35.0,
)
LIMITS: Final[dict[AgentKind, MotionLimits]] = {
    AgentKind.BUS: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=6.0,
        lateral_mps2=3.5,
        curvature_1pm=0.1,
        speed_mps=28.0,
    ),
    AgentKind.CYCLIST: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=5.0,
        lateral_mps2=4.0,
        curvature_1pm=0.5,
        speed_mps=12.0,
    ),
    AgentKind.PEDESTRIAN: MotionLimits(
        acceleration_mps2=2.0,
        braking_mps2=3.0,
        lateral_mps2=3.0,
        curvature_1pm=np.inf,
        speed_mps=4.0,
    ),
}
"""Limits of kinds that differ from vehicles."""


def limits_of(kind: AgentKind) -> MotionLimits:
    """Limits of a kind of agent."""
    return LIMITS.get(kind, _OF_VEHICLES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Exertion:
    """How much of its limits each of N trajectories uses; above 1 is not possible."""

    share: Float[np.ndarray, "N"]
    """Largest share of any limit at any step."""
    effort: Float[np.ndarray, "N"]
    """Mean square of the acceleration's share of its limits."""
    largest_mps2: Float[np.ndarray, "N"]

    @property
    def is_possible(self) -> Bool[np.ndarray, "N"]:
        """Whether all limits are kept."""
        return self.share <= 1


def exertion(
    position_m: Float[np.ndarray, "N H 2"],
    velocity_mps: Float[np.ndarray, "2"],
    heading_rad: float,
    limits: MotionLimits,
    step_s: float,
    *,
    until: Int[np.ndarray, "N"] | None = None,
) -> Exertion:
    """Compare trajectories from one current state with limits.

    Before the current step the agent is taken to have kept its velocity, so that a jump
    of the velocity counts. Steps after ``until``, such as those after a collision, do
    not count.
    """
    back = np.arange(-_SPAN, 0)[:, None] * step_s * velocity_mps
    before = position_m[:, :1] + back
    path = np.concatenate([before, position_m], axis=1)
    span_s = _SPAN * step_s
    middle = path[:, _SPAN:-_SPAN]
    later, earlier = path[:, 2 * _SPAN :], path[:, : -2 * _SPAN]
    acceleration = (later - 2 * middle + earlier) / span_s**2
    velocity = (later - earlier) / (2 * span_s)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    facing = unit_vector(heading_rad)
    moves = speed > 0.5
    forward = np.where(
        moves[..., None], velocity / np.maximum(speed, 1e-6)[..., None], facing
    )
    along = (acceleration * forward).sum(-1)
    across = (
        forward[..., 0] * acceleration[..., 1] - forward[..., 1] * acceleration[..., 0]
    )
    share = np.maximum(along / limits.acceleration_mps2, -along / limits.braking_mps2)
    aside = np.abs(across) / limits.lateral_mps2
    used = np.hypot(share, aside)
    bend = np.abs(across) / np.maximum(speed, TURNING_MPS) ** 2
    bend = np.where(speed > TURNING_MPS, bend / limits.curvature_1pm, 0.0)
    fast = speed / max(limits.speed_mps, 1.05 * float(np.hypot(*velocity_mps)))
    turn = (forward[:, 1:] * forward[:, :-1]).sum(-1)
    reverses = (turn < 0) & moves[:, 1:]
    reverses |= (forward[:, 1:] @ facing < 0) & (np.arange(forward.shape[1] - 1) < 3)
    if np.isinf(limits.curvature_1pm):
        reverses = np.zeros_like(reverses)
    counts = np.ones(used.shape, bool)
    if until is not None:
        counts = np.arange(used.shape[1]) <= until[:, None]
    most = np.maximum(np.maximum(used, bend), fast)
    return Exertion(
        share=np.where(
            (reverses & counts[:, 1:]).any(axis=1),
            np.inf,
            np.where(counts, most, 0.0).max(axis=1),
        ),
        effort=np.where(counts, used**2, 0.0).sum(axis=1) / counts.sum(axis=1),
        largest_mps2=np.where(counts, np.hypot(along, across), 0.0).max(axis=1),
    )
