import numpy as np

from pd_editor.analysis.metrics.box_overlaps import (
    actor_collision_2m,
    init_collision_2m,
)
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import AgentKind
from tests.analysis.metrics.traffic_builders import recorded
from tests.builders import scenario_with, straight_drivers

WALKS, CAR = AgentKind.PEDESTRIAN, AgentKind.VEHICLE


def test_two_cars_bumper_to_tail_are_no_collision():
    view = recorded([(0, 0, 0, 0), (4.0, 0, 0, 0), (4.0, 1.9, 0, 0)])
    assert init_collision_2m(view).value.tolist() == [0, 1, 1]


def test_only_the_own_group_counts_and_pedestrians_come_closer():
    states = [(0, 0, 0, 0), (1.5, 0, 0, 0), (1.5, 0.9, 0, 0)]
    pairs = init_collision_2m(recorded(states, (CAR, WALKS, WALKS)))
    assert pairs.value.tolist() == [0, 1, 1]
    apart = [(0, 0, 0, 0), (1.1, 0, 0, 0)]
    assert init_collision_2m(recorded(apart, (WALKS, WALKS))).value.tolist() == [0, 0]


def test_actor_collision_is_the_share_of_agent_steps():
    # 1 m/s towards a standing car 4 m ahead: within 2 m from 2.0 s to 6.0 s.
    values = actor_collision_2m(recorded([(0, 0, 0, 1), (4, 0, 0, 0)]))
    np.testing.assert_allclose(values.value, 41 / 61)


def test_invalid_steps_are_left_out_of_the_share():
    agents = straight_drivers([(0, 0, 0, 0), (1, 0, 0, 0)])
    is_valid = agents.is_valid.copy()
    is_valid[1, 80:] = False
    scenario = scenario_with(agents.with_rows(np.arange(2), is_valid=is_valid))
    values = actor_collision_2m(recorded_traffic(scenario))
    np.testing.assert_allclose(values.value, [31 / 61, 1.0])
