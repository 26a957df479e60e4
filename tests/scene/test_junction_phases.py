from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.junction_phases import (
    continued_signals,
    junctions,
    sampled_signals,
    signals_with_green,
)
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal, SignalState, states_at
from tests.builders import empty_tracks, scenario_with, straight_lane, two_lane_road

WEST, SOUTH, EAST, NORTH, LEFT = 2, 3, 4, 5, 6
"""Where the lanes through the crossing come from; ``LEFT`` turns left from the west."""


def crossing(turn_rad: float = 0.0) -> Scenario:
    """Four ways that cross at right angles, and a left turn; lane 1 leads to two of them."""
    inside = {
        WEST: ((-10, -2), (10, -2)),
        SOUTH: ((2, -10), (2, 10)),
        EAST: ((10, 2), (-10, 2)),
        NORTH: ((-2, 10), (-2, -10)),
    }
    lanes = [
        straight_lane(n, *ends, is_intersection=True) for n, ends in inside.items()
    ]
    angle = np.linspace(-np.pi / 2, 0, 9)
    arc = np.column_stack(
        [-10 + 12 * np.cos(angle), 10 + 12 * np.sin(angle), np.zeros(9)]
    )
    lanes.append(replace(lanes[0], lane_id=LEFT, centerline=arc))
    lanes.append(straight_lane(1, (-60, -2), (-10, -2), successors=(WEST, LEFT)))
    road_map = RoadMap(lanes=tuple(lanes))
    turned = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=turn_rad)
    return scenario_with(empty_tracks(110), road_map.moved(turned.apply))


def green(scenario: Scenario) -> set[int]:
    states = states_at(scenario.signals, scenario.current_step)
    assert set(states.values()) <= {SignalState.GO, SignalState.STOP}
    return {lane for lane, state in states.items() if state is SignalState.GO}


@given(st.integers(0, 2**63 - 1), st.floats(-7, 7))
def test_no_two_lanes_with_green_cross_unless_they_turn_off_together(seed, turn_rad):
    scenario = crossing(turn_rad)
    signals = sampled_signals(scenario, seed)
    told = replace(scenario, signals=signals)
    assert {lane for one in signals for lane in one.lane_ids} == {2, 3, 4, 5, 6}
    lanes = [scenario.road_map.lane_of[lane] for lane in green(told)]
    lines = [shapely.LineString(lane.centerline_m) for lane in lanes]
    starts = [lane.centerline_m[0] for lane in lanes]
    for one, line in enumerate(lines):
        for other in range(one):
            apart = np.linalg.norm(starts[one] - starts[other]) > 2
            assert not (apart and line.intersects(lines[other]))


def test_all_phases_come_and_the_same_seed_gives_the_same():
    scenario = crossing()
    found = {
        frozenset(green(replace(scenario, signals=sampled_signals(scenario, seed))))
        for seed in range(60)
    }
    assert found == {
        frozenset({WEST, EAST}),
        frozenset({SOUTH, NORTH}),
        frozenset({WEST, LEFT}),
    }
    again = [sampled_signals(scenario, 3) for _ in range(2)]
    assert again[0][0].lane_ids == again[1][0].lane_ids


@pytest.mark.parametrize(
    ("lane", "goes"),
    [
        (WEST, {WEST, EAST}),
        (SOUTH, {SOUTH, NORTH}),
        (LEFT, {LEFT, WEST}),
        (1, {WEST, EAST}),
    ],
)
def test_a_lane_that_is_given_green_goes_with_its_phase(lane: int, goes: set[int]):
    scenario = crossing()
    signals = signals_with_green(scenario, lane)
    assert signals is not None
    assert green(replace(scenario, signals=signals)) == goes


def test_other_junctions_keep_their_signals():
    scenario = crossing()
    other = replace(
        scenario.road_map.lanes[0],
        lane_id=77,
        centerline=scenario.road_map.lanes[0].centerline + np.array([500.0, 0, 0]),
    )
    road_map = replace(scenario.road_map, lanes=(*scenario.road_map.lanes, other))
    scenario = replace(scenario, road_map=road_map)
    known = Signal(
        signal_id="known",
        lane_ids=(77,),
        stop_share=np.zeros(1),
        states=np.full(110, SignalState.GO, np.int8),
    )
    signals = signals_with_green(replace(scenario, signals=(known,)), SOUTH)
    assert signals is not None
    assert signals[0].lane_ids == (77,)


