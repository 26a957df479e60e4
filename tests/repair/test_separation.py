import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.repair import separate_overlaps
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS, AgentKind
from tests.builders import scenario_with, straight_drivers
from tests.repair.scenes import (
    changed_ids,
    crowded_road,
    crowds,
    off_lane_m,
    overlaps_at,
)

NOW = 50


@given(crowds())
@settings(max_examples=60, deadline=None)
def test_nothing_gets_worse_and_once_is_enough(crowd):
    scenario = crowded_road(crowd)
    repaired, report = separate_overlaps(scenario)
    before, after = overlaps_at(scenario, NOW), overlaps_at(repaired, NOW)
    assert after <= before
    assert (off_lane_m(repaired) <= off_lane_m(scenario) + 1e-5).all()
    changed = changed_ids(scenario, repaired)
    assert {change.agent_id for change in report.changes} == changed
    assert scenario.focal_id not in changed
    agents = scenario.agents
    for agent_id in changed:
        row = agents.row_of[agent_id]
        assert agents.kinds[row] in LANE_FOLLOWER_KINDS
        assert any(row in pair for pair in before)
    again, second = separate_overlaps(repaired)
    assert again is repaired
    assert second.problems == report.problems


def test_the_later_one_slides_along_its_lane_as_little_as_it_must():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (2, 0.4, 0.1, 8)]))
    repaired, report = separate_overlaps(scenario)
    x, y = repaired.agents.position_m[1, NOW]
    heading = repaired.agents.heading_rad[1, NOW]
    assert (y, heading) == (pytest.approx(0.4), pytest.approx(0.1))
    # 4.6 m of car, half a metre of room, and what its angle takes; steps of 0.25 m.
    assert 5.1 <= x <= 5.5
    assert len(report.changes) == 1
    assert report.changes[0].shift_m == pytest.approx(x - 2)
    offset = repaired.agents.position_m - scenario.agents.position_m
    np.testing.assert_allclose(offset[1], np.tile(offset[1, NOW], (110, 1)))


def test_a_queue_is_spread_out():
    scenario = scenario_with(straight_drivers([(3 * k, 0, 0, 0) for k in range(6)]))
    repaired, report = separate_overlaps(scenario)
    assert overlaps_at(repaired, NOW) == set()
    assert report.problems == ()
    np.testing.assert_allclose(repaired.agents.position_m[:, NOW, 1], 0, atol=1e-9)


def test_the_more_important_one_moves_only_if_the_other_cannot():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 9), (2, 0, 0, 8)]))
    repaired, _ = separate_overlaps(scenario, keep_ids=["101"])
    assert changed_ids(scenario, repaired) == {"100"}
    stays, report = separate_overlaps(scenario, keep_ids=["100", "101"])
    assert stays is scenario
    assert report.problems == ()


def test_people_and_things_never_move_but_are_made_room_for():
    kinds = (AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    agents = straight_drivers([(0, 0, 0, 1), (1, 0, 0, 8)], kinds=kinds)
    repaired, _ = separate_overlaps(scenario_with(agents), keep_ids=())
    assert changed_ids(scenario_with(agents), repaired) == {"101"}
    assert overlaps_at(repaired, NOW) == set()


def test_a_cyclist_with_a_bicycle_is_left_alone():
    kinds = (AgentKind.CYCLIST, AgentKind.RIDERLESS_BICYCLE)
    agents = straight_drivers([(0, 0, 0, 1), (0.3, 0, 0, 0)], kinds=kinds)
    scenario = scenario_with(agents)
    assert separate_overlaps(scenario, keep_ids=())[0] is scenario


def test_who_finds_no_place_is_named():
    # Kept cars without a gap on both lanes; 102 is in one of them.
    cars = [(5.0 * k - 40, 0, 0, 0) for k in range(17)]
    scenario = scenario_with(straight_drivers([*cars, (1, 0, 0, 0)]))
    repaired, report = separate_overlaps(scenario, ["117"])
    assert repaired is scenario
    assert [problem.agent_ids[1] for problem in report.problems] == ["117", "117"]
    assert "no free place within 20 m" in report.problems[0].message
