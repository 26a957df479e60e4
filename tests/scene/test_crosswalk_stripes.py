import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.road_layers import STRIPE_M, _direction, crosswalk_stripes
from pd_editor.scene.road_map import Crosswalk, DrivableArea, RoadMap


def flat(points) -> np.ndarray:
    return np.column_stack([np.array(points, float), np.zeros(len(points))])


def crossing(edge1, edge2, number: int = 1) -> Crosswalk:
    return Crosswalk(crosswalk_id=number, edge1=flat(edge1), edge2=flat(edge2))


def drivable(ring) -> DrivableArea:
    return DrivableArea(area_id=1, boundary=flat(ring))


def shapes(road: RoadMap) -> list:
    return list(crosswalk_stripes(road))


offset = st.floats(-4.0, 4.0)


@given(st.tuples(*[offset] * 4), st.floats(2.5, 5.0))
def test_stripes_are_parallel_and_lie_inside_the_crossing(moved, width):
    """Crossings whose edges differ in length fanned out over the kerb (D16)."""
    a, b, c, d = moved
    one = crossing([(0 + a, 0), (14 + b, 0)], [(0 + c, width), (14 + d, width)])
    region = shapely.Polygon(one.outline_m())
    if not region.is_valid:
        return
    along = _direction(one)
    across = np.array([-along[1], along[0]])
    found = shapes(RoadMap(lanes=(), crosswalks=(one,)))
    assert found
    for stripe in found:
        assert stripe.difference(region.buffer(1e-6)).area < 1e-6
        side = shapely.get_coordinates(stripe) @ across
        assert np.ptp(side) <= STRIPE_M + 1e-6


def test_a_straight_crossing_is_half_painted():
    one = crossing([(0, 0), (10.5, 0)], [(0, 3), (10.5, 3)])
    found = shapes(RoadMap(lanes=(), crosswalks=(one,)))
    assert len(found) == 11
    assert sum(stripe.area for stripe in found) == pytest.approx(11 * 0.5 * 3)


def test_stripes_stay_on_the_drivable_area():
    one = crossing([(0, 0), (20, 0)], [(0, 3), (20, 3)])
    paved = [(5, -9), (15, -9), (15, 9), (5, 9)]
    road = RoadMap(lanes=(), crosswalks=(one,), drivable_areas=(drivable(paved),))
    found = shapely.union_all(shapes(road))
    assert found.difference(shapely.Polygon(paved).buffer(1e-6)).area < 1e-6
    assert found.area == pytest.approx(10 * 3 / 2, rel=0.1)


def test_stripes_of_two_crossings_never_interleave():
    one = crossing([(0, 0), (12, 0)], [(0, 4), (12, 4)])
    two = crossing([(10, -2), (10, 10)], [(13, -2), (13, 10)], number=2)
    found = shapes(RoadMap(lanes=(), crosswalks=(one, two)))
    # One stripe of the other crossing may end at the common ground, none may enter it.
    common = shapely.box(10, 0, 12, 4)
    inside = [stripe for stripe in found if stripe.intersection(common).area > 1e-6]
    sides = [np.ptp(shapely.get_coordinates(stripe), axis=0) for stripe in inside]
    assert inside
    assert len({bool(width < height) for width, height in sides}) == 1


def test_real_stripes_lie_inside_their_crossings(av2_scenario_folders):
    for folder in av2_scenario_folders[:6]:
        road = read_scenario(folder).road_map
        outlines = [shapely.Polygon(c.outline_m()) for c in road.crosswalks]
        allowed = shapely.union_all([shapely.make_valid(o) for o in outlines])
        for stripe in shapes(road):
            assert stripe.difference(allowed.buffer(1e-4)).area < 1e-4
