"""Selection of a new focal agent when the focal agent was removed."""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.scene.agent_kind import (
    MOTOR_VEHICLE_KINDS,
    ROAD_USER_KINDS,
    AgentCategory,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.scenario import EGO_ID, Scenario

MOVING_MPS: Final = 1.0
"""Least mean speed over the future of a moving agent."""


def focal_place_m(scenario: Scenario) -> Float[np.ndarray, "2"]:
    """Position of the focal agent at the current step.

    The scene's origin, its recorded position, if it does not exist at that step.
    """
    agents, step = scenario.agents, scenario.current_step
    row = agents.row_of.get(scenario.focal_id)
    if row is None or not agents.is_valid[row, step]:
        return np.zeros(2)
    return agents.position_m[row, step]


def driven_id(scenario: Scenario) -> str:
    """Id of whom a policy drives unless another is named: the ego, else the focal agent."""
    there = scenario.agents.row_of
    has_only_focal = EGO_ID not in there and scenario.focal_id in there
    return scenario.focal_id if has_only_focal else EGO_ID


def with_focal_agent(
    scenario: Scenario, place_m: Float[np.ndarray, "2"] | None = None
) -> Scenario:
    """Choose a focal agent for a scenario that has lost it and has agents left.

    The choice is the nearest moving motor vehicle with a complete trajectory; without
    one, the nearest agent of the first of these groups that is not empty: moving motor
    vehicles, motor vehicles, road users, all agents. Provenance names it.

    Args:
        scenario: the scenario without its focal agent.
        place_m: last position of that agent; the scene's origin if not given.
    """
    if scenario.focal_id in scenario.agents.row_of:
        return scenario
    row = next_focal_row(
        scenario.agents,
        scenario.current_step,
        np.zeros(2) if place_m is None else place_m,
    )
    if row is None:
        return scenario
    focal_id = scenario.agents.ids[row]
    kind = scenario.agents.kinds[row].in_words
    return replace(
        scenario.with_agents(
            with_focal_category(scenario.agents, focal_id),
            f"{kind.capitalize()} {focal_id} is the focal agent now.",
        ),
        focal_id=focal_id,
    )


def with_focal_category(agents: AgentTracks, focal_id: str) -> AgentTracks:
    """Give ``focal_id`` the category FOCAL; other focal tracks become scored ones."""
    categories = tuple(
        AgentCategory.FOCAL
        if agent_id == focal_id
        else AgentCategory.SCORED
        if category is AgentCategory.FOCAL
        else category
        for agent_id, category in zip(agents.ids, agents.categories, strict=True)
    )
    if categories == agents.categories:
        return agents
    return replace(agents, categories=categories)


def next_focal_row(
    agents: AgentTracks, step: int, place_m: Float[np.ndarray, "2"]
) -> int | None:
    """Row of the most suitable agent, the nearest to a position among equals."""
    rows = np.flatnonzero(agents.is_valid[:, step])
    if not len(rows):
        return None
    is_valid = agents.is_valid[rows, step:]
    count = is_valid.sum(axis=1)
    speed = np.where(is_valid, agents.speed_mps()[rows, step:], 0.0).sum(axis=1) / count
    is_motor_vehicle = agents.kind_mask(MOTOR_VEHICLE_KINDS)[rows]
    moves = is_motor_vehicle & (speed >= MOVING_MPS)
    is_complete = is_valid.all(axis=1)
    gap = np.linalg.norm(agents.position_m[rows, step] - place_m, axis=-1)
    order = np.lexsort(
        (
            gap,
            ~agents.kind_mask(ROAD_USER_KINDS)[rows],
            ~is_motor_vehicle,
            ~moves,
            ~(moves & is_complete),
        )
    )
    return int(rows[order[0]])