def with_signals(scenario: Scenario, signals: tuple[Signal, ...]) -> Scenario:
    count = len(signals[0].states)
    agents = scenario.agents.without_future(scenario.current_step, count)
    axis = scenario.time_axis.lasting(count)
    return replace(scenario, agents=agents, time_axis=axis, signals=signals)


def runs(states: np.ndarray) -> list[tuple[SignalState, float]]:
    """All that begin and end within the states, with seconds."""
    one = Signal(signal_id="", lane_ids=(), stop_share=np.zeros(0), states=states)
    return one.phases(0.1)[1:-1]


@given(st.integers(0, 2**63 - 1), st.integers(0, 5), st.none() | st.integers(111, 1200))
@example(seed=1216, phase=0, known=None)  # The first phase nearly over.
def test_phases_change_and_let_all_lanes_go_but_never_two_that_cross(
    seed, phase, known
):
    """Also if they have changed before, up to any moment."""
    scenario = crossing()
    scenario = replace(scenario, signals=sampled_signals(scenario, phase))
    now, was = scenario.current_step, green(scenario)
    if known is not None:
        scenario = with_signals(scenario, continued_signals(scenario, known, phase))
    before = {lane: one.states for one in scenario.signals for lane in one.lane_ids}
    has_changed = any(np.ptp(own) for own in before.values())
    longer = continued_signals(scenario, 2600, seed)
    states = {lane: one.states for one in longer for lane in one.lane_ids}
    assert states.keys() == {2, 3, 4, 5, 6}
    assert {n for n, own in states.items() if own[now] == SignalState.GO} == was
    for lane, own in states.items():
        assert len(own) == 2600
        assert (own[: now + 1] == own[0]).all()
        if has_changed:
            np.testing.assert_array_equal(own[:known], before[lane])
        for part in (own, own[known or 0 :]):
            assert (part == SignalState.GO).any()
        # Caution comes between go and stop alone.
        assert not (
            (own[:-1] == SignalState.STOP) & (own[1:] == SignalState.CAUTION)
        ).any()
        assert not ((own[:-1] == SignalState.GO) & (own[1:] == SignalState.STOP)).any()
        for state, seconds in runs(own):
            least = {SignalState.GO: 11.9, SignalState.CAUTION: 2.8}.get(state, 0.8)
            assert seconds >= least, (state, seconds)
    goes = {n: own != SignalState.STOP for n, own in states.items()}
    for one, other in ((WEST, SOUTH), (WEST, NORTH), (EAST, SOUTH), (LEFT, EAST)):
        assert not (goes[one] & goes[other]).any()


def test_a_longer_scene_has_the_signals_of_a_shorter_one():
    scenario = crossing()
    scenario = replace(scenario, signals=sampled_signals(scenario, 1))
    short, long = (continued_signals(scenario, count, 5) for count in (300, 900))
    one, other = (
        {lane: own.states[:300].tolist() for own in some for lane in own.lane_ids}
        for some in (short, long)
    )
    assert one == other


def test_signals_before_the_junction_go_on_where_their_stop_lines_are():
    """As files have them: of lanes that lead to it, in states of their own."""
    scenario = crossing()
    states = np.repeat([3, 2, 1], [30, 40, 40]).astype(np.int8)
    light = Signal(
        signal_id="light", lane_ids=(1,), stop_share=np.array([0.9]), states=states
    )
    dark = replace(light, signal_id="dark", states=np.zeros(110, np.int8))
    for one, goes_on in ((light, True), (dark, False)):
        (found,) = continued_signals(replace(scenario, signals=(one,)), 1100, 5)
        np.testing.assert_array_equal(found.states[:110], one.states)
        assert found.lane_ids == (1,)
        assert found.stop_share.tolist() == [0.9]
        assert ((found.states[110:] == SignalState.GO).any()) == goes_on


def test_without_crossing_traffic_there_are_no_phases():
    scenario = scenario_with(empty_tracks(110), two_lane_road())
    assert junctions(scenario.road_map) == ()
    assert sampled_signals(scenario, 0) == ()
    assert signals_with_green(scenario, 1) is None


def test_real_junctions_have_two_streets_and_let_some_go(av2_scenario_folders):
    number = 0
    for folder in av2_scenario_folders:
        scenario = read_scenario(folder)
        for junction in junctions(scenario.road_map):
            number += 1
            goes = junction.sampled_phase(np.random.default_rng(number))
            assert 0 < goes.sum() < len(goes)
    assert number > len(av2_scenario_folders) / 2
