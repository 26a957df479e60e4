"""Applies all repairs in order."""

from collections.abc import Collection, Iterable

from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.repair.lane_projection import project_to_lanes
from pd_editor.repair.repair_report import RepairReport
from pd_editor.repair.separation import separate_overlaps
from pd_editor.repair.trajectory_retiming import retime_trajectories
from pd_editor.scene.scenario import Scenario


def repair_scene(
    scenario: Scenario,
    agent_ids: Iterable[str] | None = None,
    *,
    keep_ids: Collection[str] | None = None,
    friction_coefficient: float = DRY_ROAD_FRICTION,
) -> tuple[Scenario, RepairReport]:
    """Snap states to lanes, separate overlaps, then retime trajectories.

    Raises:
        EditError: an id is not in the scenario.
    """
    wanted = scenario.agents.ids if agent_ids is None else tuple(agent_ids)
    scenario, report = project_to_lanes(scenario, wanted, keep_ids=keep_ids)
    scenario, apart = separate_overlaps(scenario, wanted, keep_ids=keep_ids)
    scenario, retimed = retime_trajectories(
        scenario,
        wanted,
        keep_ids=keep_ids,
        friction_coefficient=friction_coefficient,
    )
    return scenario, report.joined(apart).joined(retimed)
