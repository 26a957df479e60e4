from dataclasses import replace

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.speed import ComfortLimits
from pd_editor.generation.trajectory.sample_yielding import with_yielding
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal, SignalState
from pd_editor.scene.time_axis import TimeAxis
from tests.analysis.repair.scenes import crowded_road, crowds, overlaps_later
from tests.builders import scenario_with, straight_drivers, straight_lane

NOW = TimeAxis().current_step


def straight_on(scenario: Scenario, rows: np.ndarray) -> TrafficSample:
    """The recorded futures of some agents, as if they were drawn."""
    agents = scenario.agents
    return TrafficSample(
        ids=tuple(agents.ids[row] for row in rows),
        kinds=tuple(agents.kinds[row] for row in rows),
        size_m=agents.size_m[rows],
        position_m=agents.position_m[rows, NOW:],
        heading_rad=agents.heading_rad[rows, NOW:],
        velocity_mps=agents.velocity_mps[rows, NOW:],
    )


def with_sample(
    scenario: Scenario, rows: np.ndarray, sample: TrafficSample
) -> Scenario:
    agents = scenario.agents
    position, heading = agents.position_m[rows].copy(), agents.heading_rad[rows].copy()
    position[:, NOW:], heading[:, NOW:] = sample.position_m, sample.heading_rad
    changed = agents.with_rows(rows, position_m=position, heading_rad=heading)
    return scenario.with_agents(changed)


def test_a_drawn_follower_waits_behind_a_recorded_standing_car():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 0)]))
    rows = np.array([0])
    sample, waiting = with_yielding(scenario, rows, straight_on(scenario, rows))
    assert waiting == (scenario.agents.ids[0],)
    assert overlaps_later(scenario) == {(0, 1)}
    assert overlaps_later(with_sample(scenario, rows, sample)) == set()
    np.testing.assert_array_equal(sample.position_m[:, 0], [[0.0, 0.0]])
    np.testing.assert_allclose(sample.velocity_mps[:, 0], [[10.0, 0.0]])


@given(
    states=st.lists(st.sampled_from(SignalState), min_size=1, max_size=3),
    speed_mps=st.floats(5, 12),
)
@settings(deadline=None)
def test_who_can_stop_does_so_before_a_line_where_all_have_to(states, speed_mps):
    """Lanes that begin together have one line; who goes to a place beyond it goes on."""
    agents = straight_drivers([(22, 0, 0, speed_mps), (40, 8, 0, speed_mps)])
    scenario = before_lines(
        agents, [np.full(agents.num_steps, state) for state in states]
    )
    rows = np.arange(2)
    drawn = straight_on(scenario, rows)
    closed = {SignalState.STOP, SignalState.CAUTION}.issuperset(states)
    sample, waiting = with_yielding(scenario, rows, drawn)
    front = sample.position_m[0, :, 0] + agents.size_m[0, 0] / 2
    crosses = drawn.position_m[0, -1, 0] + agents.size_m[0, 0] / 2 > 50
    assert (scenario.agents.ids[0] in waiting) == (closed and crosses)
    assert (front[-1] < 50) == (closed or not crosses)
    assert scenario.agents.ids[1] not in waiting  # beside the lane
    goal = GoalPoint(agent_id=scenario.agents.ids[0], point_m=(80.0, 0.0), at_s=6.0)
    assert with_yielding(scenario, rows, drawn, (goal,)) == (drawn, ())


def before_lines(agents, states: list[np.ndarray]) -> Scenario:
    """Agents before lanes that begin together, whose signals have some states."""
    lanes = [straight_lane(n, (50, 0), (90, 0)) for n in range(len(states))]
    road_map = RoadMap(lanes=(straight_lane(9, (-50, 0), (50, 0)), *lanes))
    return replace(
        scenario_with(agents, road_map),
        signals=tuple(
            Signal(
                signal_id=str(lane),
                lane_ids=(lane,),
                stop_share=np.zeros(1),
                states=state.astype(np.int8),
            )
            for lane, state in enumerate(states)
        ),
    )


@given(opens_s=st.floats(0.2, 5.5))
@settings(deadline=None)
def test_a_line_that_opens_is_no_obstacle_any_more(opens_s):
    agents = straight_drivers([(22, 0, 0, 10.0)])
    reaches_s = (50 - 22 - agents.size_m[0, 0] / 2) / 10.0
    states = np.full(agents.num_steps, SignalState.STOP)
    states[NOW + round(opens_s / 0.1) :] = SignalState.GO
    scenario, rows = before_lines(agents, [states]), np.arange(1)
    drawn = straight_on(scenario, rows)
    sample, waiting = with_yielding(scenario, rows, drawn)
    if opens_s < reaches_s - 0.2:
        assert (sample, waiting) == (drawn, ())
    elif opens_s > reaches_s + 0.2:
        front = sample.position_m[0, :, 0] + agents.size_m[0, 0] / 2
        assert waiting
        assert (front[: round(opens_s / 0.1)] < 50).all()


