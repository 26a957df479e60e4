"""Anchor poses: a warp bends the road ahead of its anchor."""

from pd_editor.base.errors import EditError
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import unwarped
from pd_editor.scene.scenario import EGO_ID, Scenario


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
