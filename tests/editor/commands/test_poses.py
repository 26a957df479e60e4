"""Moves and turns carry whole tracks rigidly."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import EditError
from pd_editor.editor.commands import (
    SetAgentHeading,
    SetAgentPosition,
    SnapToLane,
    TransformAgents,
)
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import (
    ABSENT_ID,
    busy_scenario,
    ignore_random_checks,
    numbers,
    present,
)

pytestmark = ignore_random_checks
BASE = busy_scenario()
NOW = BASE.current_step
SOME = settings(max_examples=30, deadline=None)


def valid_points(scenario: Scenario, ids: tuple[str, ...]) -> np.ndarray:
    rows = scenario.agents.rows(ids)
    return scenario.agents.position_m[rows][scenario.agents.is_valid[rows]]


def state(scenario: Scenario, name: str) -> tuple[np.ndarray, float]:
    row = scenario.agents.row_of[name]
    agents = scenario.agents
    return agents.position_m[row, NOW], float(agents.heading_rad[row, NOW])


@SOME
@given(ids=present(BASE), dx=numbers(-50, 50), dy=numbers(-50, 50), turn=numbers(-7, 7))
def test_transform_keeps_all_distances(ids, dx, dy, turn):
    command = TransformAgents(agent_ids=ids, dx_m=dx, dy_m=dy, rotation_rad=turn)
    moved = command.apply(BASE)
    before, after = valid_points(BASE, ids), valid_points(moved, ids)
    gaps = [np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (before, after)]
    assert np.allclose(*gaps, atol=1e-9)
    rows = BASE.agents.rows(ids)
    centre = BASE.agents.position_m[rows, NOW].mean(0) + np.array([dx, dy])
    assert np.allclose(moved.agents.position_m[rows, NOW].mean(0), centre, atol=1e-9)
    assert np.allclose(moved.agents.speed_mps(), BASE.agents.speed_mps(), atol=1e-9)
    turned = wrap_angle(
        moved.agents.heading_rad[rows, NOW] - BASE.agents.heading_rad[rows, NOW] - turn
    )
    assert np.allclose(turned, 0, atol=1e-9)


@SOME
@given(ids=present(BASE), turn=numbers(-3, 3))
def test_velocities_turn_with_positions(ids, turn):
    moved = TransformAgents(agent_ids=ids, rotation_rad=turn).apply(BASE)
    agents = moved.agents
    both = agents.is_valid[:, 1:] & agents.is_valid[:, :-1]
    rate = np.diff(agents.position_m, axis=1) / BASE.time_axis.step_s
    assert np.allclose(rate[both], agents.velocity_mps[:, 1:][both], atol=1e-6)


@SOME
@given(ids=present(BASE), turn=numbers(-3, 3), dx=numbers(-9, 9))
def test_transform_there_and_back(ids, turn, dx):
    there = TransformAgents(agent_ids=ids, dx_m=dx, rotation_rad=turn).apply(BASE)
    away = TransformAgents(agent_ids=ids, dx_m=-dx).apply(there)
    back = TransformAgents(agent_ids=ids, rotation_rad=-turn).apply(away)
    assert np.allclose(back.agents.position_m, BASE.agents.position_m, atol=1e-9)


def test_a_shift_leaves_headings_alone_to_the_last_bit():
    moved = TransformAgents(agent_ids=("100",), dx_m=0.1).apply(BASE)
    assert moved.agents.heading_rad is BASE.agents.heading_rad
    assert moved.agents.velocity_mps is BASE.agents.velocity_mps


@SOME
@given(ids=present(BASE), heading=numbers(-7, 7))
def test_heading_is_set_where_the_agent_stands(ids, heading):
    turned = SetAgentHeading(agent_ids=ids, heading_rad=heading).apply(BASE)
    for name in ids:
        before, after = state(BASE, name), state(turned, name)
        assert (before[0] == after[0]).all()
        assert np.allclose(wrap_angle(np.array([after[1] - heading])), 0, atol=1e-9)


@SOME
@given(name=st.sampled_from(["100", "102", "103"]), x=numbers(-90, 90))
def test_position_is_set_exactly(name, x):
    moved = SetAgentPosition(agent_id=name, x_m=x, y_m=1.25).apply(BASE)
    assert tuple(state(moved, name)[0]) == (x, 1.25)


@SOME
@given(ids=present(BASE), dy=numbers(-6, 6), turn=numbers(-0.1, 0.1))
def test_snapped_agents_are_on_a_centre_line(ids, dy, turn):
    moved = TransformAgents(agent_ids=ids, dy_m=dy, rotation_rad=turn).apply(BASE)
    snapped = SnapToLane(agent_ids=ids).apply(moved)
    lines = shapely.MultiLineString([lane.centerline_m for lane in BASE.road_map.lanes])
    for name in ids:
        position, heading = state(snapped, name)
        assert lines.distance(shapely.Point(position)) < 1e-9
        assert abs(heading) < 1e-9, "all lanes run east"
        step = np.linalg.norm(position - state(moved, name)[0])
        assert step == pytest.approx(
            lines.distance(shapely.Point(state(moved, name)[0])), abs=1e-9
        )


def test_snapping_twice_is_snapping_once():
    once = SnapToLane(agent_ids=("103",)).apply(BASE)
    again = SnapToLane(agent_ids=("103",)).apply(once)
    assert np.allclose(
        once.agents.position_m, again.agents.position_m, rtol=0, atol=1e-9
    )


def test_agents_far_from_lanes_are_not_snapped():
    far = SetAgentPosition(agent_id="101", x_m=0, y_m=30).apply(BASE)
    with pytest.raises(EditError, match="Agent 101 has no lane within 15 m"):
        SnapToLane(agent_ids=("100", "101")).apply(far)


@pytest.mark.parametrize(
    "command",
    [
        TransformAgents(agent_ids=("100", ABSENT_ID), dx_m=1),
        SetAgentHeading(agent_ids=(ABSENT_ID,), heading_rad=1),
        SetAgentPosition(agent_id=ABSENT_ID, x_m=0, y_m=0),
        SnapToLane(agent_ids=(ABSENT_ID,)),
    ],
)
def test_an_agent_without_state_cannot_be_moved(command):
    with pytest.raises(
        EditError, match="Agent 105 has no state at the current step 49"
    ):
        command.apply(BASE)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TransformAgents(agent_ids=(), dx_m=1).apply(BASE), "No agent is sel"),
        (lambda: TransformAgents(agent_ids=("9",), dx_m=1).apply(BASE), "no agent '9'"),
        (lambda: TransformAgents(agent_ids=("100",), dx_m=math.nan), "x is nan"),
        (lambda: TransformAgents(agent_ids=("100",), dx_m=6000), "more than 5000 m"),
        (lambda: SetAgentPosition(agent_id="1", x_m=0, y_m=-5001), "more than 5000 m"),
        (lambda: SetAgentHeading(agent_ids=("1",), heading_rad=math.inf), "is inf"),
    ],
)
def test_impossible_moves_are_refused(make, message):
    with pytest.raises(EditError, match=message):
        make()


def test_agents_cannot_leave_the_scene_in_small_steps():
    scenario = SetAgentPosition(agent_id="100", x_m=4990, y_m=0).apply(BASE)
    with pytest.raises(EditError, match="more than 5000 m"):
        TransformAgents(agent_ids=("100",), dx_m=20).apply(scenario)
