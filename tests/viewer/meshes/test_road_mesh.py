import numpy as np
import pytest
import shapely

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_layers import line_styles
from pd_editor.scene.road_map import LaneKind, LaneMark, RoadMap
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.meshes.flat_mesh import FlatMesh
from pd_editor.viewer.meshes.road_mesh import cells, road_parts
from tests.builders import straight_lane, two_lane_road


def area(mesh: FlatMesh) -> float:
    a, b, c = (mesh.points_m[mesh.faces[:, corner]] for corner in range(3))
    cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return float(cross.sum() / 2)


def part_area(parts, color_name: str) -> float:
    return sum(area(part.mesh) for part in parts if part.color_name == color_name)


def test_areas_of_the_two_lane_road():
    parts = road_parts(two_lane_road())
    assert part_area(parts, "road") == pytest.approx(300 * 7, rel=1e-6)
    assert part_area(parts, "lane") == pytest.approx(300 * 7, rel=1e-6)
    # One solid edge, two dashed lines (3 m painted of 9), the shared one drawn once.
    solid, dashed = 300 * 0.17, 2 * 300 * 0.17 / 3
    assert part_area(parts, "white_marking") == pytest.approx(solid + dashed, rel=0.05)


@pytest.mark.parametrize("kind", [LaneKind.BIKE, LaneKind.BUS])
def test_special_lanes_are_tinted_outside_junctions_only(kind):
    """Connectors of bike lanes painted whole junctions green (D17)."""
    before = straight_lane(1, (0, 0), (10, 0), kind=kind, successors=(2,))
    within = straight_lane(2, (10, 0), (30, 0), kind=kind, is_intersection=True)
    parts = road_parts(RoadMap(lanes=(before, within)))
    assert part_area(parts, f"{kind.lower()}_lane") == pytest.approx(10 * 3.5)
    assert part_area(parts, "intersection") == pytest.approx(20 * 3.5)


def test_cells_cover_an_area_with_a_hole_exactly():
    ring = shapely.Point(3, 4).buffer(30).difference(shapely.Point(5, 5).buffer(7))
    assert area(cells([ring])) == pytest.approx(ring.area, rel=1e-9)


def test_a_sheared_mesh_keeps_its_area_and_folds_nowhere():
    # A shear keeps areas; cells are small enough for no triangle to flip.
    parts = road_parts(two_lane_road())
    warp = RoadWarp(
        anchor=RigidMotion(x_m=-80.0, y_m=0.0, rotation_rad=0.0),
        terms=(WarpTerm(kind="double-turn", power=10.0, length_m=10.0),),
    )
    for part in parts:
        moved = FlatMesh(points_m=warp.apply(part.mesh.points_m), faces=part.mesh.faces)
        if len(part.mesh.faces):
            assert area(moved) == pytest.approx(area(part.mesh), rel=0.02)


@pytest.mark.parametrize("mark", list(LaneMark))
def test_every_mark_has_one_or_two_lines(mark):
    assert len(line_styles(mark)) == (2 if mark.count("_") == 2 else 1)


def test_real_drivable_areas_are_covered(av2_scenario_folders):
    for folder in av2_scenario_folders[:4]:
        road = read_scenario(folder).road_map
        parts = road_parts(road)
        expected = sum(
            shapely.make_valid(shapely.Polygon(a.boundary[:, :2])).area
            for a in road.drivable_areas
        )
        assert part_area(parts, "road") == pytest.approx(expected, rel=1e-6)
        assert all(np.isfinite(part.mesh.points_m).all() for part in parts)


def test_arrows_point_along_lanes_outside_junctions():
    forth = straight_lane(1, (0, 0), (100, 0))
    back = straight_lane(2, (100, 4), (0, 4))
    within = straight_lane(3, (100, 0), (160, 0), is_intersection=True)
    short = straight_lane(4, (160, 0), (162, 0))
    (mesh,) = (
        part.mesh
        for part in road_parts(RoadMap(lanes=(forth, back, within, short)))
        if part.color_name == "direction"
    )
    tip, left, notch, right = mesh.points_m.reshape(-1, 4, 2).swapaxes(0, 1)
    assert (tip[:, 0] < 100).all()
    assert (np.sign(tip - notch)[:, 0] == np.where(tip[:, 1] < 2, 1, -1)).all()
    np.testing.assert_allclose((left + right)[:, 1] / 2, tip[:, 1])
    assert sorted(tip[:, 1]) == [0.0] * 3 + [4.0] * 3
