from dataclasses import replace

import numpy as np
import shapely
from hypothesis import given, settings

from pd_editor.analysis.repair.retimed_trajectories import yield_to_others
from pd_editor.analysis.repair.yielding import MAX_BRAKING_MPS2
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.repair.scenes import (
    changed_ids,
    crowded_road,
    crowds,
    overlaps_later,
)
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass

NOW = TimeAxis().current_step
STEP_S = 0.1


def progress(scenario: Scenario) -> np.ndarray:
    """Distance travelled since the current step."""
    step = np.diff(scenario.agents.position_m[:, NOW:], axis=1)
    return np.cumsum(np.linalg.norm(step, axis=-1), axis=1)


@given(crowds(max_agents=5))
@settings(max_examples=25, deadline=None)
def test_nothing_gets_worse_and_once_is_enough(crowd):
    scenario = crowded_road(crowd)
    repaired, yielded = yield_to_others(scenario)
    assert len(overlaps_later(repaired)) <= len(overlaps_later(scenario))
    assert (progress(repaired) <= progress(scenario) + 1e-6).all()
    one, two = scenario.agents, repaired.agents
    past = slice(0, NOW + 1)
    np.testing.assert_array_equal(one.position_m[:, past], two.position_m[:, past])
    np.testing.assert_array_equal(one.heading_rad[:, past], two.heading_rad[:, past])
    np.testing.assert_array_equal(one.is_valid, two.is_valid)
    # Everybody stays on its own path; here all paths are straight.
    for row in range(len(one)):
        path = shapely.LineString(one.position_m[row, NOW:])
        points = shapely.points(two.position_m[row, NOW:])
        assert shapely.distance(path, points).max() < 1e-6
    assert set(yielded) == changed_ids(scenario, repaired)


def test_a_follower_stops_behind_a_standing_car():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 0)]))
    repaired, yielded = yield_to_others(scenario)
    agents = repaired.agents
    assert overlaps_later(repaired) == set()
    end = agents.position_m[0, -1, 0]
    assert 40 - 4.6 - 3 < end <= 40 - 4.6
    speed = agents.speed_mps()[0, NOW:]
    # It can stop before the standing car.
    assert speed[-1] ** 2 / (2 * MAX_BRAKING_MPS2) < 40 - 4.6 - end
    assert np.diff(speed).min() / STEP_S > -3.2
    assert np.diff(speed).max() / STEP_S < 0.5
    assert changed_ids(scenario, repaired) == {"100"}
    assert yielded == ("100",)


def test_too_near_to_brake_gently_it_brakes_hard():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (17.5, 0, 0, 0)]))
    repaired, _ = yield_to_others(scenario)
    assert overlaps_later(repaired) == set()
    rate = np.diff(repaired.agents.speed_mps()[0, NOW:]) / STEP_S
    assert -MAX_BRAKING_MPS2 - 0.2 < rate.min() < -3.5


def test_too_near_to_brake_at_all_it_goes_on():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (14, 0, 0, 0)]))
    repaired, yielded = yield_to_others(scenario)
    assert repaired is scenario
    assert yielded == ()


def test_a_queue_stops_one_behind_the_other():
    states = [(-25.0 * k, 0.0, 0.0, 10.0) for k in range(4)] + [(45.0, 0.0, 0.0, 0.0)]
    scenario = scenario_with(straight_drivers(states))
    repaired, yielded = yield_to_others(scenario)
    assert overlaps_later(repaired) == set()
    assert set(yielded) == changed_ids(scenario, repaired)
    ends = repaired.agents.position_m[:, -1, 0]
    assert (np.diff(ends[:4]) < -4.6).all()


def test_it_waits_for_crossing_traffic_and_then_goes_on():
    # Both would be at (20, 0) after 2 s; the one from the right is kept.
    scenario = scenario_with(
        straight_drivers([(20, -20, np.pi / 2, 10), (0, 0, 0, 10)])
    )
    repaired, _ = yield_to_others(scenario, ["101"])
    assert overlaps_later(repaired) == set()
    assert changed_ids(scenario, repaired) == {"101"}
    assert repaired.agents.position_m[1, -1, 0] > 35


def test_nobody_waits_without_need():
    scenario = two_agents_that_pass()
    repaired, yielded = yield_to_others(scenario)
    assert repaired is scenario
    assert yielded == ()


def test_those_who_overlap_now_are_no_matter_of_timing():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 8), (2, 0, 0, 8)]))
    assert yield_to_others(scenario)[0] is scenario


def test_tracks_that_end_early_and_have_gaps_are_fine():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (30, 0, 0, 0)]))
    agents = scenario.agents
    is_valid = agents.is_valid.copy()
    is_valid[0, 60:65] = is_valid[0, 100:] = False
    mask = is_valid[..., None]
    scenario = scenario.with_agents(
        replace(
            agents,
            is_valid=is_valid,
            position_m=np.where(mask, agents.position_m, 0.0),
            velocity_mps=np.where(mask, agents.velocity_mps, 0.0),
        )
    )
    repaired, _ = yield_to_others(scenario)
    assert overlaps_later(repaired) == set()
    np.testing.assert_array_equal(repaired.agents.is_valid, is_valid)
    assert (repaired.agents.position_m[~is_valid] == 0).all()


def test_people_are_waited_for():
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN)
    agents = straight_drivers([(0, 0, 0, 8), (25, -4, np.pi / 2, 1.3)], kinds=kinds)
    scenario = scenario_with(agents)
    assert overlaps_later(scenario) == {(0, 1)}
    repaired, _ = yield_to_others(scenario)
    assert overlaps_later(repaired) == set()
    assert changed_ids(scenario, repaired) == {"100"}
