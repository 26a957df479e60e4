import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.analysis.repair.state_repairs import separate_overlaps
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.repair.scenes import (
    changed_ids,
    crowded_road,
    crowds,
    off_lane_m,
    overlaps_at,
)
from tests.builders import scenario_with, straight_drivers

NOW = TimeAxis().current_step


@given(crowds())
@settings(max_examples=60, deadline=None)
def test_nothing_gets_worse_and_once_is_enough(crowd):
    scenario = crowded_road(crowd)
    repaired = separate_overlaps(scenario)
    before, after = overlaps_at(scenario, NOW), overlaps_at(repaired, NOW)
    assert after <= before
    assert (off_lane_m(repaired) <= off_lane_m(scenario) + 1e-5).all()
    changed = changed_ids(scenario, repaired)
    agents = scenario.agents
    for agent_id in changed:
        row = agents.row_of[agent_id]
        assert agents.kinds[row] in LANE_FOLLOWER_KINDS
        assert any(row in pair for pair in before)
    assert separate_overlaps(repaired) is repaired


def test_the_later_one_slides_along_its_lane_as_little_as_it_must():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (2, 0.4, 0.1, 8)]))
    repaired = separate_overlaps(scenario)
    x, y = repaired.agents.position_m[1, NOW]
    heading = repaired.agents.heading_rad[1, NOW]
    assert (y, heading) == (pytest.approx(0.4), pytest.approx(0.1))
    # 4.6 m of car, half a metre of room, and what its angle takes; steps of 0.25 m.
    assert 5.1 <= x <= 5.5
    assert changed_ids(scenario, repaired) == {"101"}
    offset = repaired.agents.position_m - scenario.agents.position_m
    np.testing.assert_allclose(offset[1], np.tile(offset[1, NOW], (110, 1)))


def test_a_queue_is_spread_out():
    scenario = scenario_with(straight_drivers([(3 * k, 0, 0, 0) for k in range(6)]))
    repaired = separate_overlaps(scenario)
    assert overlaps_at(repaired, NOW) == set()
    np.testing.assert_allclose(repaired.agents.position_m[:, NOW, 1], 0, atol=1e-9)


def test_the_more_important_one_moves_only_if_the_other_cannot():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (2, 0, 0, 8)]))
    repaired = separate_overlaps(scenario, ["100"])
    assert changed_ids(scenario, repaired) == {"100"}
    assert separate_overlaps(scenario, []) is scenario


def test_people_and_things_never_move_but_are_made_room_for():
    kinds = (AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    agents = straight_drivers([(0, 0, 0, 1), (1, 0, 0, 8)], kinds=kinds)
    repaired = separate_overlaps(scenario_with(agents))
    assert changed_ids(scenario_with(agents), repaired) == {"101"}
    assert overlaps_at(repaired, NOW) == set()


def test_a_cyclist_with_a_bicycle_is_left_alone():
    kinds = (AgentKind.CYCLIST, AgentKind.RIDERLESS_BICYCLE)
    agents = straight_drivers([(0, 0, 0, 1), (0.3, 0, 0, 0)], kinds=kinds)
    scenario = scenario_with(agents)
    assert separate_overlaps(scenario) is scenario


def test_agents_without_a_free_place_stay():
    # Kept cars without a gap on both lanes; 102 is in one of them.
    cars = [(5.0 * k - 40, 0, 0, 0) for k in range(17)]
    scenario = scenario_with(straight_drivers([*cars, (1, 0, 0, 0)]))
    assert separate_overlaps(scenario, ["117"]) is scenario
