from dataclasses import replace

from tests.builders import empty_tracks, scenario_with, straight_drivers


def test_the_first_step_has_a_third_of_the_current_agents():
    agents = straight_drivers([(8.0 * number, 0.0, 0.0, 5.0) for number in range(4)])
    scenario = scenario_with(agents)
    assert scenario.first_step == 0
    now = scenario.current_step
    for count, expected in ((2, 0), (3, now)):
        is_valid = agents.is_valid.copy()
        is_valid[:count, :now] = False
        assert scenario_with(replace(agents, is_valid=is_valid)).first_step == expected


def test_a_bare_road_begins_at_the_first_step():
    assert scenario_with(empty_tracks(110)).first_step == 0


def test_a_scenario_is_shown_in_one_line():
    """A result that was not assigned filled a console with 250 kB."""
    told = repr(scenario_with(straight_drivers([(0.0, 0.0, 0.0, 5.0)])))
    assert told.startswith("<Scenario ")
    assert ": 1 agents, " in told
    assert len(told) < 200
