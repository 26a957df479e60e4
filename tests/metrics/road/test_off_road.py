from dataclasses import replace

import numpy as np
import pytest
import shapely

from pd_editor.av2_io.read import read_scenario
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.metrics.road.off_road import drivable_ground, is_off_road, off_road
from pd_editor.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers, two_lane_road

NOW = np.array([50])


def turn(power, x=0.0, y=0.0):
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=0.0)
    term = WarpTerm(kind="smooth-turn", power=power, length_m=10.0)
    return RoadWarp(anchor=anchor, terms=(term,))


def test_centres_and_corners_off_the_road():
    agents = straight_drivers([(0, 0, 0, 0), (30, -1.2, 0, 0), (60, -4, 0, 0)])
    found = off_road(scenario_with(agents), NOW)
    np.testing.assert_array_equal(found.center[:, 0], [False, False, True])
    np.testing.assert_array_equal(found.num_corners[:, 0], [0, 2, 4])
    assert found.share() == 1 / 3


def test_leaving_later_counts_at_the_step_of_leaving():
    agents = straight_drivers([(0, 0, -np.pi / 4, 10)])
    found = off_road(scenario_with(agents), np.arange(51, 110))
    # 1.75 m to the edge at 10 / sqrt(2) m/s: 0.247 s.
    assert found.center[0].argmax() + 51 == 53


def test_pedestrians_and_absent_agents_are_not_judged():
    agents = straight_drivers(
        [(0, 20, 0, 0), (0, 30, 0, 0)],
        kinds=(AgentKind.PEDESTRIAN, AgentKind.VEHICLE),
    )
    agents = replace(agents, is_valid=np.zeros_like(agents.is_valid))
    found = off_road(scenario_with(agents), NOW)
    assert not found.is_evaluated.any()
    assert found.share() == 0


def test_without_drivable_areas_lanes_count():
    lanes_only = replace(two_lane_road(), drivable_areas=())
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (0, 9, 0, 0)]), lanes_only)
    np.testing.assert_array_equal(off_road(scenario, NOW).center[:, 0], [False, True])


def test_the_ground_is_built_once():
    road_map = two_lane_road()
    assert drivable_ground(road_map) is drivable_ground(road_map)


def test_a_warp_takes_the_road_along():
    scenario = scenario_with(straight_drivers([(40, 0, 0, 10), (20, 3.5, 0, 5)]))
    later = np.arange(51, 80)
    warped = warp_scenario(scenario, turn(8.0))
    assert not off_road(warped, later).center.any()
    left_behind = warped.with_agents(scenario.agents)
    assert off_road(left_behind, later).center.any()


@pytest.mark.real_data
def test_real_points_agree_with_the_warped_polygon(av2_scenario_folders):
    rng = np.random.default_rng(0)
    for folder in av2_scenario_folders[::16]:
        scenario = read_scenario(folder)
        edge = np.concatenate([a.boundary for a in scenario.road_map.drivable_areas])
        x, y = edge[:, :2].mean(axis=0).tolist()
        warped = warp_scenario(scenario, turn(5.0, x, y))
        points = rng.uniform(edge.min(axis=0), edge.max(axis=0), (500, 3))[:, :2]
        polygons = [
            shapely.make_valid(shapely.Polygon(area.boundary[:, :2]))
            for area in warped.road_map.drivable_areas
        ]
        ground = shapely.union_all(np.array(polygons, object))
        wanted = ~shapely.contains_xy(ground, points[:, 0], points[:, 1])
        # Warped edges are polylines with points every 2 m, so 10 cm beside them differ.
        clear = shapely.distance(ground.boundary, shapely.points(points)) > 0.2
        found = is_off_road(warped, points)
        np.testing.assert_array_equal(found[clear], wanted[clear])
