"""Scenario Dreamer's test of collisions, by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.metrics.box_overlaps import box_overlap, init_five_circles
from pd_editor.scene.agent_kind import AgentKind
from tests.analysis.metrics.traffic_builders import recorded

LENGTH_M, WIDTH_M = 4.6, 1.9
REACH_M = 2 * WIDTH_M / np.sqrt(3.8)


def meet(*states: tuple[float, float, float, float], kinds=None) -> list[float]:
    return init_five_circles(recorded(list(states), kinds)).value.tolist()


def test_circles_side_by_side_and_nose_to_tail_meet_at_their_reach():
    for distance, x, y in ((REACH_M, 0, 1), (LENGTH_M - WIDTH_M + REACH_M, 1, 0)):
        for off, hit in ((-0.01, 1), (0.01, 0)):
            place = (x * (distance + off), y * (distance + off), 0, 0)
            assert meet((0, 0, 0, 0), place) == [hit, hit]


def test_only_motor_vehicles_count():
    walks, car, bus = AgentKind.PEDESTRIAN, AgentKind.VEHICLE, AgentKind.BUS
    here = [(0.0, 0.0, 0.0, 0.0)] * 2
    found = init_five_circles(recorded(here, (car, walks)))
    assert found.value.tolist() == [0, 0]
    assert found.is_valid.tolist() == [True, False]
    assert meet(*here, kinds=(car, bus)) == [1, 1]


@given(
    st.floats(-6, 6), st.floats(-6, 6), st.floats(-np.pi, np.pi), st.floats(0, np.pi)
)
def test_corners_alone_are_missed_and_meeting_circles_are_nearly_boxes(x, y, turn, own):
    """Circles lie in the box but for a fortieth of its width: what meets nearly overlaps."""
    view = recorded([(0, 0, own, 0), (x, y, turn, 0)])
    grown = recorded([(0, 0, own, 0), (x, y, turn, 0)])
    object.__setattr__(grown.agents, "size_m", grown.agents.size_m + 0.5)
    if init_five_circles(view).value.any():
        assert box_overlap(grown).at_state().value.all()
    assert len(set(init_five_circles(view).value.tolist())) == 1
