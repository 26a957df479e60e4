import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.oriented_box import box_corners, overlap_area

QUARTERS = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi])
BOXES = st.tuples(
    st.floats(-4, 4),
    st.floats(-4, 4),
    st.floats(-3.1, 3.1) | QUARTERS,
    st.floats(0.3, 12),
    st.floats(0.3, 3),
)


def corners(boxes):
    table = np.array(boxes)
    return box_corners(table[:, :2], table[:, 2], table[:, 3:])


PAIRS = st.lists(st.tuples(BOXES, BOXES), min_size=1, max_size=20).map(
    lambda pairs: (corners([a for a, _ in pairs]), corners([b for _, b in pairs]))
)


def shared_area(a, b):
    return shapely.area(shapely.intersection(shapely.polygons(a), shapely.polygons(b)))


@given(PAIRS)
def test_shared_area_is_shapelys_and_symmetric(pair):
    a, b = pair
    np.testing.assert_allclose(overlap_area(a, b), shared_area(a, b), atol=1e-7)
    np.testing.assert_allclose(overlap_area(a, b), overlap_area(b, a), atol=1e-7)


@given(PAIRS)
def test_a_box_shares_all_of_itself_with_itself(pair):
    a, _ = pair
    np.testing.assert_allclose(
        overlap_area(a, a.copy()), shapely.area(shapely.polygons(a)), rtol=1e-9
    )


def test_no_pairs_share_nothing():
    assert overlap_area(np.zeros((0, 4, 2)), np.zeros((0, 4, 2))).shape == (0,)


def test_corners_run_counter_clockwise_from_front_left():
    box = box_corners(np.array([1.0, 2.0]), np.array(np.pi / 2), np.array([4.0, 2.0]))
    np.testing.assert_allclose(box, [[0, 4], [0, 0], [2, 0], [2, 4]], atol=1e-12)
