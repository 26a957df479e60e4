import numpy as np

from pd_editor.analysis.metrics.box_overlaps import box_overlap
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.scene.agent_kind import AgentKind
from tests.analysis.metrics.traffic_builders import generated, recorded
from tests.builders import scenario_with, straight_drivers


def test_a_follower_that_runs_into_a_standing_car_overlaps_newly_and_both_count():
    overlap = box_overlap(recorded([(0, 0, 0, 10), (20, 0, 0, 0), (0, 3.5, 0, 10)]))
    assert overlap.at_state().value.tolist() == [0, 0, 0]
    assert overlap.newly().value.tolist() == [1, 1, 0]
    # Boxes of 4.6 m x 1.9 m share 0.05 m^2 from 20 - 4.6 + 0.05/1.9 m on; passed at 24.6.
    steps = (np.arange(1, 61) > 15.43) & (np.arange(1, 61) < 24.57)
    np.testing.assert_allclose(overlap.new_steps().value, [steps.mean()] * 2 + [0])


def test_an_overlap_at_the_state_is_not_new():
    overlap = box_overlap(recorded([(0, 0, 0, 0), (2, 0, 0, 0)]))
    assert overlap.at_state().value.tolist() == [1, 1]
    assert overlap.newly().value.tolist() == [0, 0]


def test_pedestrians_among_themselves_and_things_never_count():
    walks, cone, car = AgentKind.PEDESTRIAN, AgentKind.CONSTRUCTION, AgentKind.VEHICLE
    together = [(0.0, 0.0, 0.0, 0.0)] * 2
    assert not box_overlap(recorded(together, (walks, walks))).at_state().value.any()
    assert box_overlap(recorded(together, (walks, car))).at_state().value.all()
    assert box_overlap(recorded(together, (cone, car))).at_state().value.tolist() == [0]


def test_kept_agents_can_be_hit_but_have_no_row():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 0), (20, 0, 0, 0)]))
    path = np.stack([np.arange(61.0), np.zeros(61)], axis=-1)[None]
    overlap = box_overlap(generated(scenario, ("100",), path))
    assert overlap.newly().value.tolist() == [1]


def test_steps_without_a_track_never_count():
    agents = straight_drivers([(0, 0, 0, 10), (20, 0, 0, 0)])
    is_valid = agents.is_valid.copy()
    is_valid[1, 55:] = False
    scenario = scenario_with(agents.with_rows(np.arange(2), is_valid=is_valid))
    overlap = box_overlap(recorded_traffic(scenario))
    assert overlap.newly().value.tolist() == [0, 0]
