"""Validation of the numbers and agent ids of commands."""

import math
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from pd_editor.base.errors import EditError
from pd_editor.base.plain_text import MAX_ID_CHARACTERS, is_plain, listed
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_limits import (
    MAX_AGENTS,
    MAX_POSITION_M,
    MAX_SPEED_MPS,
    agents_excess,
    road_excess,
)
from pd_editor.scene.thresholds import FASTEST_MPS

MIN_SIZE_M: Final = 0.2
MAX_SIZE_M: Final = 30.0
MIN_FRICTION: Final = 0.01
MAX_FRICTION: Final = 2.0
_MAX_NUMBER: Final = 1e6
"""Upper bound of coordinates in metres and angles in degrees."""


def check_number(title: str, value: float, unit: str) -> None:
    """Raise for NaN, infinity and numbers out of range; the title is the panel's."""
    _check_finite(title, value)
    if abs(value) > _MAX_NUMBER:
        raise EditError(
            f"{title} is {value:g} {unit}; expected a number between -{_MAX_NUMBER:g}"
            f" and {_MAX_NUMBER:g}."
        )


def check_angle(title: str, angle_rad: float) -> None:
    """Raise for angles that are not finite or out of range."""
    check_number(title, math.degrees(angle_rad), "deg")


def check_speed(speed_mps: float) -> None:
    """Raise for impossible speeds; negative ones mean driving backwards."""
    _check_finite("Speed", speed_mps)
    if abs(speed_mps) > FASTEST_MPS:
        raise EditError(
            f"Speed {speed_mps:g} m/s is outside -{FASTEST_MPS:g}..{FASTEST_MPS:g} m/s."
        )


def check_size(length_m: float, width_m: float) -> None:
    """Raise for impossible sizes."""
    _check_finite("Length", length_m)
    _check_finite("Width", width_m)
    if not all(MIN_SIZE_M <= value <= MAX_SIZE_M for value in (length_m, width_m)):
        raise EditError(
            f"Size {length_m:g} x {width_m:g} m is outside"
            f" {MIN_SIZE_M:g}..{MAX_SIZE_M:g} m."
        )


def check_position(x_m: float, y_m: float) -> None:
    """Raise for positions far outside any scene."""
    _check_finite("Position x", x_m)
    _check_finite("Position y", y_m)
    if max(abs(x_m), abs(y_m)) > MAX_POSITION_M:
        raise EditError(
            f"Position ({x_m:.1f}, {y_m:.1f}) m is more than"
            f" {MAX_POSITION_M:g} m from the scene's origin."
        )


def check_friction(coefficient: float) -> None:
    """Raise for friction coefficients that no road has."""
    _check_finite("Friction coefficient", coefficient)
    if not MIN_FRICTION <= coefficient <= MAX_FRICTION:
        raise EditError(
            f"Friction coefficient {coefficient:g} is outside"
            f" {MIN_FRICTION:g}..{MAX_FRICTION:g}."
        )


def check_anchor(anchor: RigidMotion) -> None:
    """Raise for anchors of a warp that are not finite or out of range."""
    check_number("Anchor x", anchor.x_m, "m")
    check_number("Anchor y", anchor.y_m, "m")
    check_angle("Anchor heading", anchor.rotation_rad)


def _check_finite(title: str, value: float) -> None:
    if not math.isfinite(value):
        raise EditError(f"{title} is {value}, but must be a finite number.")


def check_positions(position_m: Float[np.ndarray, "*shape 2"]) -> None:
    """Raise for arrays of positions that are not finite or far outside any scene."""
    if not np.isfinite(position_m).all():
        raise EditError("A position holds NaN or infinity.")
    if np.abs(position_m).max(initial=0.0) > MAX_POSITION_M:
        raise EditError(
            "An agent would come to lie more than"
            f" {MAX_POSITION_M:g} m from the scene's origin."
        )


def check_velocities(velocity_mps: Float[np.ndarray, "*shape 2"]) -> None:
    """Raise for arrays of velocities that are not finite or impossible."""
    if not np.isfinite(velocity_mps).all():
        raise EditError("A velocity holds NaN or infinity.")
    fastest = float(np.abs(velocity_mps).max(initial=0.0))
    if fastest > MAX_SPEED_MPS:
        raise EditError(
            f"An agent would move at {fastest:g} m/s; expected at most"
            f" {MAX_SPEED_MPS:g} m/s."
        )


def check_opens_again(before: Scenario, after: Scenario) -> None:
    """Raise for an edited scene that its reader would refuse after an export."""
    has_new_road = after.road_map is not before.road_map
    excess = None
    if has_new_road or after.agents is not before.agents:
        excess = agents_excess(after.agents, after.road_map)
    if excess is None and has_new_road:
        excess = road_excess(after.road_map)
        excess = excess and f"The road could not be opened again: {excess}"
    if excess is not None:
        raise EditError(excess)


def check_number_of_agents(count: int) -> None:
    """Raise for more agents than a scene may have."""
    if count > MAX_AGENTS:
        raise EditError(
            f"The scene would have {count} agents; at most {MAX_AGENTS} are possible."
        )


def check_new_id(
    scenario: Scenario, agent_id: str, *, may_be_retired: bool = False
) -> None:
    """Raise for ids that are empty, in use, of a deleted agent, or no valid text."""
    if not agent_id:
        raise EditError("A new agent needs an id that is not empty.")
    if not is_plain(agent_id):
        raise EditError(
            f"{agent_id!r} cannot be an agent's id; expected a text of one line, at"
            f" most {MAX_ID_CHARACTERS} characters."
        )
    if agent_id in scenario.agents.row_of:
        raise EditError(f"There is already an agent {agent_id!r} here.")
    if scenario.has_ever_had(agent_id) and not may_be_retired:
        raise EditError(
            f"{agent_id!r} was the id of an agent that was deleted; expected a new id."
        )


def rows_of(scenario: Scenario, agent_ids: tuple[str, ...]) -> Int[np.ndarray, "G"]:
    """Rows of agents in the given order, without duplicates.

    Raises:
        EditError: there are no ids, or one is not in the scenario.
    """
    if not agent_ids:
        raise EditError("No agent is selected; select at least one first.")
    return scenario.agents.rows(dict.fromkeys(agent_ids))


def present_rows(
    scenario: Scenario, agent_ids: tuple[str, ...]
) -> Int[np.ndarray, "G"]:
    """Rows of agents that all have a state at the current step.

    Raises:
        EditError: as ``rows_of``, or an agent has no state now.
    """
    rows = rows_of(scenario, agent_ids)
    absent = rows[~scenario.agents.is_valid[rows, scenario.current_step]]
    if len(absent):
        names = listed([scenario.agents.ids[row] for row in absent])
        raise EditError(
            f"Agent {names} has no state at the current step"
            f" {scenario.current_step}, so it can only be deleted."
        )
    return rows
