"""The pose ahead of which a warp bends the road."""

from pd_editor.errors import EditError
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.scene.scenario import Scenario


def pose_on_original_road(scenario: Scenario, agent_id: str) -> RigidMotion:
    """An agent's current pose, on the road as it was before any warp.

    Raises:
        EditError: there is no such agent, or not at the current step.
    """
    applied, step = scenario.applied_warp, scenario.current_step
    agents = scenario.agents
    if applied is not None and agent_id in applied.original_agents.row_of:
        agents = applied.original_agents
    (row,) = agents.rows([agent_id])
    if not agents.is_valid[row, step]:
        raise EditError(f"Agent {agent_id} is not there at the current step.")
    x, y = agents.position_m[row, step]
    return RigidMotion(
        x_m=float(x), y_m=float(y), rotation_rad=float(agents.heading_rad[row, step])
    )
