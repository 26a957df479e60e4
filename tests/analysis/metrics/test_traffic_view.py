from dataclasses import replace

import numpy as np
import pytest

from pd_editor.analysis.metrics.scene_metrics import agent_values
from pd_editor.analysis.metrics.traffic_view import generated_traffic, recorded_traffic
from pd_editor.base.errors import EditError
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.metrics.traffic_builders import sample_of
from tests.builders import empty_tracks, scenario_with, straight_drivers

KINDS = (
    AgentKind.VEHICLE,
    AgentKind.PEDESTRIAN,
    AgentKind.CYCLIST,
    AgentKind.CONSTRUCTION,
)
STATES = [(0.0, 0.0, 0.0, 10.0), (5.0, 9.0, 1.0, 1.0), (9.0, 3.5, 0.0, 4.0), (2.0,) * 4]
SCENARIO = scenario_with(straight_drivers(STATES, kinds=KINDS))


def test_recorded_road_users_at_the_state_are_judged_in_groups():
    view = recorded_traffic(SCENARIO)
    assert view.agents.ids == ("100", "101", "102")
    assert view.num_steps == 61
    assert view.agents.is_in("movers").tolist() == [True, False, False]
    assert view.agents.is_in("pedestrians").tolist() == [False, True, False]
    assert view.agents.is_in("cyclists").tolist() == [False, False, True]
    np.testing.assert_array_equal(
        view.agents.position_m, SCENARIO.agents.position_m[:3, SCENARIO.current_step :]
    )


def test_only_some_are_judged_among_the_others():
    view = recorded_traffic(SCENARIO, ["102"])
    assert view.agents.ids == ("102",)
    assert view.context.ids == ("100", "101")
    with pytest.raises(EditError):
        recorded_traffic(SCENARIO, ["missing"])


def test_agents_that_come_later_are_not_in_the_scene():
    agents = SCENARIO.agents
    is_valid = agents.is_valid.copy()
    is_valid[0, :60] = False
    later = SCENARIO.with_agents(agents.with_rows(np.arange(4), is_valid=is_valid))
    assert recorded_traffic(later).everyone.ids == ("101", "102")


def test_generated_agents_keep_their_recording_and_new_ones_have_none():
    path = np.zeros((2, 61, 2))
    sample = sample_of(("102", "new"), path)
    view = generated_traffic(SCENARIO, sample)
    assert view.context.ids == ("100", "101")
    np.testing.assert_array_equal(
        view.logged.position_m[0],
        SCENARIO.agents.position_m[2, SCENARIO.current_step :],
    )
    assert view.logged.is_valid[0].all()
    assert not view.logged.is_valid[1].any()


def test_a_scenario_without_a_future_is_padded_for_generated_traffic():
    axis = TimeAxis(num_steps=50, current_step=49)
    agents = straight_drivers(STATES[:2], kinds=KINDS[:2], time_axis=axis)
    scenario = replace(scenario_with(agents_of_110()), agents=agents, time_axis=axis)
    view = generated_traffic(scenario, sample_of(("100",), np.ones((1, 61, 2))))
    assert view.context.is_valid.sum() == 1
    assert view.logged.is_valid.sum() == 1
    values = agent_values(view)
    assert values["path_length"].is_valid.all()
    assert not values["ade"].is_valid.any()
    alone = agent_values(recorded_traffic(scenario))
    assert alone["speed"].is_valid.all()
    for name in ("new_overlap", "fde", "jerk", "lateral_deviation_final", "starts"):
        assert not alone[name].is_valid.any(), name


def agents_of_110():
    return straight_drivers(STATES[:2], kinds=KINDS[:2])


def test_a_scene_of_empty_and_a_map_of_nothing_have_metrics():
    empty = agent_values(recorded_traffic(scenario_with(empty_tracks(110))))
    assert all(len(values) == 0 for values in empty.values())
    nowhere = scenario_with(straight_drivers(STATES, kinds=KINDS), RoadMap(lanes=()))
    values = agent_values(recorded_traffic(nowhere))
    assert not values["lateral_deviation_mean"].is_valid.any()
    assert not values["nearest_edge"].is_valid.any()
    assert values["off_road_4m"].valid().all()
