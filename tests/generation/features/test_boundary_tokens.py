from dataclasses import replace

import numpy as np
import pytest
import shapely

from pd_editor.analysis.metrics.road import drivable_ground
from pd_editor.generation.features.map_pieces import (
    BOUNDARY_LENGTH_M,
    BOUNDARY_SHAPE,
    boundary_pieces,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_map import DrivableArea, RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers


def ring(area_id: int, points: list[tuple[float, float]]) -> DrivableArea:
    return DrivableArea(
        area_id=area_id, boundary=np.array([(x, y, 0.0) for x, y in points])
    )


def on_ground(*areas: DrivableArea):
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)]))
    road_map = RoadMap(lanes=scenario.road_map.lanes, drivable_areas=areas)
    return replace(scenario, road_map=road_map)


def box(area_id: int, x0: float, y0: float, x1: float, y1: float) -> DrivableArea:
    return ring(area_id, [(x0, y0), (x0, y1), (x1, y1), (x1, y0)])


def test_pieces_run_round_the_ground_with_it_on_their_left():
    found = boundary_pieces(on_ground(box(1, -30, -5, 70, 5)))
    lengths = found.shape[:, BOUNDARY_SHAPE.index("length")] * BOUNDARY_LENGTH_M
    assert lengths.sum() == pytest.approx(220, rel=0.03)
    south = np.abs(found.pose[:, 1] + 5) < 0.01
    assert south.sum() >= 9
    assert np.allclose(found.pose[south, 2], 0, atol=0.01)
    turns = found.shape[:, BOUNDARY_SHAPE.index("turn_before") :]
    assert np.allclose(turns[south][2:-2], 0, atol=0.01)


def test_cracks_between_areas_are_no_boundary_but_islands_are():
    halves = box(1, -30, -5, 20, 5), box(2, 20.2, -5, 70, 5)
    found = boundary_pieces(on_ground(*halves))
    inner = np.abs(found.pose[:, 1]) < 4.5
    assert not (inner & (np.abs(found.pose[:, 0] - 20) < 3)).any()
    around = [
        box(1, -30, -20, 70, -4),
        box(2, -30, 4, 70, 20),
        box(3, -30, -5, 0, 5),
        box(4, 40, -5, 70, 5),
    ]
    found = boundary_pieces(on_ground(*around))
    island = (np.abs(found.pose[:, 1]) < 4.5) & (np.abs(found.pose[:, 0] - 20) < 21)
    assert island.sum() >= 8


def test_a_map_without_ground_has_that_of_its_lanes_and_none_has_none():
    scenario = scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)]))
    assert len(boundary_pieces(scenario).pose) > 0
    bare = replace(scenario, road_map=RoadMap(lanes=()))
    assert boundary_pieces(bare).pose.shape == (0, 3)


def test_on_real_roads_the_ground_is_left_of_the_boundary(av2_scenario_folders):
    for folder in av2_scenario_folders[::9]:
        scenario = read_scenario(folder)
        found = boundary_pieces(scenario)
        ground = drivable_ground(scenario.road_map)
        # Pieces round corners cut them: straight ones only.
        straight = np.abs(found.shape[:, 2]) < 0.05
        pose = found.pose[straight]
        left = np.column_stack([-np.sin(pose[:, 2]), np.cos(pose[:, 2])])
        inside = pose[:, :2] + 1.5 * left
        outside = pose[:, :2] - 1.5 * left
        assert shapely.contains_xy(ground, *inside.T).mean() > 0.95
        assert shapely.contains_xy(ground, *outside.T).mean() < 0.1


def test_under_a_warp_the_boundary_is_bent_with_the_road(av2_scenario_folders):
    scenario = read_scenario(av2_scenario_folders[0])
    before = boundary_pieces(scenario)
    place = scenario.agents.position_m[
        scenario.agents.row_of[scenario.focal_id], scenario.current_step
    ]
    warp = RoadWarp(
        anchor=RigidMotion(x_m=float(place[0]), y_m=float(place[1]), rotation_rad=0.0),
        terms=(WarpTerm(kind="smooth-turn", power=6.0, length_m=10.0),),
    )
    after = boundary_pieces(warp_scenario(scenario, warp, friction_coefficient=None))
    moved = warp.apply(before.pose[:, :2])
    assert np.allclose(after.pose[:, :2], moved, atol=1e-6)
    assert np.abs(wrap_angle(after.pose[:, 2] - before.pose[:, 2])).max() > 0.1
