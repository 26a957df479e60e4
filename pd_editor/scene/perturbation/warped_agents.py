"""Transforms agents by a warp."""

from dataclasses import replace

from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.road_warp import RoadWarp


def warped_agents(
    agents: AgentTracks, warp: RoadWarp, sign: float = 1.0
) -> AgentTracks:
    """Transform agents by a warp, or by its inverse (sign -1).

    Positions are sheared; headings and velocities follow by the Jacobian J, so that a
    velocity stays the rate of its position and speeds scale by |J t|. States behind
    the warp's border keep their exact values.
    """
    ahead = warp.distance_ahead(agents.position_m)
    touched = agents.is_valid & (ahead > warp.border_m())
    before = agents.position_m[touched]
    direction = unit_vector(agents.heading_rad[touched])

    heading = agents.heading_rad.copy()
    heading[touched] = heading_of(warp.turn(before, direction, sign))
    velocity = agents.velocity_mps.copy()
    velocity[touched] = warp.turn(before, agents.velocity_mps[touched], sign)
    position = agents.position_m.copy()
    position[touched] = warp.apply(before) if sign > 0 else warp.undo(before)
    return replace(
        agents, position_m=position, heading_rad=heading, velocity_mps=velocity
    )
