"""Cures of problems: commands that are offered because they help."""

from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.findings.check import scene_problems
from pd_editor.editor.cures import cures
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers, two_lane_road


def beside_a_yard(*states: tuple[float, float, float, float]) -> Scenario:
    """A yard without lanes north of the road, 20 m to 60 m from it."""
    road_map = two_lane_road()
    ring = np.array([[-10.0, 25.0, 0], [10, 25, 0], [10, 65, 0], [-10, 65, 0]])
    yard = replace(road_map.drivable_areas[0], area_id=99, boundary=ring)
    road_map = replace(road_map, drivable_areas=(*road_map.drivable_areas, yard))
    # The first is the focal agent, on the road.
    return scenario_with(straight_drivers([(-60.0, 0.0, 0.0, 5.0), *states]), road_map)


def offered(scenario: Scenario):
    problems = scene_problems(scenario)
    (problem,) = (one for one in problems if one.kind == "off-road")
    return problem, {one.label: one for one in cures(scenario, problem, problems)}


@pytest.mark.parametrize("is_bent", [False, True])
def test_who_is_a_little_off_the_road_is_moved_onto_it(is_bent):
    """Far from lanes nothing but removal was offered."""
    scenario = beside_a_yard((0.0, 65.02, 0.0, 0.0))
    if is_bent:
        term = WarpTerm(kind="smooth-turn", power=3.0, length_m=40.0)
        anchor = RigidMotion(x_m=-20.0, y_m=0.0, rotation_rad=0.0)
        scenario = warp_scenario(scenario, RoadWarp(anchor=anchor, terms=(term,)))
    problem, found = offered(scenario)
    assert list(found) == ["Move 101 onto the road", "Remove 101"]
    command = found["Move 101 onto the road"].command
    assert command is not None
    after = command.apply(scenario)
    assert problem.key not in {one.key for one in scene_problems(after)}
    row, now = after.agents.row_of["101"], after.current_step
    way = after.agents.position_m[row, now] - scenario.agents.position_m[row, now]
    assert 0.3 < np.hypot(*way) < 0.4


def test_who_is_far_from_the_road_is_not_moved_across_the_country():
    _, found = offered(beside_a_yard((0.0, 75.0, 0.0, 0.0)))
    assert list(found) == ["Remove 101"]


def test_who_would_leave_the_road_again_is_not_moved_onto_it():
    _, found = offered(beside_a_yard((0.0, 65.02, 0.5 * np.pi, 5.0)))
    assert "Move 101 onto the road" not in found
