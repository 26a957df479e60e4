"""Made-up pasts lead to the current state, smoothly, on the road, and past nobody."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pd_editor.analysis.repair.back_casting import made_up_past, with_past
from pd_editor.scene.agent_kind import Activity, AgentKind
from pd_editor.scene.geometry.oriented_box import box_corners
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers, two_lane_road

NOW = 49


def without_past(scenario: Scenario, rows: np.ndarray) -> Scenario:
    agents = with_past(scenario.agents, rows, NOW, None)
    return replace(scenario, agents=agents)


def back_cast(scenario: Scenario, rows: np.ndarray, seed: int = 0) -> Scenario:
    scenario = without_past(scenario, rows)
    past = made_up_past(scenario, rows, seed)
    return replace(scenario, agents=with_past(scenario.agents, rows, NOW, past))


def drivers(*states: tuple[float, float, float, float]) -> Scenario:
    return scenario_with(straight_drivers(list(states)), two_lane_road())


def polygons(scenario: Scenario, row: int) -> np.ndarray:
    agents = scenario.agents
    steps = np.flatnonzero(agents.is_valid[row])
    corners = box_corners(
        agents.position_m[row, steps],
        agents.heading_rad[row, steps],
        np.tile(agents.size_m[row], (len(steps), 1)),
    )
    found = np.full(agents.num_steps, None, object)
    found[steps] = shapely.polygons(corners)
    return found


def shared_m2(scenario: Scenario, one: int, other: int) -> float:
    """Largest area that two agents share before the current step, by shapely."""
    a, b = polygons(scenario, one)[:NOW], polygons(scenario, other)[:NOW]
    both = np.array(
        [x is not None and y is not None for x, y in zip(a, b, strict=True)]
    )
    if not both.any():
        return 0.0
    return float(shapely.area(shapely.intersection(a[both], b[both])).max())


@given(st.floats(0.5, 25), st.floats(-1.2, 1.2), st.integers(0, 2**31))
def test_a_past_ends_in_the_current_state_without_a_jump(speed, offset, seed):
    scenario = back_cast(drivers((0.0, offset, 0.0, speed)), np.array([0]), seed)
    agents = scenario.agents
    assert agents.is_valid[0].all()
    assert (agents.observed[0] == scenario.time_axis.is_past).all()
    steps = np.diff(agents.position_m[0], axis=0)
    assert np.linalg.norm(steps, axis=-1).max() < 0.1 * max(speed, 17) + 0.5
    velocity = agents.velocity_mps[0]
    acceleration = np.diff(velocity[NOW - 1 : NOW + 2], axis=0) / 0.1
    assert np.linalg.norm(np.diff(acceleration, axis=0)) < 0.05
    middle = (agents.position_m[0, 2:] - agents.position_m[0, :-2]) / 0.2
    assert np.abs(middle[: NOW - 2] - velocity[1 : NOW - 1]).max() < 0.01
    turn = np.diff(np.unwrap(agents.heading_rad[0]))
    assert np.abs(turn).max() < 0.1


@given(st.floats(2, 20), st.floats(-1.5, 1.5), st.integers(0, 2**31))
def test_a_past_turns_no_harder_than_vehicles_do(speed, heading, seed):
    """An agent at an angle to its lane came straight, or comes in later."""
    agents = back_cast(drivers((0.0, 0.0, heading, speed)), np.array([0]), seed).agents
    past = np.flatnonzero(agents.is_valid[0, :NOW])
    path, velocity = agents.position_m[0], agents.velocity_mps[0]
    turn = np.diff(np.unwrap(agents.heading_rad[0])) / 0.1
    gained = np.diff(velocity, axis=0) / 0.1
    middle = (velocity[1:] + velocity[:-1]) / 2
    fast = np.linalg.norm(middle, axis=-1)
    cross = middle[:, 0] * gained[:, 1] - middle[:, 1] * gained[:, 0]
    assert np.abs(cross / np.maximum(fast, 1.0))[past].max(initial=0) < 5.0
    assert np.abs(turn * fast)[past].max(initial=0) < 5.0
    assert (
        np.linalg.norm(np.diff(path, axis=0) / 0.1 - middle, axis=-1)[past].max(
            initial=0
        )
        < 0.3
    )


def test_who_cannot_have_turned_came_straight_for_a_while():
    # At 14 m/s nobody turns so far within the width of the road.
    agents = back_cast(drivers((0.0, 6.0, 0.8, 14)), np.array([0])).agents
    past = np.flatnonzero(agents.is_valid[0, :NOW])
    assert len(past) == 20
    assert np.abs(agents.heading_rad[0, past] - 0.8).max() < 0.01


@given(
    st.lists(st.tuples(st.floats(-60, 60), st.floats(0, 15)), min_size=2, max_size=6)
)
def test_pasts_overlap_nobody(states):
    places = sorted({round(x / 12) * 12.0: v for x, v in states}.items())
    scenario = drivers(*((x, 0.0, 0.0, v) for x, v in places))
    rows = np.arange(1, len(places))
    scenario = back_cast(scenario, rows)
    for row in rows:
        for other in range(row):
            assert shared_m2(scenario, int(row), other) < 0.06


def test_the_future_does_not_change_and_others_keep_theirs():
    before = drivers((0, 0, 0, 8), (30, 0, 0, 5), (60, 0, 0, 0))
    after = back_cast(before, np.array([1]))
    for name in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
        mine, theirs = getattr(after.agents, name), getattr(before.agents, name)
        assert (mine[1, NOW:] == theirs[1, NOW:]).all()
        assert (mine[[0, 2]] == theirs[[0, 2]]).all()
    assert after.agents.has_made_up_past.tolist() == [False, True, False]


def test_who_cannot_have_been_there_enters_late():
    # The other one stands behind, in the only lane, and has always stood there.
    scenario = drivers((-12, 0, 0, 0), (0, 0, 0, 12))
    agents = back_cast(scenario, np.array([1])).agents
    first = int(agents.is_valid[1].argmax())
    assert 0 < first < NOW
    assert agents.is_valid[1, first:].all()
    assert agents.position_m[1, first, 0] > -12 + 4.6


def test_parked_agents_were_always_there():
    scenario = drivers((0, 0, 0, 0))
    activity = np.array([Activity.PARKED], np.int8)
    scenario = replace(scenario, agents=replace(scenario.agents, activity=activity))
    for seed in range(20):
        agents = back_cast(scenario, np.array([0]), seed).agents
        assert np.allclose(agents.position_m[0], agents.position_m[0, NOW], atol=1e-4)


def test_some_of_the_waiting_have_arrived_and_most_have_not():
    scenario = drivers((0, 0, 0, 0))
    came = [
        back_cast(scenario, np.array([0]), seed).agents.position_m[0, 0, 0] < -1
        for seed in range(60)
    ]
    assert 0.05 < np.mean(came) < 0.45


def test_equal_seeds_give_equal_pasts_and_others_do_not():
    scenario = drivers((0, 0, 0, 8))
    rows = np.array([0])
    one, two, three = (made_up_past(scenario, rows, seed) for seed in (1, 1, 2))
    assert (one.position_m == two.position_m).all()
    assert not (one.position_m == three.position_m).all()


@pytest.mark.parametrize("kind", [AgentKind.PEDESTRIAN, AgentKind.STATIC])
def test_agents_that_follow_no_lane_came_straight(kind):
    scenario = drivers((0, 30, 1.0, 1.2))
    scenario = replace(scenario, agents=replace(scenario.agents, kinds=(kind,)))
    agents = back_cast(scenario, np.array([0])).agents
    way = agents.position_m[0, NOW] - agents.position_m[0, : NOW - 1]
    angle = np.arctan2(way[:, 1], way[:, 0])
    assert np.allclose(angle, 1.0, atol=0.02)


def test_nobody_needs_no_past():
    scenario = drivers((0, 0, 0, 8))
    assert made_up_past(scenario, np.zeros(0, int), 0).ids == ()
