import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.analysis.metrics.box_overlaps import (
    MIN_OVERLAP_M2,
    boxes_collide,
    first_overlap,
    overlapping_pairs,
)
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.oriented_box import Boxes, box_corners
from tests.builders import (
    straight_drivers,
    two_agents_that_collide,
    two_agents_that_pass,
)

SIZES = st.floats(0.05, 5)
STATES = st.lists(
    st.tuples(
        st.floats(-12, 12), st.floats(-12, 12), st.floats(-3.1, 3.1), st.floats(0, 12)
    ),
    min_size=0,
    max_size=7,
)


def shared_m2(agents, step):
    """Area shared by every pair at a step, by shapely."""
    rings = box_corners(
        agents.position_m[:, step], agents.heading_rad[:, step], agents.size_m
    )
    boxes = shapely.polygons(rings)
    area = shapely.area(shapely.intersection(boxes[:, None], boxes[None]))
    valid = agents.is_valid[:, step]
    return np.triu(area * valid[:, None] * valid[None], 1)


def first_by_shapely(agents, steps):
    found = {}
    for step in steps:
        for pair in np.argwhere(shared_m2(agents, step) > MIN_OVERLAP_M2).tolist():
            found.setdefault(tuple(pair), int(step))
    return found


@settings(max_examples=40)
@given(STATES)
def test_pairs_and_first_steps_are_those_of_shapely(states):
    agents = straight_drivers(states)
    steps = np.arange(50, 110, 4)
    pairs, first = first_overlap(agents, steps)
    found = {
        tuple(pair): step for pair, step in zip(pairs.tolist(), first, strict=True)
    }
    assert found == first_by_shapely(agents, steps)


@given(
    st.lists(
        st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-4, 4), SIZES, SIZES),
        min_size=2,
        max_size=8,
    )
)
def test_boxes_collide_that_share_enough_by_shapely(table):
    table = np.array(table)
    boxes = Boxes(position_m=table[:, :2], heading_rad=table[:, 2], size_m=table[:, 3:])
    found = boxes_collide(boxes[:, None], boxes[None])
    rings = shapely.polygons(boxes.corners_m())
    area = shapely.area(shapely.intersection(rings[:, None], rings[None]))
    clear = np.abs(area - MIN_OVERLAP_M2) > 1e-9
    assert (found == (area > MIN_OVERLAP_M2))[clear].all()


def test_passing_agents_never_touch():
    agents = two_agents_that_pass().agents
    assert len(first_overlap(agents, np.arange(110))[0]) == 0


def test_a_collision_is_seen_when_the_boxes_meet():
    agents = two_agents_that_collide().agents
    assert len(overlapping_pairs(agents, 49)) == 0
    pairs, first = first_overlap(agents, np.arange(50, 110))
    # 20 m apart, each 4.6 m long, 10 m/s: contact after 1.54 s.
    np.testing.assert_array_equal(pairs, [[0, 1]])
    np.testing.assert_array_equal(first, [65])


def test_a_touch_does_not_count():
    agents = straight_drivers([(0, 0, 0, 0), (4.6 - 0.02, 0, 0, 0)])
    assert 0 < shared_m2(agents, 49).max() < MIN_OVERLAP_M2
    assert len(overlapping_pairs(agents, 49)) == 0


def test_absent_agents_do_not_overlap():
    agents = straight_drivers([(0, 0, 0, 0), (1, 0, 0, 0)])
    valid = agents.is_valid.copy()
    valid[1, :80] = False
    agents = replace(agents, is_valid=valid)
    assert len(overlapping_pairs(agents, 49)) == 0
    np.testing.assert_array_equal(first_overlap(agents, np.arange(50, 110))[1], [80])


@pytest.mark.real_data
def test_real_scenarios_agree_with_shapely(av2_scenario_folders):
    for folder in av2_scenario_folders[::13]:
        scenario = read_scenario(folder)
        step = scenario.current_step
        wanted = np.argwhere(shared_m2(scenario.agents, step) > MIN_OVERLAP_M2)
        np.testing.assert_array_equal(overlapping_pairs(scenario.agents, step), wanted)


def test_a_pile_of_agents_is_judged_in_portions():
    """Memory does not grow with the square of the agents (fault 1)."""
    agents = straight_drivers([(0.01 * row, 0, 0, 10) for row in range(300)])
    tracemalloc.start()
    pairs, first = first_overlap(agents, np.arange(50, 110))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(pairs) == 300 * 299 // 2
    assert (first == 50).all()
    assert peak < 300 * 2**20
