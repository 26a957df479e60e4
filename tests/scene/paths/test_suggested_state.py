"""What the road and the traffic suggest for an agent placed at a point (D8)."""

import numpy as np
import pytest

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.paths.suggested_state import (
    STANDSTILL_GAP_M,
    suggested_heading,
    suggested_state,
)
from tests.builders import scenario_with, straight_drivers


def test_the_lane_gives_heading_and_speed():
    scenario = scenario_with(straight_drivers([(-60, 0, 0, 10)]))
    state = suggested_state(scenario, np.array([0.0, 0.4]), AgentKind.VEHICLE)
    assert state.heading_rad == pytest.approx(0.0, abs=1e-6)
    assert state.speed_mps == pytest.approx(10.0, abs=0.1)
    assert suggested_heading(
        scenario.road_map, np.array([0.0, 0.4]), AgentKind.VEHICLE
    ) == pytest.approx(0.0, abs=1e-6)


def test_a_standing_queue_ahead_is_not_run_into():
    scenario = scenario_with(straight_drivers([(30, 0, 0, 0), (37, 0, 0, 0)]))
    state = suggested_state(scenario, np.array([0.0, 0.0]), AgentKind.VEHICLE)
    free = 30.0 - 4.6 - STANDSTILL_GAP_M
    assert 0 < state.speed_mps * scenario.time_axis.num_future_steps * 0.1 <= free + 1.5


def test_right_behind_a_standing_agent_it_stands():
    scenario = scenario_with(straight_drivers([(6, 0, 0, 0)]))
    state = suggested_state(scenario, np.array([0.0, 0.0]), AgentKind.VEHICLE)
    assert state.speed_mps == 0


def test_an_agent_ahead_that_drives_leaves_room_for_its_way():
    cars = [(20, 0, 0, 5), (-50, 0, 0, 12), (-60, 0, 0, 12)]
    scenario = scenario_with(straight_drivers(cars))
    state = suggested_state(scenario, np.array([0.0, 0.0]), AgentKind.VEHICLE)
    assert 5 < state.speed_mps < 8


def test_agents_beside_and_behind_do_not_matter():
    scenario = scenario_with(straight_drivers([(-10, 0, 0, 0), (20, 9, 0, 0)]))
    state = suggested_state(scenario, np.array([0.0, 0.0]), AgentKind.VEHICLE)
    assert state.speed_mps == 8.0


def test_a_heading_by_hand_is_kept_and_what_stands_there_counts():
    scenario = scenario_with(straight_drivers([(0, 12, 0, 0)]))
    across = suggested_state(
        scenario, np.array([0.0, 0.0]), AgentKind.VEHICLE, heading_rad=np.pi / 2
    )
    assert across.heading_rad == np.pi / 2
    assert across.speed_mps < 2
