from dataclasses import replace

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.lanes import ids_near_lanes
from pd_editor.analysis.metrics.road import drivable_ground, is_off_road, outside_m
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers, two_lane_road


def turn(power, x=0.0, y=0.0):
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=0.0)
    term = WarpTerm(kind="smooth-turn", power=power, length_m=10.0)
    return RoadWarp(anchor=anchor, terms=(term,))


def off_road_now(scenario):
    return is_off_road(scenario, scenario.agents.position_m[:, scenario.current_step])


def test_centres_and_corners_off_the_road():
    agents = straight_drivers([(0, 0, 0, 0), (30, -1.2, 0, 0), (60, -4, 0, 0)])
    scenario = scenario_with(agents)
    np.testing.assert_array_equal(off_road_now(scenario), [False, False, True])
    corners = agents.at(slice(None), scenario.current_step).corners_m()
    assert is_off_road(scenario, corners).sum(axis=1).tolist() == [0, 2, 4]


def test_without_drivable_areas_lanes_count():
    lanes_only = replace(two_lane_road(), drivable_areas=())
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (0, 9, 0, 0)]), lanes_only)
    np.testing.assert_array_equal(off_road_now(scenario), [False, True])


def test_agents_beyond_the_mapped_roads():
    places = [(0, 0, 0, 0), (60, 19, 0, 0), (60, -24, 0, 0), (400, 0, 0, 0)]
    scenario = scenario_with(straight_drivers(places))
    ids = scenario.agents.ids
    assert ids_near_lanes(scenario, ids) == ids[:2]
    assert ids_near_lanes(scenario, ids[3:]) == ids_near_lanes(scenario, ()) == ()
    absent = scenario.agents.is_valid.copy()
    absent[2, scenario.current_step] = False
    later = scenario.with_agents(replace(scenario.agents, is_valid=absent))
    assert ids_near_lanes(later, ids) == ids[:3]
    bare = replace(scenario, road_map=RoadMap(lanes=()))
    assert ids_near_lanes(bare, ids) == ()


def test_distances_to_the_road_are_those_of_its_polygons():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0)]))
    points = np.random.default_rng(0).uniform(-90, 90, (40, 10, 2))
    far = outside_m(scenario, points)
    ground = drivable_ground(scenario.road_map)
    np.testing.assert_allclose(far, shapely.distance(ground, shapely.points(points)))
    assert (far == 0).any()
    assert (far > 1).any()
    bare = replace(scenario, road_map=RoadMap(lanes=()))
    assert not outside_m(bare, points).any()


def test_the_ground_is_built_once():
    road_map = two_lane_road()
    assert drivable_ground(road_map) is drivable_ground(road_map)


def test_a_warp_takes_the_road_along():
    scenario = scenario_with(straight_drivers([(40, 0, 0, 10), (20, 3.5, 0, 5)]))
    warped = warp_scenario(scenario, turn(8.0))
    later = slice(50, 80)
    assert not is_off_road(warped, warped.agents.position_m[:, later]).any()
    assert is_off_road(warped, scenario.agents.position_m[:, later]).any()


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
