"""A warp applied to a whole scenario: road, agents, pasts and futures alike."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from pd_editor.perturbation.friction_slowdown import slowed_to_friction_limit
from pd_editor.perturbation.warped_agents import warped_agents
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import AppliedWarp, Scenario


def warp_scenario(
    scenario: Scenario,
    warp: RoadWarp | None,
    *,
    friction_coefficient: float | None = None,
) -> Scenario:
    """The scenario under this warp alone; a warp in force is taken back first.

    None, or a warp that moves nothing, gives back exactly the original: the road is
    the original object, and so are the agents if none was edited. Points, headings
    and velocities follow the plane (reference: Scene-Attack, CVPR 2022, with the
    Jacobian J = [[1, 0], [f', 1]]); the speed of every agent is kept. With a friction
    coefficient mu, agents that would exceed sqrt(mu g / kappa) are slowed. Agents
    edited under a warp are taken back by its inverse; if they had been slowed, they
    keep their new speeds, since those are what was edited.
    """
    road_map, agents = _unwarped(scenario)
    if warp is None or warp.is_identity:
        return replace(scenario, road_map=road_map, agents=agents, applied_warp=None)
    warped = warped_agents(agents, warp)
    if friction_coefficient is not None:
        warped = slowed_to_friction_limit(
            agents, warped, warp, friction_coefficient, scenario.time_axis
        )
    return replace(
        scenario,
        road_map=road_map.dense.moved(warp.apply),
        agents=warped,
        applied_warp=AppliedWarp(
            warp=warp,
            friction_coefficient=friction_coefficient,
            original_road_map=road_map,
            original_agents=agents,
            warped_agents=warped,
        ),
    )


def _unwarped(scenario: Scenario) -> tuple[RoadMap, AgentTracks]:
    """Road and agents as they are without the warp in force."""
    applied = scenario.applied_warp
    agents = scenario.agents
    if applied is None:
        return scenario.road_map, agents
    if agents is applied.warped_agents:
        return applied.original_road_map, applied.original_agents
    restored = warped_agents(agents, applied.warp, sign=-1.0)
    known = [row for row, name in enumerate(agents.ids) if name in _rows(applied)]
    rows = np.array(known, int)
    theirs = applied.warped_agents.rows(agents.ids[row] for row in known)
    untouched = _same_motion(agents, rows, applied.warped_agents, theirs)
    rows, theirs = rows[untouched], theirs[untouched]
    original = applied.original_agents
    restored = restored.with_rows(
        rows,
        position_m=original.position_m[theirs],
        heading_rad=original.heading_rad[theirs],
        velocity_mps=original.velocity_mps[theirs],
    )
    return applied.original_road_map, restored


def _rows(applied: AppliedWarp) -> dict[str, int]:
    return applied.warped_agents.row_of


def _same_motion(
    agents: AgentTracks, rows: np.ndarray, other: AgentTracks, other_rows: np.ndarray
) -> Bool[np.ndarray, "N"]:
    """Whether rows of two sets of tracks move exactly alike."""
    same = np.ones(len(rows), bool)
    for name in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
        equal = getattr(agents, name)[rows] == getattr(other, name)[other_rows]
        same &= equal.reshape(len(rows), -1).all(axis=1)
    return same
