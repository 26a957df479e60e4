"""The port for policies, which drive one agent in a roll-out; NumPy only.

A planner needs no base class of this project: an object with ``name``, ``reset`` and
``plan`` is a policy.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import described
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector, wrap_angle
from pd_editor.scene.prediction import AgentHistory
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal

DrivenPlans = Mapping[str, Mapping[int, Float[np.ndarray, "F 2"]]]
"""Where driven agents were to go, by agent and step."""
LEAST_PLAN_S: Final = 0.5
"""Shortest plan: the time between two questions to a policy."""
_MOST_JUMP_MPS: Final = 4.0
"""Largest change of velocity in a step; recorded tracks are noisy, and none has more."""


class PlanEndError(GenerationError):
    """A policy plans no further, as one that replays what was recorded."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """What a policy knows at the current step, and nothing later.

    In the scene frame: metres, x east, y north; radians counter-clockwise from x.
    """

    ego: AgentHistory
    """The agent that it drives: one row, H steps up to the current one."""
    others: AgentHistory
    """The other agents that are present now, over the same steps."""
    road_map: RoadMap
    """The road, warped where the scene is."""
    route_m: Float[np.ndarray, "N 2"]
    """Line that the agent is to follow; it begins where the roll-out did."""
    step_s: float
    """Seconds between two steps, in the history and in a plan."""
    time_s: float
    """Seconds since the beginning of the roll-out."""
    signals: tuple[Signal, ...] = ()
    """Signals of junctions, with their states at the H steps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """States of the driven agent at F steps, the first of which follows the current one."""

    position_m: Float[np.ndarray, "F 2"]
    """Centres of the box in the scene frame, ``step_s`` apart; F is 5 or more at 0.1 s."""
    heading_rad: Float[np.ndarray, "F"]
    """Counter-clockwise from x."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Controls:
    """Inputs of a kinematic bicycle over F steps, ``step_s`` each."""

    acceleration_mps2: Float[np.ndarray, "F"]
    """Along the heading; who stands does not go backwards."""
    curvature_1pm: Float[np.ndarray, "F"]
    """Positive to the left."""


@runtime_checkable
class Policy(Protocol):
    """Anything that plans the motion of one agent again and again."""

    @property
    def name(self) -> str:
        """Name shown to users and written into provenance."""
        ...

    def reset(
        self,
        scene: Scenario,
        ego_id: str,
        route_m: Float[np.ndarray, "N 2"],
        seed: int,
    ) -> None:
        """Begin a roll-out; ``scene`` is its first moment, with the recorded future."""
        ...

    def plan(self, observation: Observation) -> Plan | Controls:
        """States or inputs of the next ``LEAST_PLAN_S`` or more."""
        ...


def checked_plan(answer: object, observation: Observation, name: str) -> Plan:
    """The answer of a policy as states, those of controls by a kinematic bicycle.

    Raises:
        PlanEndError: it has no steps.
        GenerationError: it is no plan, too short, holds NaN, or cannot be driven.
    """
    fields = ("position_m", "heading_rad")
    if hasattr(answer, "acceleration_mps2"):
        fields = ("acceleration_mps2", "curvature_1pm")
    elif not hasattr(answer, "position_m"):
        raise GenerationError(
            f"The policy {name} returned a {type(answer).__name__}; expected a Plan or "
            "Controls (pd_editor.scene.policy)."
        )
    try:
        arrays = [np.asarray(getattr(answer, one, None)) for one in fields]
    except (
        Exception
    ) as error:  # Lists of unequal lengths, or a tensor of another library.
        raise GenerationError(
            f"The policy {name} returned what is no array ({described(error)})."
        ) from error
    step_s = observation.step_s
    least = round(LEAST_PLAN_S / step_s)
    if arrays[0].ndim and not len(arrays[0]):
        raise PlanEndError(f"The policy {name} has no further plan.")
    for field, values in zip(fields, arrays, strict=True):
        shape = (len(arrays[0]) if arrays[0].ndim else 0,)
        shape += (2,) if field == "position_m" else ()
        if values.dtype.kind not in "fiu" or values.shape != shape or shape[0] < least:
            many = shape[0] if shape[0] >= least else f"{least} or more"
            size = f"[{', '.join(map(str, ('F', *shape[1:])))}]"
            raise GenerationError(
                f"The policy {name} returned {field} of type {values.dtype} with the "
                f"shape {values.shape}; expected numbers {size} for F = {many} steps."
            )
        if not np.isfinite(values).all():
            step, *_ = np.argwhere(~np.isfinite(values))[0].tolist()
            raise GenerationError(
                f"The policy {name} returned {field} with {values[step]} at step {step}; "
                "expected finite numbers."
            )
    if fields[0] == "position_m":
        plan = Plan(position_m=arrays[0].astype(float), heading_rad=arrays[1] * 1.0)
    else:
        plan = _driven(arrays[0] * 1.0, arrays[1] * 1.0, observation)
    _check_possible(plan, observation, name)
    return plan


def _check_possible(plan: Plan, observation: Observation, name: str) -> None:
    """Raise if a plan jumps, or exceeds what any vehicle can do."""
    ego, step_s = observation.ego, observation.step_s
    path = np.concatenate([ego.position_m[:1, -1], plan.position_m])
    velocity = np.concatenate(
        [ego.velocity_mps[:1, -1], np.diff(path, axis=0) / step_s]
    )
    jump = float(np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max())
    if jump > _MOST_JUMP_MPS:
        raise GenerationError(
            f"The policy {name} planned a motion whose velocity changes by {jump:.1f} m/s "
            f"in a step of {step_s:g} s; expected at most {_MOST_JUMP_MPS:g} m/s."
        )
    apart = round(LEAST_PLAN_S / step_s)
    heading = np.append(ego.heading_rad[:1, -1], plan.heading_rad)
    turned = np.cumsum(wrap_angle(np.diff(heading, prepend=heading[0])))
    # No recorded track has more, noise included.
    for what, values, most, unit in (
        ("an acceleration", velocity, 30.0, "m/s²"),
        ("a yaw rate", turned[:, None], 4.0, "rad/s"),
    ):
        change = np.linalg.norm(values[apart:] - values[:-apart], axis=-1)
        rate = float(change.max()) / LEAST_PLAN_S
        if rate > most:
            raise GenerationError(
                f"The policy {name} planned {what} of {rate:.1f} {unit} over "
                f"{LEAST_PLAN_S:g} s; expected at most {most:g} {unit}."
            )


def _driven(
    acceleration_mps2: Float[np.ndarray, "F"],
    curvature_1pm: Float[np.ndarray, "F"],
    observation: Observation,
) -> Plan:
    """States of a kinematic bicycle, which does not drive backwards."""
    ego, step_s = observation.ego, observation.step_s
    first = float(np.hypot(*ego.velocity_mps[0, -1]))
    speed = np.empty(len(acceleration_mps2) + 1)
    speed[0] = first
    for step, change in enumerate(acceleration_mps2.tolist()):
        speed[step + 1] = max(speed[step] + change * step_s, 0.0)
    way = (speed[1:] + speed[:-1]) / 2 * step_s
    heading = ego.heading_rad[0, -1] + np.cumsum(curvature_1pm * way)
    middle = heading - curvature_1pm * way / 2
    steps = way[:, None] * unit_vector(middle)
    position = ego.position_m[0, -1] + np.cumsum(steps, axis=0)
    return Plan(position_m=position, heading_rad=wrap_angle(heading))


def plans_at(
    plans: DrivenPlans, agents: AgentTracks, step: int
) -> list[Float[np.ndarray, "F 2"]]:
    """The latest plans of the agents that are there at a step."""
    found = []
    for name, made in plans.items():
        row = agents.row_of.get(name)
        latest = max((one for one in made if one <= step), default=None)
        if row is not None and latest is not None and agents.is_valid[row, step]:
            found.append(made[latest])
    return found
