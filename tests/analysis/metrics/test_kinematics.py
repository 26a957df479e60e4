import numpy as np
import pytest

from pd_editor.analysis.metrics.motion import (
    derivative_operators,
    kinematics,
    motion_values,
)
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from tests.analysis.metrics.traffic_builders import generated
from tests.builders import scenario_with, straight_drivers

SCENARIO = scenario_with(straight_drivers([(0, 0, 0, 10)]))
TIME = np.arange(61) * 0.1


def along_x(x: np.ndarray):
    return generated(SCENARIO, ("100",), np.stack([x, np.zeros(61)], axis=-1)[None])


@pytest.mark.parametrize(
    ("num_steps", "window"), [(60, 21), (30, 21), (12, 12), (5, 5)]
)
def test_cubics_are_derived_exactly(num_steps, window):
    time = np.arange(num_steps) * 0.1
    value = 1 + 2 * time - 3 * time**2 + 0.5 * time**3
    first, second, third = derivative_operators(num_steps, window, 0.1) @ value
    np.testing.assert_allclose(first, 2 - 6 * time + 1.5 * time**2, atol=1e-8)
    np.testing.assert_allclose(second, -6 + 3 * time, atol=1e-7)
    np.testing.assert_allclose(third, 3.0, atol=1e-6)


def test_braking_in_a_straight_line():
    motion = kinematics(along_x(20 * TIME - 1.5 * TIME**2))
    np.testing.assert_allclose(motion.longitudinal_mps2, -3, atol=1e-8)
    np.testing.assert_allclose(motion.lateral_mps2, 0, atol=1e-8)
    np.testing.assert_allclose(motion.jerk_mps3, 0, atol=1e-6)
    np.testing.assert_allclose(motion.speed_mps[0], 20 - 3 * TIME, atol=1e-8)
    assert motion.values()["uncomfortable"].value.tolist() == [0]


@pytest.mark.parametrize(
    ("braking", "uncomfortable", "impossible"),
    [(4.0, 0, 0), (4.1, 1, 0), (9.7, 1, 0), (10.0, 1, 1)],
)
def test_limits_of_braking(braking, uncomfortable, impossible):
    values = kinematics(along_x(60 * TIME - braking / 2 * TIME**2)).values()
    assert values["uncomfortable"].value.tolist() == [uncomfortable]
    assert values["impossible_steps"].value.tolist() == [impossible]


def test_a_circle_pulls_to_the_left():
    speed, radius = 8.0, 16.0
    angle = speed * TIME / radius
    path = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    motion = kinematics(generated(SCENARIO, ("100",), path[None]))
    # A cubic follows a radian of a circle so well; less so at both ends.
    middle = slice(10, 50)
    np.testing.assert_allclose(motion.lateral_mps2[0, middle], 4.0, rtol=0.02)
    np.testing.assert_allclose(motion.lateral_mps2, 4.0, rtol=0.1)
    np.testing.assert_allclose(motion.longitudinal_mps2[0, middle], 0, atol=0.2)
    np.testing.assert_allclose(motion.yaw_rate_radps[0, 15:45], 0.5, rtol=0.01)
    assert motion.values()["impossible"].value.tolist() == [0]


def test_no_vehicle_turns_on_three_metres():
    angle = TIME[:, None]
    path = 3 * np.concatenate([np.sin(angle), 1 - np.cos(angle)], axis=-1)
    sharp = kinematics(generated(SCENARIO, ("100",), path[None])).values()
    assert sharp["impossible"].value.tolist() == [1]


def test_fits_across_missing_steps_are_not_valid():
    agents = SCENARIO.agents
    is_valid = agents.is_valid.copy()
    is_valid[0, SCENARIO.current_step + 40] = False  # step 40 of the window
    view = recorded_traffic(
        SCENARIO.with_agents(agents.with_rows(np.arange(1), is_valid=is_valid))
    )
    fits_before = kinematics(view).is_valid[0, :30]
    assert fits_before.all()
    assert not kinematics(view).is_valid[0, 30:].any()


def test_who_stands_may_start():
    states = [(0.0, 0.0, 0.0, 0.0), (0.0, 3.5, 0.0, 0.2), (50.0, 0.0, 0.0, 0.4)]
    values = motion_values(recorded_traffic(scenario_with(straight_drivers(states))))
    assert values["standing"].value.tolist() == [1, 1, 0]
    assert values["starts"].value.tolist() == [0, 1, 0]
    assert values["starts"].is_valid.tolist() == [True, True, False]
    np.testing.assert_allclose(values["path_length"].value, [0, 1.2, 2.4])
    np.testing.assert_allclose(values["speed"].value, [0, 0.2, 0.4])
