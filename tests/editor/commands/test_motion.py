"""Speeds and futures change; where agents are now does not."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import AdoptTrajectory, SetAgentSpeed
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers
from tests.editor.command_strategies import (
    ABSENT_ID,
    busy_scenario,
    ignore_random_checks,
    numbers,
    present,
    trajectory_from,
)

pytestmark = ignore_random_checks
BASE = busy_scenario()
NOW = BASE.current_step
STEP_S = BASE.time_axis.step_s
SOME = settings(max_examples=30, deadline=None)


def driver_on_a_circle(speed: float = 8.0, radius: float = 40.0) -> Scenario:
    scenario = scenario_with(straight_drivers([(0, 0, 0, speed)]))
    angle = scenario.time_axis.times_s() * speed / radius
    forward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    left = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return scenario.with_agents(
        scenario.agents.with_rows(
            np.array([0]),
            position_m=radius * (np.array([0.0, 1.0]) - left),
            heading_rad=np.arctan2(forward[:, 1], forward[:, 0]),
            velocity_mps=speed * forward,
        )
    )


@SOME
@given(ids=present(BASE), speed=numbers(-10, 30))
def test_the_state_stays_but_for_its_speed(ids, speed):
    changed = SetAgentSpeed(agent_ids=ids, speed_mps=speed).apply(BASE)
    rows = BASE.agents.rows(ids)
    for name in ("position_m", "heading_rad"):
        before = getattr(BASE.agents, name)[rows, NOW]
        assert (getattr(changed.agents, name)[rows, NOW] == before).all()
    assert np.allclose(changed.agents.speed_mps()[rows, NOW], abs(speed), atol=1e-6)
    assert (changed.agents.is_valid == BASE.agents.is_valid).all()


@SOME
@given(ids=present(BASE), speed=numbers(0.1, 20))
def test_velocity_is_the_rate_of_the_position(ids, speed):
    agents = SetAgentSpeed(agent_ids=ids, speed_mps=speed).apply(BASE).agents
    both = agents.is_valid[:, 1:] & agents.is_valid[:, :-1]
    rate = np.diff(agents.position_m, axis=1) / STEP_S
    assert np.allclose(rate[both], agents.velocity_mps[:, 1:][both], atol=1e-6)


@SOME
@given(speed=numbers(0.5, 8))
def test_slower_agents_stay_on_their_curve_before_and_after(speed):
    base = driver_on_a_circle()
    slower = SetAgentSpeed(agent_ids=("100",), speed_mps=speed).apply(base)
    curve = shapely.LineString(base.agents.position_m[0])
    points = slower.agents.position_m[0]
    assert shapely.distance(curve, shapely.points(points)).max() < 1e-6
    step = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    assert np.allclose(step, speed * STEP_S, atol=0.02)
    radius = np.linalg.norm(points - [0, 40], axis=-1)
    assert np.allclose(radius, 40, atol=0.01)


def test_a_faster_agent_goes_on_straight_beyond_its_curve():
    base = driver_on_a_circle()
    faster = SetAgentSpeed(agent_ids=("100",), speed_mps=16).apply(base)
    for ends in (slice(-6, None), slice(0, 6)):
        step = np.diff(faster.agents.position_m[0, ends], axis=0)
        assert np.allclose(np.linalg.norm(step, axis=-1), 1.6, atol=0.02)
        assert np.ptp(np.unwrap(np.arctan2(*step.T[::-1]))) < 1e-6


@pytest.mark.parametrize("name", ["100", "103", "102"])
def test_zero_speed_stands_still_for_good(name):
    stopped = SetAgentSpeed(agent_ids=(name,), speed_mps=0).apply(BASE)
    row = BASE.agents.row_of[name]
    valid = stopped.agents.is_valid[row]
    points = stopped.agents.position_m[row][valid]
    assert np.allclose(points, points[0], atol=1e-9)
    assert not stopped.agents.velocity_mps[row].any()


def test_a_standing_agent_starts_straight_ahead_and_came_from_behind():
    moving = SetAgentSpeed(agent_ids=("102",), speed_mps=5).apply(BASE)
    row = BASE.agents.row_of["102"]
    expected = 30 + 5 * BASE.time_axis.times_s()
    assert np.allclose(moving.agents.position_m[row, :, 0], expected, atol=1e-9)
    assert np.allclose(moving.agents.position_m[row, :, 1], 3.5, atol=1e-9)
    assert np.allclose(moving.agents.heading_rad[row], 0, atol=1e-9)


def test_backwards_is_a_straight_line_that_looks_ahead():
    back = SetAgentSpeed(agent_ids=("100",), speed_mps=-3).apply(BASE)
    assert np.allclose(
        back.agents.position_m[0, :, 0], -3 * BASE.time_axis.times_s(), atol=1e-9
    )
    assert not back.agents.heading_rad[0].any()
    again = SetAgentSpeed(agent_ids=("100",), speed_mps=10).apply(back)
    assert np.allclose(again.agents.position_m[0], BASE.agents.position_m[0], atol=1e-9)


def test_the_same_speed_is_no_edit():
    assert SetAgentSpeed(agent_ids=("100",), speed_mps=10).apply(BASE) is BASE


@pytest.mark.parametrize("speed", [60.5, -61, math.nan, math.inf])
def test_impossible_speeds_are_refused(speed):
    with pytest.raises(EditError):
        SetAgentSpeed(agent_ids=("100",), speed_mps=speed)


def test_an_absent_agent_has_no_speed():
    with pytest.raises(EditError, match="has no state at the current step"):
        SetAgentSpeed(agent_ids=(ABSENT_ID,), speed_mps=3).apply(BASE)


def test_an_adopted_trajectory_is_followed_and_the_rest_stays():
    arrays = trajectory_from(BASE, "104", 7.0, 0.1)
    command = AdoptTrajectory.of_arrays(agent_id="104", **arrays)
    agents = command.apply(BASE).agents
    row = agents.row_of["104"]
    assert agents.is_valid[row, NOW:].all()
    for name, values in arrays.items():
        after, before = getattr(agents, name)[row], getattr(BASE.agents, name)[row]
        assert np.allclose(after[NOW + 1 :], values[1:], atol=1e-4)
        assert (after[: NOW + 1] == before[: NOW + 1]).all()
    assert (agents.observed[row] == BASE.agents.observed[row]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: {k: v[:-1] for k, v in a.items()}, "has 60 steps; this scenario n"),
        (lambda a: a | {"position_m": a["position_m"] + 2}, "starts 2.8 m away"),
        (lambda a: a | {"position_m": a["position_m"] * np.nan}, "NaN"),
        (lambda a: a | {"heading_rad": a["heading_rad"] * np.inf}, "NaN or infinity"),
        (lambda a: a | {"velocity_mps": a["velocity_mps"] * np.nan}, "NaN or infinity"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value encountered")
def test_trajectories_that_do_not_fit_are_refused(change, message):
    arrays = change(trajectory_from(BASE, "100", 7.0, 0.1))
    with pytest.raises(EditError, match=message):
        AdoptTrajectory.of_arrays(agent_id="100", **arrays).apply(BASE)
