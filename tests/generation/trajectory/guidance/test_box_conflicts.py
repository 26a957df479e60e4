"""Overlap depths of boxes against shapely, and places that another agent blocks."""

import numpy as np
import pytest
import shapely
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pd_editor.generation.trajectory.guidance.interaction_terms import last_places
from pd_editor.generation.trajectory.guidance.latent_motion import depth_m
from pd_editor.scene.geometry.oriented_box import box_corners

boxes = st.tuples(
    st.floats(-6, 6),
    st.floats(-6, 6),
    st.floats(-3, 3),
    st.floats(0.5, 8),
    st.floats(0.5, 3),
)


def polygon(box: np.ndarray, grown: tuple[float, float] = (0.0, 0.0)) -> object:
    size = box[None, 3:] + 2 * np.array(grown)
    return shapely.polygons(box_corners(box[None, :2], box[2:3], size))[0]


def depth(one: np.ndarray, two: np.ndarray) -> float:
    first, second = (torch.from_numpy(box) for box in (one, two))
    found = depth_m(
        second[None, :2] - first[None, :2],
        (first[2:3], second[2:3]),
        (first[None, 3:], second[None, 3:]),
    )
    return float(found[0])


@settings(max_examples=200)
@given(boxes, boxes)
@example(
    (-5.6484375, 0.0, 2.011505614250395, 2.011505614250395, 2.011505614250395),
    (-5.6484375, 0.0, 2.011505614250395, 7.817659904283256, 2.011505614250395),
)
def test_depth_is_positive_where_boxes_overlap(
    one: tuple[float, ...], two: tuple[float, ...]
) -> None:
    first, second = np.array(one), np.array(two)
    found = depth(first, second)
    # On a fine grid: without one, boxes with common edges may have an empty intersection.
    both = shapely.intersection(polygon(first), polygon(second), grid_size=1e-9)
    area = shapely.area(both)
    if found > 1e-6:
        assert area > 0
    else:
        assert area == pytest.approx(0.0, abs=1e-6)
    # Whoever is first, the depth is the same.
    assert depth(second, first) == pytest.approx(found, abs=1e-9)


@given(boxes)
def test_depth_is_how_far_a_box_must_move(box: tuple[float, ...]) -> None:
    first = np.array(box)
    forward = np.array([np.cos(first[2]), np.sin(first[2])])
    behind = first.copy()
    behind[:2] -= (first[3] - 0.1) * forward
    assert depth(first, behind) == pytest.approx(0.1, abs=1e-9)
    behind[:2] -= 0.3 * forward
    assert depth(first, behind) == pytest.approx(-0.2, abs=1e-9)


def test_an_agent_stays_before_what_will_be_blocked_later() -> None:
    # Place 2 is blocked at step 3 only, place 4 at step 1.
    blocked = torch.zeros(1, 6, 6, dtype=torch.bool)
    blocked[0, 2, 3] = blocked[0, 4, 1] = True
    assert last_places(blocked)[0].tolist() == [6, 6, 1, 1, 6, 6]


def test_an_agent_that_stands_in_the_way_cannot_yield() -> None:
    blocked = torch.zeros(1, 4, 4, dtype=torch.bool)
    blocked[0, 0, 2] = True
    assert (last_places(blocked)[0] < 0).any()
