"""The same scene elsewhere, and otherwise ordered."""

from dataclasses import replace

from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.scenario import Scenario


def moved(scenario: Scenario, motion: RigidMotion) -> Scenario:
    agents = scenario.agents
    turned = replace(
        agents,
        position_m=motion.apply(agents.position_m),
        heading_rad=wrap_angle(agents.heading_rad + motion.rotation_rad),
        velocity_mps=motion.turn(agents.velocity_mps),
    )
    return replace(
        scenario, agents=turned, road_map=scenario.road_map.moved(motion.apply)
    )
