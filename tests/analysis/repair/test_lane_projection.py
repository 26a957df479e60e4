import numpy as np
import pytest
from hypothesis import given, settings

from pd_editor.analysis.repair.state_repairs import project_to_lanes
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
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
    repaired = project_to_lanes(scenario)
    before, after = overlaps_at(scenario, NOW), overlaps_at(repaired, NOW)
    assert len(after) <= len(before)
    assert (off_lane_m(repaired) <= off_lane_m(scenario) + 1e-6).all()
    assert project_to_lanes(repaired) is repaired
    np.testing.assert_allclose(
        repaired.agents.speed_mps(), scenario.agents.speed_mps(), atol=1e-9
    )


def test_a_driver_beside_the_road_is_put_onto_its_lane():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5), (30, -5, 0.2, 10)]))
    repaired = project_to_lanes(scenario)
    agents = repaired.agents
    np.testing.assert_allclose(agents.position_m[1, NOW], [30, 0], atol=1e-9)
    np.testing.assert_allclose(agents.heading_rad[1], 0, atol=1e-9)
    np.testing.assert_allclose(agents.velocity_mps[1], [[10, 0]] * 110, atol=1e-9)
    # The whole track came along rigidly.
    np.testing.assert_allclose(agents.position_m[1, -1], [30 + 60, 0], atol=1e-9)
    assert changed_ids(scenario, repaired) == {"101"}


def test_a_parked_agent_is_put_onto_its_lane_only_where_that_is_asked_for():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5), (30, -3, 0.2, 0)]))
    assert project_to_lanes(scenario) is scenario
    repaired = project_to_lanes(
        scenario, ("101",), max_offset_m=0.0, moves_stationary=True
    )
    np.testing.assert_allclose(repaired.agents.position_m[1, NOW], [30, 0], atol=1e-9)


def test_where_its_place_is_taken_the_nearest_free_one_is_used():
    scenario = scenario_with(straight_drivers([(30, 0, 0, 5), (30, -5, 0, 10)]))
    repaired = project_to_lanes(scenario)
    x, y = repaired.agents.position_m[1, NOW]
    assert y == pytest.approx(0, abs=1e-9)
    assert 4.5 < abs(x - 30) <= 4.75


@pytest.mark.parametrize(
    ("state", "kind"),
    [
        ((30, -5, 0, 0), AgentKind.VEHICLE),  # parked
        ((30, -1, 0, 9), AgentKind.VEHICLE),  # near enough
        ((30, -5, 0, 1), AgentKind.PEDESTRIAN),
        ((30, -5, 0, 1), AgentKind.RIDERLESS_BICYCLE),
    ],
)
def test_whoever_is_where_it_belongs_stays(state, kind):
    agents = straight_drivers([(0, 0, 0, 5), state], kinds=(AgentKind.VEHICLE, kind))
    scenario = scenario_with(agents)
    assert project_to_lanes(scenario) is scenario


def test_those_not_asked_for_stay():
    scenario = scenario_with(
        straight_drivers([(0, -5, 0, 5), (20, -5, 0, 5), (40, -5, 0, 5)])
    )
    everybody = project_to_lanes(scenario)
    assert changed_ids(scenario, everybody) == {"100", "101", "102"}
    some = project_to_lanes(scenario, ["100", "102"])
    assert changed_ids(scenario, some) == {"100", "102"}
    with pytest.raises(EditError, match="no agent 'x'"):
        project_to_lanes(scenario, ["x"])


def test_agents_without_a_lane_stay():
    wrong_way = scenario_with(straight_drivers([(0, 0, 0, 0), (30, -4, np.pi, 9)]))
    assert project_to_lanes(wrong_way) is wrong_way
