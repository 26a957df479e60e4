"""Lines with widths, one by one and all at once."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.scene.geometry.wide_line import borders_m, wide_line, wide_lines

PLACES = st.tuples(st.integers(-9, 9), st.integers(-9, 9))


LINES = st.lists(PLACES, min_size=2, max_size=6).filter(lambda one: len(set(one)) > 1)


@given(st.lists(LINES, max_size=4))
def test_lines_that_are_made_at_once_are_those_made_one_by_one(
    corners: list[list[tuple[int, int]]],
):
    """Also those that repeat points, turn back, or are tighter than they are wide."""
    points = [np.array(one, float) for one in corners]
    widths = [np.full(len(one), 3.0) for one in points]
    together, apart = wide_lines(points, widths), [*map(wide_line, points, widths)]
    for one, other, borders in zip(together, apart, borders_m(together), strict=True):
        np.testing.assert_array_equal(one.normal, other.normal)
        (alone,) = borders_m([other])
        for side, other_side in zip(borders, alone, strict=True):
            np.testing.assert_array_equal(side, other_side)