def test_a_pedestrian_waits_as_well():
    kinds = (AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    states = [(10, -4, np.pi / 2, 1.4), (10, 0, 0, 0)]
    scenario = scenario_with(straight_drivers(states, kinds=kinds))
    rows = np.array([0])
    assert overlaps_later(scenario) == {(0, 1)}
    sample, waiting = with_yielding(scenario, rows, straight_on(scenario, rows))
    assert waiting == (scenario.agents.ids[0],)
    assert overlaps_later(with_sample(scenario, rows, sample)) == set()


def test_the_recorded_do_not_wait_for_the_drawn():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 0)]))
    rows = np.array([1])
    drawn = straight_on(scenario, rows)
    sample, waiting = with_yielding(scenario, rows, drawn)
    assert sample is drawn
    assert waiting == ()


@given(crowds(max_agents=5))
@settings(max_examples=25, deadline=None)
def test_agents_keep_to_their_paths_and_no_more_overlap(crowd):
    scenario = crowded_road(crowd)
    rows = np.arange(len(scenario.agents))[::-1]
    drawn = straight_on(scenario, rows)
    sample, waiting = with_yielding(scenario, rows, drawn)
    after = with_sample(scenario, rows, sample)
    assert len(overlaps_later(after)) <= len(overlaps_later(scenario))
    for index, name in enumerate(drawn.ids):
        path = shapely.LineString(drawn.position_m[index])
        points = shapely.points(sample.position_m[index])
        assert shapely.distance(path, points).max() < 1e-6
        moved = not np.array_equal(sample.position_m[index], drawn.position_m[index])
        assert name in waiting or not moved


def entering(scenario: Scenario, row: int, step: int) -> Scenario:
    """The scenario in which an agent is recorded from a step on."""
    is_valid = scenario.agents.is_valid[row].copy()
    is_valid[:step] = False
    agents = scenario.agents.with_rows(np.array([row]), is_valid=is_valid)
    return scenario.with_agents(agents)


def test_a_sampled_follower_waits_behind_a_car_that_enters_later():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (40, 0, 0, 0)]))
    scenario = entering(scenario, 1, NOW + 20)
    rows = np.array([0])
    sample, waiting = with_yielding(scenario, rows, straight_on(scenario, rows))
    assert waiting == (scenario.agents.ids[0],)
    reach = sample.position_m[0, -1, 0] + scenario.agents.size_m[:, 0].sum() / 2
    assert reach < 40


def test_an_agent_does_not_wait_for_the_continuation_of_its_own_track():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (0, 0.2, 0, 10)]))
    agents = scenario.agents
    is_valid = agents.is_valid.copy()
    is_valid[0, NOW + 10 :] = is_valid[1, : NOW + 15] = False
    rows = np.array([0, 1])
    lost = scenario.with_agents(agents.with_rows(rows, is_valid=is_valid))
    _, waiting = with_yielding(lost, rows[:1], straight_on(scenario, rows[:1]))
    assert waiting == ()


def test_agents_wait_after_what_is_locked_of_their_trajectory():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 10), (45, 0, 0, 0)]))
    rows, name = np.array([0]), scenario.agents.ids[0]
    asked = straight_on(scenario, rows)
    for lock, waits in (
        (STATE_LOCK, True),
        (Lock(kept_s=1.5), True),
        (Lock(kept_s=3.8), False),
        (TRAJECTORY_LOCK, False),
    ):
        locked = replace(scenario, locks={name: lock})
        sample, waiting = with_yielding(locked, rows, asked)
        assert bool(waiting) is waits
        assert (sample is asked) is not waits
        kept = slice(0, round(10 * (lock.kept_s or 0.0)) + 1)
        for field in ("position_m", "heading_rad", "velocity_mps"):
            one, other = getattr(sample, field), getattr(asked, field)
            assert one[:, kept].tobytes() == other[:, kept].tobytes()
        if waits:
            assert overlaps_later(with_sample(scenario, rows, sample)) == set()
            speed = np.diff(sample.position_m[0, :, 0]) / 0.1
            assert np.diff(speed).min() > -0.1 * 5.0


def test_agents_with_comfort_limits_brake_gently_where_that_is_enough():
    scenario = scenario_with(straight_drivers([(0, 0, 0, 7), (25, 0, 0, 0)]))
    rows = np.array([0])
    asked = straight_on(scenario, rows)
    limits = ComfortLimits(max_braking_mps2=2.0)
    for terms, is_gentle in (
        ((), False),
        ((limits,), True),
        ((replace(limits, agent_ids=(scenario.agents.ids[1],)),), False),
    ):
        sample, waiting = with_yielding(scenario, rows, asked, terms)
        assert waiting == (scenario.agents.ids[0],)
        speed = np.diff(sample.position_m[0, :, 0]) / 0.1
        assert bool(np.diff(speed).min() > -0.1 * 2.1) is is_gentle
