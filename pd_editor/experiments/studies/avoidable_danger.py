"""Dangerous but avoidable: behaviours of one agent that the ego hits, but need not.

A behaviour is one of the agent's Frenet candidates. It is dangerous if the ego collides
with it on the trajectory that it has, and avoidable if one of the ego's own candidates
collides with nothing. All other agents move as in the scenario.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_collide, first_collisions
from pd_editor.base.errors import EditError
from pd_editor.editor.commands import AdoptTrajectory
from pd_editor.editor.scenario_store import scene_part
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.motion_primitives import CandidateSet, candidates
from pd_editor.scene.scenario import EGO_ID, Scenario

REACH_M: Final = 60.0
"""Agents farther from the ego at the current step are not searched."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AvoidableDanger:
    """A behaviour of an agent that the ego hits, and one of the ego that avoids it."""

    agent_id: str
    ego_id: str
    time_s: float
    """Time of the collision after the current step."""
    impact_mps: float
    """Relative speed at the collision."""
    num_avoiding: int
    """Number of the ego's candidates that collide with nothing."""
    behaviour: AdoptTrajectory
    escape: AdoptTrajectory
    """The first, most natural of the ego's candidates that avoid the collision."""


def ego_of(scenario: Scenario) -> str:
    """Id of the ego vehicle, or of the focal agent where there is none.

    Raises:
        EditError: neither is there at the current step.
    """
    agents, now = scenario.agents, scenario.current_step
    for name in (EGO_ID, scenario.focal_id):
        row = agents.row_of.get(name)
        if row is not None and agents.is_valid[row, now]:
            return name
    raise EditError("There is neither an ego vehicle nor a focal agent at t = 0.")


def avoidable_dangers(scenario: Scenario) -> tuple[AvoidableDanger, ...]:
    """The most dangerous avoidable behaviour of each agent, the hardest impact first.

    Motor vehicles within 60 m of the ego are searched.

    Raises:
        EditError: there is no ego.
    """
    agents, now = scenario.agents, scenario.current_step
    (ego_row,) = agents.rows([ego_of(scenario)])
    escapes = candidates(scenario, np.array([ego_row]))
    if not agents.is_valid[ego_row, now:].all() or not escapes.is_valid[0].any():
        return ()
    rows = _near_vehicles(scenario, int(ego_row))
    found = (_worst(scenario, int(ego_row), int(row), escapes) for row in rows)
    return tuple(
        sorted((one for one in found if one is not None), key=lambda d: -d.impact_mps)
    )


def dangers_of_part(part: tuple[Path, SceneCut]) -> tuple[AvoidableDanger, ...]:
    """``avoidable_dangers`` of what is used of a recorded scene, as a work item.

    Raises:
        InputError: the scenario cannot be read.
        EditError: there is no ego.
    """
    return avoidable_dangers(scene_part(*part))


def _near_vehicles(scenario: Scenario, ego_row: int) -> Int[np.ndarray, "N"]:
    agents, now = scenario.agents, scenario.current_step
    offset = agents.position_m[:, now] - agents.position_m[ego_row, now]
    is_near = np.hypot(*offset.T) <= REACH_M
    is_near &= agents.is_valid[:, now] & agents.kind_mask(MOTOR_VEHICLE_KINDS)
    is_near[ego_row] = False
    return np.flatnonzero(is_near)


def _worst(
    scenario: Scenario, ego_row: int, row: int, escapes: CandidateSet
) -> AvoidableDanger | None:
    """The avoidable behaviour of one agent with the hardest impact."""
    agents, now = scenario.agents, scenario.current_step
    without_ego = scenario.without_agents([agents.ids[ego_row]])
    behaviours = candidates(scenario, np.array([row]))
    is_free = behaviours.is_valid[0] & _collides_with_none(
        without_ego, agents.ids[row], behaviours
    )
    if not is_free.any():
        return None
    behaved = _boxes_of(scenario, row, behaviours)
    hits, step = _collisions(agents.boxes[[ego_row], now:], behaved)
    hits, step = hits[0] & (step[0] > 0), step[0]
    # Of the ego's candidates, those that avoid all others, whatever the agent does.
    without_agent = scenario.without_agents([agents.ids[row]])
    is_safe = escapes.is_valid[0] & _collides_with_none(
        without_agent, agents.ids[ego_row], escapes
    )
    meets, _ = _collisions(_boxes_of(scenario, ego_row, escapes), behaved)
    avoids = is_safe[:, None] & ~meets
    index = np.flatnonzero(is_free & hits & avoids.any(axis=0))
    if not len(index):
        return None
    at = now + step[index]
    relative = (
        behaviours.velocity_mps[0, index, step[index]]
        - agents.velocity_mps[ego_row, at]
    )
    impact = np.hypot(*relative.T)
    best = int(np.argmax(impact))
    chosen = int(index[best])
    return AvoidableDanger(
        agent_id=agents.ids[row],
        ego_id=agents.ids[ego_row],
        time_s=float(step[chosen] * scenario.time_axis.step_s),
        impact_mps=float(impact[best]),
        num_avoiding=int(avoids[:, chosen].sum()),
        behaviour=_adopted(agents.ids[row], behaviours, chosen),
        escape=_adopted(
            agents.ids[ego_row], escapes, int(np.argmax(avoids[:, chosen]))
        ),
    )


def _collides_with_none(
    scenario: Scenario, agent_id: str, found: CandidateSet
) -> Bool[np.ndarray, "C"]:
    (row,) = scenario.agents.rows([agent_id])
    collisions = first_collisions(
        scenario, int(row), found.position_m[0], found.heading_rad[0], found.is_valid[0]
    )
    return np.array([one is None for one in collisions], bool)


def _boxes_of(scenario: Scenario, row: int, found: CandidateSet) -> Boxes:
    """Boxes [K H] of an agent on each of its candidates."""
    return Boxes(
        position_m=found.position_m[0],
        heading_rad=found.heading_rad[0],
        size_m=scenario.agents.size_m[row],
    )


def _collisions(
    one: Boxes, other: Boxes
) -> tuple[Bool[np.ndarray, "K L"], Int[np.ndarray, "K L"]]:
    """Whether K paths of an agent collide with L of another one, and the first step."""
    hit = boxes_collide(one[:, None], other[None])
    num_steps = hit.shape[-1]
    first = np.where(hit.any(axis=-1), hit.argmax(axis=-1), num_steps)
    return first < num_steps, np.minimum(first, num_steps - 1)


def _adopted(agent_id: str, found: CandidateSet, index: int) -> AdoptTrajectory:
    return AdoptTrajectory.of_arrays(
        agent_id=agent_id,
        position_m=found.position_m[0, index],
        heading_rad=found.heading_rad[0, index],
        velocity_mps=found.velocity_mps[0, index],
    )
