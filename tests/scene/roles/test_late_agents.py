import numpy as np

from pd_editor.scene.roles.late_agents import LateAgents
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis
from tests.builders import scenario_with, straight_drivers

NOW = TimeAxis().current_step


def with_times(
    states: list[tuple[float, float, float, float]], *times: tuple[int, int]
) -> Scenario:
    """Agents at constant velocity that exist from a step until before another one."""
    agents = straight_drivers(states)
    steps = np.arange(agents.num_steps)
    is_valid = np.array([(steps >= first) & (steps < end) for first, end in times])
    mask = is_valid[..., None]
    return scenario_with(
        agents.with_rows(
            np.arange(len(states)),
            is_valid=is_valid,
            position_m=np.where(mask, agents.position_m, 0.0),
            heading_rad=np.where(is_valid, agents.heading_rad, 0.0),
            velocity_mps=np.where(mask, agents.velocity_mps, 0.0),
        )
    )


def test_late_agents_are_those_that_enter_after_the_current_step():
    states = [(0, 0, 0, 5), (50, 0, 0, 5), (90, 0, 0, 5), (20, 4, 0, 1)]
    scenario = with_times(states, (0, 110), (60, 110), (0, 40), (95, 100))
    late = LateAgents.of(scenario)
    assert late.row.tolist() == [1, 3]
    assert late.entry_step.tolist() == [60, 95]
    assert late.entering_by(60).row.tolist() == [1]
    assert not late.continues.any()


def test_before_they_enter_they_are_extended_at_their_velocity():
    states = [(0, 0, 0, 5), (50, 0, 0.3, 5)]
    scenario = with_times(states, (0, 110), (70, 110))
    extended = LateAgents.of(scenario).extended_backwards(scenario)
    whole = straight_drivers(states)
    assert np.allclose(extended.position_m[1, NOW:], whole.position_m[1, NOW:])
    assert np.allclose(extended.heading_rad[1, NOW:], 0.3)
    assert extended.is_valid[1, NOW:].all()
    assert not extended.is_valid[1, :NOW].any()
    kept = scenario.agents.position_m[1, 70:]
    assert np.array_equal(extended.position_m[1, 70:], kept)
    assert np.array_equal(extended.position_m[0], scenario.agents.position_m[0])


def test_a_lost_track_that_is_found_again_is_the_same_agent():
    # Agent 1 goes on where agent 0 was lost a second before; agent 2 is elsewhere.
    states = [(0, 0, 0, 8), (1, 0.5, 0, 8), (40, 4, 0, 8)]
    scenario = with_times(states, (0, 70), (80, 110), (80, 110))
    late = LateAgents.of(scenario)
    assert late.row.tolist() == [1, 2]
    assert late.continues.tolist() == [[True, False, False], [False] * 3]
    assert late.but_continuing(np.array([0])).row.tolist() == [2]
    assert late.but_continuing(np.array([], int)).row.tolist() == [1, 2]


def test_a_scene_without_late_agents_stays():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 5)]))
    late = LateAgents.of(scenario)
    assert not len(late.row)
    assert late.extended_backwards(scenario) is scenario.agents
