"""Applies a warp to a whole scenario: road, agents at all steps, points of guidance."""

from dataclasses import replace

from pd_editor.base.errors import EditError
from pd_editor.scene.agent_tracks import AgentTracks, same_motion
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.perturbation.friction import slowed_to_friction_limit
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp, warped_agents
from pd_editor.scene.scenario import EGO_ID, AppliedWarp, Scenario


def warp_scenario(
    scenario: Scenario,
    warp: RoadWarp | None,
    *,
    friction_coefficient: float | None = None,
) -> Scenario:
    """Apply a warp to the original scenario; the warp that is applied now is undone first.

    None, or the identity, restores exactly the original: the road is the original
    object, and so are the agents if none was edited. Points, headings and velocities
    follow the plane (Scene-Attack, CVPR 2022; Jacobian J = [[1, 0], [f', 1]]), so
    velocities stay the rates of positions. With a friction coefficient mu, agents that
    would exceed sqrt(mu g / kappa) are slowed. Agents that were edited under a warp are
    transformed by its inverse; if they had been slowed, they keep their edited speeds.
    Points of guidance terms move with the road.
    """
    road_map, agents = unwarped(scenario)
    guidance = _unwarped_guidance(scenario)
    if warp is None or warp.is_identity:
        return replace(
            scenario,
            road_map=road_map,
            agents=agents,
            guidance=guidance,
            applied_warp=None,
        )
    warped_guidance = tuple(term.moved(warp.apply) for term in guidance)
    warped = warped_agents(agents, warp)
    if friction_coefficient is not None:
        warped = slowed_to_friction_limit(
            agents, warped, warp, friction_coefficient, scenario.time_axis
        )
    return replace(
        scenario,
        road_map=road_map.dense.moved(warp.apply),
        agents=warped,
        guidance=warped_guidance,
        applied_warp=AppliedWarp(
            warp=warp,
            friction_coefficient=friction_coefficient,
            original_road_map=road_map,
            original_agents=agents,
            warped_agents=warped,
            original_guidance=guidance,
            warped_guidance=warped_guidance,
        ),
    )


def untouched_agent_ids(
    scenario: Scenario, base: Scenario, steps: slice = slice(None)
) -> frozenset[str]:
    """Ids of agents that move as in ``base`` during ``steps``, apart from the warp."""
    _, agents = unwarped(scenario)
    if agents is base.agents:
        return frozenset(agents.ids)
    rows, _ = same_motion(agents, base.agents, steps)
    return frozenset(agents.ids[row] for row in rows)


def unwarped(scenario: Scenario) -> tuple[RoadMap, AgentTracks]:
    """Road and agents without the applied warp."""
    applied = scenario.applied_warp
    agents = scenario.agents
    if applied is None:
        return scenario.road_map, agents
    if agents is applied.warped_agents:
        return applied.original_road_map, applied.original_agents
    restored = warped_agents(agents, applied.warp, sign=-1.0)
    rows, theirs = same_motion(agents, applied.warped_agents)
    original = applied.original_agents
    if not len(rows):
        return applied.original_road_map, restored
    return applied.original_road_map, restored.with_motion_of(rows, original, theirs)


def _unwarped_guidance(scenario: Scenario) -> tuple[GuidanceTerm, ...]:
    """Guidance terms without the applied warp; unedited ones are exactly the originals."""
    applied = scenario.applied_warp
    if applied is None:
        return scenario.guidance
    pairs = zip(applied.warped_guidance, applied.original_guidance, strict=True)
    originals = dict(pairs)
    return tuple(
        originals[term] if term in originals else term.moved(applied.warp.undo)
        for term in scenario.guidance
    )


def pose_on_original_road(scenario: Scenario, agent_id: str) -> RigidMotion:
    """Current pose of an agent on the original road, before any warp.

    Raises:
        EditError: there is no such agent, or not at the current step.
    """
    step = scenario.current_step
    scenario.agents.rows([agent_id])
    _, agents = unwarped(scenario)
    (row,) = agents.rows([agent_id])
    if not agents.is_valid[row, step]:
        raise EditError(
            f"Agent {agent_id} is not there at the current step; choose another anchor"
            " (on the shell: --anchor ID, or X,Y,HEADING)."
        )
    x, y = agents.position_m[row, step]
    return RigidMotion(
        x_m=float(x), y_m=float(y), rotation_rad=float(agents.heading_rad[row, step])
    )


def pose_of_anchor(scenario: Scenario, name: str) -> RigidMotion:
    """Pose of an anchor: ``focal``, ``ego``, or an agent's id.

    Raises:
        EditError: there is no such agent, or not at the current step.
    """
    there = scenario.agents.row_of
    if name == "focal" and scenario.focal_id not in there:
        raise EditError(
            "This scenario has no focal agent; choose another anchor (on the shell:"
            " --anchor ID, and --focal ID for the export)."
        )
    if name == "ego" and EGO_ID not in there:
        raise EditError(
            f"This scenario has no ego vehicle (track id {EGO_ID}); choose another "
            "anchor."
        )
    agent_id = {"focal": scenario.focal_id, "ego": EGO_ID}.get(name, name)
    return pose_on_original_road(scenario, agent_id)
