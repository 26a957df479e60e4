import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.friction import (
    BRAKING_MPS2,
    path_curvature,
    summarise,
    warped_curvature,
)
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpTerm
from tests.builders import scenario_with, straight_drivers

ANCHOR = RigidMotion(x_m=0.0, y_m=0.0, rotation_rad=0.0)
MU = 0.7


def one(kind, power, border_m=5.0, anchor=ANCHOR):
    term = WarpTerm(
        kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind], border_m=border_m
    )
    return RoadWarp(anchor=anchor, terms=(term,))


def driven_speed(position_m, step_s=0.1):
    step = np.diff(position_m, axis=0)
    return np.hypot(step[:, 0], step[:, 1]) / step_s


@settings(max_examples=25)
@given(st.sampled_from(list(DEFAULT_LENGTH_M)), st.floats(2, 9), st.floats(3, 25))
def test_lateral_acceleration_stays_under_the_friction_limit(kind, power, speed):
    warp = one(kind, power)
    base = scenario_with(straight_drivers([(0, 0, 0, speed)]))
    slowed = warp_scenario(base, warp, friction_coefficient=MU).agents
    position = slowed.position_m[0]
    middle = (position[1:, 0] + position[:-1, 0]) / 2
    lateral = driven_speed(position) ** 2 * np.abs(warp.curvature(middle))
    assert lateral.max() <= MU * 9.81 * 1.08
    on_curve = np.abs(position[:, 1] - warp.derivative(position[:, 0], 0))
    assert on_curve.max() < 1e-9


def test_double_turn_of_power_9_is_driven_at_6_metres_a_second():
    base = scenario_with(straight_drivers([(-30, 0, 0, 15)]))
    slowed = warp_scenario(base, one("double-turn", 9.0), friction_coefficient=MU)
    x = slowed.agents.position_m[0, :, 0]
    speed = driven_speed(slowed.agents.position_m[0])
    bend = (x[:-1] > 12) & (x[:-1] < 26)
    assert speed[bend].min() == pytest.approx(6.2, abs=0.2)
    velocity = slowed.agents.speed_mps()[0]
    np.testing.assert_allclose(velocity[1:-1], (speed[1:] + speed[:-1]) / 2, atol=0.25)


def test_braking_is_bounded_and_starts_before_the_bend():
    base = scenario_with(straight_drivers([(-5, 0, 0, 15)]))
    slowed = warp_scenario(base, one("double-turn", 9.0), friction_coefficient=MU)
    agents, step = slowed.agents, base.current_step
    np.testing.assert_allclose(agents.position_m[0, step], [-5, 0], atol=1e-9)
    speed = agents.speed_mps()[0]
    assert 9 < speed[step] < 15, "lowered, since braking from here is too late"
    ahead = agents.position_m[0, :, 0] < 5
    braking = -np.diff(speed)[ahead[1:]] / 0.1
    assert braking.max() < BRAKING_MPS2 + 0.3
    assert speed[0] == pytest.approx(15, abs=1e-6), "long before, nothing changes"
    assert agents.position_m[0, 0, 0] > base.agents.position_m[0, 0, 0]


def test_those_who_are_slow_enough_are_left_alone():
    warp = one("double-turn", 9.0)
    limit = summarise(warp, MU).speed_limit_mps
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN, AgentKind.VEHICLE)
    states = [(0, 0, 0, limit / 1.5), (0, 3.5, 0, 15), (-90, 0, 0, 10)]
    base = scenario_with(straight_drivers(states, kinds=kinds))
    plain = warp_scenario(base, warp).agents
    slowed = warp_scenario(base, warp, friction_coefficient=MU).agents
    np.testing.assert_array_equal(slowed.position_m, plain.position_m)
    np.testing.assert_array_equal(slowed.velocity_mps, plain.velocity_mps)


@settings(max_examples=25)
@given(st.floats(-1.2, 1.2), st.floats(-8, 8), st.floats(0.0, 0.04))
def test_curvature_of_warped_arcs_agrees_with_finite_differences(heading, power, bend):
    warp = one("ripple-road", power)
    along = np.arange(0.0, 40.0, 0.05)
    angle = heading + bend * along
    start = np.array([10.0, -3.0])
    step = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    path = start + np.cumsum(step, axis=0)
    driven = warp.apply(path)
    change = np.gradient(driven, axis=0)
    turned = np.gradient(np.unwrap(np.arctan2(change[:, 1], change[:, 0])))
    numeric = turned / np.hypot(change[:, 0], change[:, 1])
    own = path_curvature(path[None])[0]
    found = warped_curvature(own, angle, path, warp)
    np.testing.assert_allclose(found[120:-120], numeric[120:-120], atol=4e-3)


def test_waiting_is_not_shortened():
    base = scenario_with(straight_drivers([(0, 0, 0, 12)]))
    time = np.maximum(np.arange(110) - 70, 0) * 0.1
    position = np.stack([12 * time - 3.0, 0 * time], axis=-1)[None]
    velocity = np.zeros((1, 110, 2))
    velocity[0, 70:, 0] = 12
    agents = base.agents.with_rows(
        np.array([0]), position_m=position, velocity_mps=velocity
    )
    slowed = warp_scenario(
        base.with_agents(agents), one("smooth-turn", 9.0), friction_coefficient=MU
    ).agents
    np.testing.assert_allclose(slowed.position_m[0, :69], position[0, :69], atol=1e-9)
    assert slowed.position_m[0, -1, 0] < position[0, -1, 0] - 1


@pytest.mark.real_data
def test_real_agents_are_left_alone_by_a_warp_that_hardly_bends(av2_scenario_folders):
    for folder in av2_scenario_folders[::6]:
        base = read_scenario(folder)
        row = int(base.agents.is_valid[:, base.current_step].argmax())
        x, y = base.agents.position_m[row, base.current_step].tolist()
        anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=0.0)
        warp = one("ripple-road", 1e-3, border_m=0.0, anchor=anchor)
        plain = warp_scenario(base, warp).agents
        slowed = warp_scenario(base, warp, friction_coefficient=MU).agents
        np.testing.assert_array_equal(slowed.position_m, plain.position_m)
